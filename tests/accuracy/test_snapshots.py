"""What goes ashore is the map: snapshots and digests of models that surveys of the sea have taught, against the models.

The three real files and the simulator's field; every water cell counts. The long form estimates more often, and looks
at the default learner after whole surveys besides.
"""

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from examinations import field_named
from forms import LONG
from sea_fields import SeaField
from surveys import INTERVAL_S, Survey, survey, surveyed

from autonomy.config import EstimationSection
from autonomy.digest import Digest, charted, decode, encode
from autonomy.geometry import LocalFrame
from autonomy.learning import snapshot
from autonomy.learning.field_model import FieldModel
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import reestimate

pytestmark = pytest.mark.timeout(3600 if LONG else 120)

REAL_FIELDS = ("txla-salt-9", "nordic-salt-34", "ucla-temp-49")
FIELDS = ("patch-0", *REAL_FIELDS)
NOTES = {
    "vehicle": "boat1",
    "survey": "bay-2026",
    "utc_s": 1.79e9,
    "software_version": "0.9.0",
    "configuration_hash": "a1b2c3d4e5f60718",
    "capacity": 100,
    "rho": 0.25,
}
"""What a sender notes beside a model; a snapshot's size is meant with it."""


Place = tuple[str, Path]
"""A field's name, and where its file is."""


@pytest.fixture
def place(request: pytest.FixtureRequest) -> Place:
    """The field of that name; skips if its file is not there."""
    real = not request.param.startswith(("patch", "bight"))
    return request.param, request.getfixturevalue("real_data_dir") if real else Path()


@lru_cache
def field_at(place: Place) -> SeaField:
    return field_named(*place)


@lru_cache
def learnt(place: Place, capacity: int | None, structure: str) -> FieldModel:
    """The model after a survey, estimated at its end, in the long form also after half of it."""
    field = field_at(place)
    sailed: Survey = survey(field, 10, across=False)
    learner = Learner(field.span_m, capacity, area_m2=field.side_m**2)
    options = EstimationSection(candidates=(structure,), maximum_points=300 if LONG else 150)
    half = len(sailed.x) // 2
    for number, (x, y) in enumerate(zip(sailed.x, sailed.y, strict=True), start=1):
        learner.add(x, float(y), number * INTERVAL_S)
        while learner.catch_up():
            pass
        if number == len(sailed.x) or (LONG and number == half):
            learner.adopt(reestimate(learner.reestimate_request(number, options)))
    while learner.catch_up():
        pass
    return learner.model()


def errors(field: SeaField, model: FieldModel, other: FieldModel) -> tuple[float, float, float]:
    """Greatest error of the mean, as a share of the map's range and of σf, and of the deviation, as a share of σf."""
    one, two = model.predict(field.points), other.predict(field.points)
    sd = [np.sqrt(np.maximum(each.variance, 0.0)) for each in (one, two)]
    mean, signal = np.abs(one.mean - two.mean).max(), math.sqrt(model.kernel.signal_variance)
    return float(mean / np.ptp(one.mean)), float(mean / signal), float(np.abs(sd[0] - sd[1]).max() / signal)


def told(what: str, data: bytes, read: snapshot.Snapshot, found: tuple[float, float, float]) -> None:
    """A line for who reads the figures (pytest -s)."""
    stated = f"stated {read.stated_error.mean:.1e} and {read.stated_error.sd:.1e}"
    print(
        f"{what:32} {len(read.model):4} places {len(data):6} bytes; mean {found[0]:.1e} of the range, "
        f"{found[1]:.1e} of σf; deviation {found[2]:.1e} of σf; {stated}"
    )


@pytest.mark.parametrize("place", FIELDS, indirect=True)
def test_a_hundred_basis_vectors_at_12_bits(place: Place) -> None:
    field, model = field_at(place), learnt(place, 100, "squared_exponential")
    assert len(model) > 70
    for precision in snapshot.PRECISIONS:
        data = snapshot.encode(model, NOTES, precision)
        read = snapshot.read(data)
        found = errors(field, model, read.model)
        told(f"{field.name} {precision}", data, read, found)
        if precision == "lossless":
            assert max(found) <= 1e-12
        if precision == "12 bit":
            assert len(data) <= 4600
            assert found[0] <= 0.002
            assert found[2] <= 0.02
            # It was found at other places, on a coarser lattice.
            assert found[1] <= 2.0 * read.stated_error.mean
            assert found[2] <= 2.0 * read.stated_error.sd


@pytest.mark.parametrize("place", FIELDS if LONG else ("nordic-salt-34",), indirect=True)
def test_three_components_and_two_hundred_basis_vectors_over_a_thin_link(place: Place) -> None:
    field, model = field_at(place), learnt(place, 200, "static_moving")
    assert len(model.kernel.components) == 3
    assert len(model) > 120
    for inducing in (100, 200, 300):
        data = snapshot.encode(model, NOTES, "8 bit", inducing)
        read = snapshot.read(data)
        found = errors(field, model, read.model)
        told(f"{field.name} 8 bit, at most {inducing}", data, read, found)
        assert len(data) <= 6000
        assert found[1] <= 2.0 * max(read.stated_error.mean, 0.005)
        assert found[2] <= 2.0 * max(read.stated_error.sd, 0.005)
    assert found[1] <= 0.02
    assert found[2] <= 0.02


@pytest.mark.skipif(not LONG, reason="whole surveys of four fields: HALOCLINE_ACCURACY=long")
@pytest.mark.parametrize("place", [*FIELDS, "sst-0", "bight-0"], indirect=True)
def test_the_default_learners_model(place: Place) -> None:
    field = field_at(place)
    model = surveyed(survey(field, 20, across=False)).model()
    for precision, inducing in (
        ("16 bit", None),
        ("12 bit", None),
        ("8 bit", None),
        ("8 bit", 200),
        ("8 bit", 100),
    ):
        data = snapshot.encode(model, NOTES, precision, inducing)
        read = snapshot.read(data)
        found = errors(field, model, read.model)
        told(f"{field.name} {precision} {inducing or ''}", data, read, found)
        if inducing is None:
            # A range may be a fraction of σf, in units of which the mean is rounded.
            assert found[0] <= (0.005 if precision == "8 bit" else 0.002)
            assert found[2] <= 0.02


@pytest.mark.parametrize("place", FIELDS, indirect=True)
def test_the_map_of_a_digest(place: Place) -> None:
    field, model = field_at(place), learnt(place, 100, "squared_exponential")
    frame = LocalFrame(34.0, -120.0)
    low, high = field.points.min(axis=0), field.points.max(axis=0)
    bounds = tuple(frame.to_geodetic([low, high]).ravel().tolist())
    coarse, mean_sd = charted(model, frame, bounds)
    route = tuple((bounds[0] + 0.01 * i, bounds[1] + 0.01 * i) for i in range(8))
    whole = Digest(
        "boat1",
        1_790_000_000,
        *(34.0, -120.0),
        units="1e-3",
        kernel=model.kernel,
        route_deg=route,
        bounds_deg=bounds,
        mean_sd=mean_sd,
        coarse=coarse,
    )
    data = encode(whole)
    assert len(data) <= 340
    rows, columns = 120, 120
    lat = bounds[0] + (bounds[2] - bounds[0]) * (np.arange(rows) + 0.5) / rows
    lon = bounds[1] + (bounds[3] - bounds[1]) * (np.arange(columns) + 0.5) / columns
    lons, lats = np.meshgrid(lon, lat)
    places = frame.to_local(lats.ravel(), lons.ravel())
    water = field.is_water(places)
    truth = model.predict(places[water]).mean
    error = decode(data).map(rows, columns).ravel()[water] - truth
    rms, worst = np.sqrt((error**2).mean()) / np.ptp(truth), np.abs(error).max() / np.ptp(truth)
    sent = int((decode(data).coarse.coefficients != 0).sum())
    print(
        f"{field.name}: {len(data)} bytes, {sent} coefficients; error {rms:.2%} rms, {worst:.1%} at most, of the range"
    )
    assert rms < 0.015
    assert worst < 0.1
