"""The published values through their wire form and back, and everything that isn't one refused."""

import dataclasses
import math

import cbor2
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.effects import Topic
from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.wire import (
    HealthNotice,
    LogBatch,
    LogNotice,
    ModelSnapshot,
    ObservationBatch,
    ObservationNotice,
    PlanNotice,
    StatusDigest,
    SurveyNotice,
    VersionError,
    WireError,
    alive_key,
    decode,
    encode,
    key,
    parse,
    schema,
    split_key,
)

number = st.floats(-1e6, 1e6)
latitude, longitude = st.floats(-90, 90), st.floats(-180, 360)
count = st.integers(0, 2**53)
share = st.floats(0, 1)


def maybe(strategy):
    return st.none() | strategy


# NaN is told by its identity here: equal figures are equal field by field.
unknown = st.just(math.nan)
figures = st.builds(
    CalibrationFigures,
    coverage_95=unknown | share,
    mean_square=unknown | st.floats(0, 1e9),
    log_score=unknown | number,
    count=count,
)
plans = st.integers(0, 20).flatmap(
    lambda corners: st.builds(
        PlanNotice,
        sequence=count,
        start_deg=st.tuples(latitude, longitude),
        route_deg=st.lists(st.tuples(latitude, longitude), min_size=corners, max_size=corners).map(tuple),
        is_spot=st.lists(st.booleans(), min_size=corners, max_size=corners).map(tuple),
        mutual_information=maybe(number),
        planner=st.text(max_size=40),
        reason=st.text(max_size=400),
        objective_before=maybe(number),
        objective_after=maybe(number),
        expected_rmse=maybe(st.floats(0, 1e6)),
        rejected=st.lists(st.tuples(st.text(max_size=40), number), max_size=3).map(tuple),
        seed=maybe(count),
        model_version=maybe(count),
        run=count,
        utc_s=maybe(st.floats(0, 1e11)),
    )
)
flag = st.sampled_from([1, 2, 3, 4, 9])
reading = st.floats(width=32, allow_nan=False, allow_infinity=False)
observations = st.lists(
    st.builds(ObservationNotice, number, latitude, longitude, reading, flag, st.tuples(*[flag] * 7))
).map(tuple)


def numbered(batch, items):
    """Items with numbers that may go with them."""
    return st.tuples(items, count, *[st.integers(0, 2**40)] * 3).map(
        lambda drawn: batch(drawn[1], drawn[2] + drawn[3], drawn[2], sum(drawn[2:]) + len(drawn[0]), drawn[0])
    )


healths = st.builds(
    HealthNotice,
    state=st.text(max_size=40),
    reason=st.text(max_size=400),
    mode=st.text(max_size=40),
    armed=st.booleans(),
    lat_deg=maybe(latitude),
    lon_deg=maybe(longitude),
    heading_deg=maybe(st.floats(0, 360)),
    groundspeed_mps=maybe(st.floats(0, 100)),
    model_time_s=maybe(number),
    samples=count,
    basis_size=count,
    rho=maybe(share),
    rho0=maybe(share),
    replans=count,
    kernel=st.text(max_size=200),
    calibration=figures,
    ahead=figures,
    repairs=count,
    distance_m=maybe(st.floats(0, 1e9)),
    clock_rate=maybe(st.floats(0, 1e4)),
    link_ok=st.booleans(),
    worker_busy=st.booleans(),
    dropped=count,
    journal=st.text(max_size=400),
    quality=st.dictionaries(st.text(max_size=40), st.tuples(*[count] * 5), max_size=8),
    run=count,
    utc_s=maybe(st.floats(0, 1e11)),
)
lines = st.builds(
    LogNotice,
    st.sampled_from(["debug", "info", "warning", "error"]),
    st.text(max_size=2000),
    maybe(st.floats(0, 1e11)),
)
corners = st.tuples(
    st.integers(-90_000_000, 90_000_000).map(lambda n: n / 1e6),
    st.integers(-180_000_000, 360_000_000).map(lambda n: n / 1e6),
)
rings = st.lists(st.lists(corners, min_size=3, max_size=5).map(tuple), max_size=2).map(tuple)
surveys = st.builds(
    SurveyNotice,
    name=st.text(max_size=100),
    variable=st.text(max_size=100),
    long_name=st.text(max_size=100),
    units=st.text(max_size=40),
    valid_range=st.tuples(maybe(number), maybe(number)),
    rho0=share,
    capacity=maybe(count),
    bounds_deg=st.tuples(st.floats(-90, -1), st.floats(-180, 0), st.floats(0, 90), st.floats(1, 360)),
    area=rings,
    land=rings,
    keep_in=rings,
    keep_out=rings,
    fence=rings,
)

NEAR, AHEAD = CalibrationFigures(0.94, 1.1, 0.3, 500), CalibrationFigures(math.nan, math.nan, math.nan, 0)
HEALTH = HealthNotice(
    *("EXPLORING", "", "AUTO", True, 34.0, -120.0, 90.0, 1.5, 9.0),
    *(10, 5, 0.2, 0.6, 1, "smooth 3.1 km", NEAR, AHEAD, 0, 100.0, 1.0, True, False, 0, ""),
    quality={"aggregate": (9, 0, 1, 0, 0)},
)
PLAN = PlanNotice(0, (34.0, -120.0), ((34.1, -120.1),), (True,), 1.0, "paper", "first plan")
MODEL = ModelSnapshot(
    vehicle="boat1",
    sequence=7,
    software_version="0.1.0",
    variable="sea_water_practical_salinity",
    units="1",
    model=FieldModel.prior(Hyperparameters(0.5, 0.01, (1000.0, 2000.0)), prior_mean=33.5),
    model_time_s=12.5,
    utc_s=None,
    samples=3,
    rho=1.0,
    replans=0,
    calibration=NEAR,
    ahead=AHEAD,
    origin_lat_deg=34.0,
    origin_lon_deg=-120.0,
    bounds_m=(-10.0, -20.0, 30.0, 40.0),
    survey="the bay",
    capacity=100,
    rho0=0.6,
    configuration_hash="0123456789abcdef",
)
GOOD_CHECKS = (1, 1, 1, 1, 3, 2, 1)
GOOD = {
    Topic.MODEL: MODEL,
    Topic.PLAN: PLAN,
    Topic.OBSERVATIONS: ObservationBatch(
        5, 10, 8, 12, (ObservationNotice(1.0, 34.0, -120.0, 33.0, 3, GOOD_CHECKS),)
    ),
    Topic.HEALTH: HEALTH,
    Topic.LOG: LogBatch(5, 0, 0, 1, (LogNotice("info", "hello", 1.7e9),)),
    Topic.SURVEY: SurveyNotice(
        *("the bay", "sea_water_temperature", "sea water temperature", "degree_C", (None, 40.0), 0.6, None),
        *((34.0, -120.0, 35.0, -119.0), (((34.0, -120.0), (34.0, -119.0), (35.0, -119.0)),)),
    ),
    Topic.STATUS: StatusDigest(bytes(340)),
}


def observed(**changes):
    batch = GOOD[Topic.OBSERVATIONS]
    return dataclasses.replace(batch, items=(dataclasses.replace(batch.items[0], **changes),))


def logged(*lines):
    return LogBatch(1, 0, 0, len(lines), lines)


@given(plans)
def test_plans_come_back(plan):
    assert decode(Topic.PLAN, encode(plan)) == plan


@given(numbered(ObservationBatch, observations))
def test_observations_come_back(batch):
    assert decode(Topic.OBSERVATIONS, encode(batch)) == batch


@given(healths)
def test_health_comes_back(health):
    assert decode(Topic.HEALTH, encode(health)) == health


@given(numbered(LogBatch, st.lists(lines, max_size=3).map(tuple)))
def test_log_lines_come_back(batch):
    assert decode(Topic.LOG, encode(batch)) == batch


@given(surveys)
def test_surveys_come_back(survey):
    assert decode(Topic.SURVEY, encode(survey)) == survey


@pytest.mark.parametrize("topic", list(Topic))
def test_what_is_packed_for_a_thin_link_is_the_same(topic):
    plain, packed = encode(GOOD[topic]), encode(GOOD[topic], packed=True)
    assert parse(topic, plain) == parse(topic, packed)
    if topic is not Topic.MODEL:
        assert decode(topic, packed) == decode(topic, plain)


def test_what_unpacks_to_too_much_is_refused():
    compressor = zstandard.ZstdCompressor()
    for bomb in (compressor.compress(bytes(17 * 2**20)), compressor.compressobj().compress(b"") or b""):
        with pytest.raises(WireError):
            decode(Topic.HEALTH, bomb)
    unsized = zstandard.ZstdCompressor(write_content_size=False).compress(encode(HEALTH))
    with pytest.raises(WireError, match="at most"):
        decode(Topic.HEALTH, unsized)


def test_corners_of_rings_are_a_tenth_of_a_metre_off_at_most():
    ring = ((34.12345678, -120.0), (34.0, -119.98765432), (35.0, -119.0))
    back = decode(Topic.SURVEY, encode(dataclasses.replace(GOOD[Topic.SURVEY], land=(ring,))))
    assert np.max(np.abs(np.subtract(back.land, ring))) <= 0.5e-6


def test_a_digest_comes_back():
    assert decode(Topic.STATUS, encode(StatusDigest(b"abc"))) == StatusDigest(b"abc")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_readings_without_a_number_travel_as_nan(value):
    (back,) = decode(Topic.OBSERVATIONS, encode(observed(value=value, flag=9))).items
    assert math.isnan(back.value)
    assert back.flag == 9


def test_a_model_comes_back_with_its_place_on_earth():
    back = decode(Topic.MODEL, encode(MODEL))
    for field in dataclasses.fields(ModelSnapshot):
        if field.name not in ("model", "believed"):
            assert getattr(back, field.name) == getattr(MODEL, field.name)
    assert back.believed == back.model.kernel == MODEL.model.kernel
    points = np.array([[0.0, 0.0], [5.0, 5.0]])
    np.testing.assert_allclose(back.model.predict(points).mean, MODEL.model.predict(points).mean)


@pytest.mark.parametrize("unknown", [math.nan, math.inf])
def test_numbers_that_may_be_unknown_travel_as_null(unknown):
    health = dataclasses.replace(HEALTH, heading_deg=unknown, rho=unknown)
    assert decode(Topic.HEALTH, encode(health)) == dataclasses.replace(HEALTH, heading_deg=None, rho=None)


@pytest.mark.parametrize(
    ("value", "place"),
    [
        (dataclasses.replace(MODEL, model_time_s=math.nan), "model: model_time_s: must be a number"),
        (dataclasses.replace(MODEL, bounds_m=(1.0, 0.0, 0.0, 1.0)), "model: bounds_m: must be x minimum"),
        (dataclasses.replace(MODEL, vehicle="a/b"), "model: vehicle: must match"),
        (observed(value=1e39), "observations: value: must be a number"),
        (observed(lat_deg=91.0), "observations: lat_deg: must be a number from -90 to 90"),
        (observed(flag=0), "observations: flag: must have at most 4096 times 1 bytes, each 1, 2, 3, 4 or 9"),
        (observed(checks=(1, 1)), "observations: checks: must have at most 4096 times 7 bytes"),
        (observed(checks=GOOD_CHECKS * 2), "must be equally long"),
        (dataclasses.replace(HEALTH, quality={"spike": (1, 2)}), "health: quality: must hold lists of 5"),
        (
            dataclasses.replace(HEALTH, quality={"spike": (1, 2, 3, 4, -1)}),
            "health: quality: must be a whole",
        ),
        (dataclasses.replace(HEALTH, quality=[]), "health: quality: must be a map of at most 20"),
        (dataclasses.replace(PLAN, is_spot=()), "plan: route_deg, is_spot: must be equally long"),
        (dataclasses.replace(HEALTH, samples=-1), "health: samples: must be a whole number"),
        (logged(LogNotice("shout", "hello")), "log: lines: must be one of debug, info, warning, error"),
        (logged(*[LogNotice("info", "")] * 501), "log: lines: must be a list of at most 500"),
        (LogBatch(1, 3, 4, 5, ()), "log: first: must be from oldest to end less the 0 items"),
        (LogBatch(1, 0, 0, 0, (LogNotice("info", ""),)), "log: first: must be from oldest to end less the 1"),
        (StatusDigest(bytes(341)), "status: data: must be a byte string of at most 340 bytes"),
        (
            dataclasses.replace(MODEL, precision="7 bit"),
            "model: model: precision must be one of lossless, 16 bit",
        ),
        (
            dataclasses.replace(GOOD[Topic.SURVEY], land=(((0.0, 0.0), (1.0, 1.0)),)),
            "survey: land: must have 3 to 20000 times 2 int32",
        ),
        (
            dataclasses.replace(GOOD[Topic.SURVEY], land=(((91.0, 0.0),) * 3,)),
            "survey: land: must be a number from -90 to 90",
        ),
        (
            dataclasses.replace(GOOD[Topic.SURVEY], keep_out=(((1.0, 0.0),) * 10_001,) * 2),
            "survey: keep_out: must have at most 20000 corners in all",
        ),
        (
            dataclasses.replace(GOOD[Topic.SURVEY], bounds_deg=(2.0, 0.0, 1.0, 3.0)),
            "survey: bounds_deg: must be south, west, north, east",
        ),
        (
            dataclasses.replace(HEALTH, calibration=dataclasses.replace(NEAR, coverage_95=1.2)),
            "health: calibration: coverage_95: must be a number from 0 to 1",
        ),
        (
            dataclasses.replace(MODEL, ahead=dataclasses.replace(NEAR, count=-1)),
            "model: ahead: count: must be a whole number",
        ),
        (dataclasses.replace(HEALTH, repairs=-1), "health: repairs: must be a whole number"),
        (dataclasses.replace(HEALTH, state="x" * 41), "health: state: must be text of at most 40"),
    ],
)
def test_what_cannot_be_read_is_not_written(value, place):
    with pytest.raises(WireError, match=place):
        encode(value)


def test_long_sentences_are_cut_rather_than_lost():
    (line,) = decode(Topic.LOG, encode(logged(LogNotice("info", "x" * 3000)))).items
    assert line.text == "x" * 1999 + "…"
    health = decode(Topic.HEALTH, encode(dataclasses.replace(HEALTH, reason="y" * 401)))
    assert health.reason == "y" * 399 + "…"


@settings(deadline=None)
@given(st.binary(max_size=300), st.sampled_from(list(Topic)))
def test_noise_is_refused(noise, topic):
    with pytest.raises(WireError, match=topic.value):
        decode(topic, noise)


def complaint_about(topic, payload):
    try:
        decode(topic, payload)
    except WireError as error:
        return str(error)
    return None


@settings(deadline=None)
@given(st.data(), st.sampled_from(list(Topic)))
def test_damaged_messages_are_refused_or_within_bounds(data, topic):
    payload = bytearray(encode(GOOD[topic]))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    damaged = bytes(payload[: data.draw(st.integers(0, len(payload)))])
    complaint = complaint_about(topic, damaged)
    assert complaint is None or (complaint.startswith(topic.value) and len(complaint) < 500)


junk = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=9)
    | st.builds(cbor2.CBORTag, st.sampled_from([64, 86, 40, 999]), st.binary(max_size=24)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@settings(deadline=None)
@given(st.data(), st.sampled_from(list(Topic)), junk)
def test_any_field_may_hold_anything(data, topic, value):
    content = cbor2.loads(encode(GOOD[topic]))
    name = data.draw(st.sampled_from(sorted(content)))
    content[name] = value
    complaint = complaint_about(topic, cbor2.dumps(content))
    assert complaint is None or (complaint.startswith(topic.value) and len(complaint) < 500)


@pytest.mark.parametrize("topic", list(Topic))
def test_every_missing_field_is_named(topic):
    content = cbor2.loads(encode(GOOD[topic]))
    for name in content:
        rest = {other: value for other, value in content.items() if other != name}
        with pytest.raises(WireError, match=f"{topic.value}: {name}: "):
            decode(topic, cbor2.dumps(rest))


def test_another_version_is_refused_and_new_fields_are_not():
    content = cbor2.loads(encode(HEALTH))
    inside = {**content["calibration"], "mood": "good"}
    newer = cbor2.dumps({**content, "mood": "good", "calibration": inside})
    assert decode(Topic.HEALTH, newer) == HEALTH
    for version in (2, 4):
        with pytest.raises(
            VersionError, match=rf"health: v: must be 3 \(got {version}\): .* update the older"
        ):
            decode(Topic.HEALTH, cbor2.dumps({**content, "v": version}))


@pytest.mark.parametrize(
    ("rejected", "complaint"),
    [
        ("lawnmower", "must be a list of at most 20"),
        ([["lawnmower"]], "must hold pairs"),
        ([["x" * 41, 1.0]], "must be text of at most 40"),
        ([["lawnmower", "1"]], "must be a number"),
        ([["lawnmower", 1.0]] * 21, "must be a list of at most 20"),
    ],
)
def test_strange_lists_of_candidates_are_refused(rejected, complaint):
    content = {**cbor2.loads(encode(PLAN)), "rejected": rejected}
    with pytest.raises(WireError, match=f"plan: rejected: {complaint}"):
        decode(Topic.PLAN, cbor2.dumps(content))


def test_of_many_candidates_the_best_are_told():
    many = tuple((f"candidate {k}", float(k)) for k in range(30))
    back = decode(Topic.PLAN, encode(dataclasses.replace(PLAN, rejected=many)))
    assert back.rejected == many[:20]


@pytest.mark.parametrize("name", ["coverage_95", "mean_square", "log_score", "count"])
def test_what_is_missing_of_the_calibration_is_named(name):
    content = cbor2.loads(encode(MODEL))
    del content["calibration"][name]
    with pytest.raises(WireError, match=f"model: calibration: {name}: is missing"):
        decode(Topic.MODEL, cbor2.dumps(content))


@settings(deadline=None)
@given(st.sampled_from(["coverage_95", "mean_square", "log_score", "count"]), st.data())
def test_any_field_of_the_calibration_may_hold_anything(name, data):
    content = cbor2.loads(encode(HEALTH))
    content["ahead"][name] = data.draw(junk)
    complaint = complaint_about(Topic.HEALTH, cbor2.dumps(content))
    assert complaint is None or complaint.startswith(
        (f"health: ahead: {name}: must be", "health: is not CBOR")
    )


@pytest.mark.parametrize(
    "payload",
    [
        b"\x81" * 100_000,
        b"\x9b" + b"\xff" * 8,
        b"\x5b\x0f" + b"\xff" * 7,
        cbor2.dumps(cbor2.CBORTag(35, "(a+)+b")),
        b"\xd8\x1c\x81\xd8\x1d\x00",
        cbor2.dumps(10**2000),
        bytes(17 * 2**20),
    ],
    ids=["depth", "array", "bytes", "pattern", "cycle", "bignum", "size"],
)
def test_bombs_do_not_go_off(payload):
    with pytest.raises(WireError):
        decode(Topic.HEALTH, payload)


def test_a_damaged_model_names_its_place():
    content = cbor2.loads(encode(MODEL))
    with pytest.raises(WireError, match=r"^model: model: "):
        decode(Topic.MODEL, cbor2.dumps({**content, "model": content["model"][:-9]}))


def test_keys():
    assert key("boat1", Topic.MODEL) == "usv/boat1/model"
    assert alive_key("*") == "usv/*/alive"
    assert split_key("usv/boat1/plan") == ("boat1", "plan")
    assert schema(Topic.MODEL) == "halocline/model/3"
    for wrong in ("usv/boat1", "usv/a b/plan", "car/boat1/plan", "usv/boat1/plan/x", "usv//plan", ""):
        with pytest.raises(WireError, match="must be usv/<vehicle>/<topic>"):
            split_key(wrong)
