"""What goes ashore and in which order; on a thin link so little at a time that the newest is never stuck behind it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from autonomy import digest, wire
from autonomy.effects import Topic
from autonomy.geometry import LocalFrame
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.snapshot import PRECISIONS
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck
from autonomy.shell.outbox import GATHER_S, INDUCING, MODEL_S, Outbox
from autonomy.shell.rate_limit import OVERHEAD_BYTES, RateLimit

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import health_notice, model_snapshot, observation, plan_notice, survey_notice

ALL = frozenset(Topic)


def outbox(rate: float | None = None, precision: str = "lossless") -> Outbox:
    return Outbox(9, 10_000, 100, precision, RateLimit(rate))


def big_model(size: int = 100):
    """Two parts, one of which moves, on more places than a thin link wants."""
    kernel = Kernel(
        (
            Component(0.4, SquaredExponential((3000.0, 2500.0))),
            Component(0.1, SquaredExponential((900.0, 800.0)), OrnsteinUhlenbeck(6e3)),
        ),
        1e-3,
    )
    gp = SparseOnlineGP(kernel, size, prior_mean=33.0)
    rng = np.random.default_rng(3)
    for point in rng.uniform([0.0, 0.0], [12_000.0, 9_000.0], (3 * size, 2)):
        gp.update(point, 33.0 + np.sin(point[0] / 2000.0) + rng.normal(0, 0.03))
    return gp.model()


@pytest.fixture(scope="module")
def model():
    return big_model()


def everything(box: Outbox, now: float, listened=ALL) -> list[tuple[Topic, wire.Message]]:
    """All that goes now."""
    sent = []
    while (parcel := box.next(now, listened)) is not None:
        sent.append((parcel.topic, wire.decode(parcel.topic, parcel.payload)))
    return sent


def test_without_a_limit_all_goes_at_once_and_of_the_latest_only_the_newest() -> None:
    box = outbox()
    for k in range(3):
        box.offer(Topic.HEALTH, health_notice(str(k)))
        box.offer(Topic.OBSERVATIONS, observation(k))
        box.offer(Topic.LOG, wire.LogNotice("info", str(k)))
    box.offer(Topic.PLAN, plan_notice())
    assert box.due_in_s(0.0, ALL) == 0.0
    sent = dict(everything(box, 0.0))
    assert list(sent) == [Topic.HEALTH, Topic.PLAN, Topic.LOG, Topic.OBSERVATIONS]
    assert sent[Topic.HEALTH].reason == "2"
    assert sent[Topic.OBSERVATIONS].items == tuple(observation(k) for k in range(3))
    assert [line.text for line in sent[Topic.LOG].items] == ["0", "1", "2"]
    assert box.due_in_s(0.0, ALL) is None


def test_the_run_goes_with_all_that_has_times_of_its_clock(model) -> None:
    box = outbox()
    for topic, value in (
        (Topic.MODEL, model_snapshot(model)),
        (Topic.PLAN, plan_notice()),
        (Topic.HEALTH, health_notice()),
        (Topic.OBSERVATIONS, observation(0)),
        (Topic.LOG, wire.LogNotice("info", "sailing")),
    ):
        box.offer(topic, value)
    assert [value.run for _, value in everything(box, 0.0)] == [9] * 5


def test_health_tells_what_was_sent_before_it() -> None:
    box = outbox()
    box.offer(Topic.OBSERVATIONS, (observation(0), observation(1)))
    everything(box, 0.0)
    box.offer(Topic.OBSERVATIONS, observation(2))
    box.offer(Topic.HEALTH, health_notice())
    (_, health), _ = everything(box, 0.0)
    assert (health.run, health.observations_end) == (9, 2), "nobody is to ask for what is on its way"


def test_what_nobody_listens_to_waits_to_be_asked_for() -> None:
    box = outbox()
    box.offer(Topic.HEALTH, health_notice("early"))
    box.offer(Topic.OBSERVATIONS, observation(0))
    assert everything(box, 0.0, frozenset()) == []
    box.offer(Topic.OBSERVATIONS, observation(1))
    ((topic, batch),) = everything(box, 0.0)
    assert (topic, batch.first, batch.items) == (Topic.OBSERVATIONS, 1, (observation(1),))
    assert wire.decode(Topic.HEALTH, box.latest(Topic.HEALTH)).reason == "early"
    asked = wire.decode(Topic.OBSERVATIONS, box.piece(Topic.OBSERVATIONS, 0, 10))
    assert asked.items == (observation(0), observation(1))


@pytest.mark.parametrize("rate", [150.0, 400.0])
def test_on_a_thin_link_the_newest_is_fresh_and_the_rest_comes_in_order(rate: float, model) -> None:
    """A model every twenty seconds, health and a reading every second: simulated as the publisher does it."""
    box = outbox(rate)
    told, spent, newest_s, waits, coarse = [], 0, 0.0, [], set()
    box.offer(Topic.SURVEY, survey_notice())
    for second in range(1200):
        box.offer(Topic.OBSERVATIONS, observation(second))
        box.offer(Topic.HEALTH, health_notice())
        if second % 20 == 0:
            box.offer(Topic.MODEL, model_snapshot(model, second))
        while (parcel := box.next(float(second), ALL)) is not None:
            spent += len(parcel.payload) + OVERHEAD_BYTES
            value = wire.decode(parcel.topic, parcel.payload)
            if parcel.topic is Topic.OBSERVATIONS:
                told += [one.model_time_s for one in value.items]
            elif parcel.topic is Topic.MODEL:
                # It has the link to itself until it has arrived.
                arrives_s = second + (len(parcel.payload) + OVERHEAD_BYTES) / rate
                waits.append(arrives_s - newest_s)
                newest_s = value.sequence
                coarse.add((value.precision, len(value.model)))
        assert spent <= rate * (second + 2.0) + 8192, "what is ahead of the rate is one message at most"
    assert told == [float(second) for second in range(len(told))], "in order, none left out"
    assert len(told) >= 1200 - (GATHER_S + 60.0), "the link is wide enough for a reading a second"
    assert max(waits[3:]) <= 60.0 + MODEL_S, "from one model's moment to the arrival of the next"
    assert all(precision != "lossless" and size <= INDUCING for precision, size in coarse)


def test_on_a_wide_enough_link_the_precision_is_what_was_asked_for(model) -> None:
    for precision in PRECISIONS[1:]:
        box = outbox(20_000.0, precision)
        box.offer(Topic.MODEL, model_snapshot(model))
        ((_, sent),) = everything(box, 0.0)
        assert sent.precision == precision
        assert max(sent.stated_error) < 0.1


def test_what_cannot_be_written_is_counted() -> None:
    box = outbox()
    box.offer(Topic.LOG, wire.LogNotice("shout", "hello"))
    box.offer(Topic.OBSERVATIONS, wire.ObservationNotice(0.0, 200.0, 0.0, 33.0, 1, (1,) * 7))
    assert (box.refused, box.due_in_s(0.0, ALL)) == (2, None)


def test_the_digest_is_of_what_was_published_last(model) -> None:
    box = outbox()
    assert not box.has_health
    box.offer(Topic.HEALTH, health_notice())
    box.digest("boat1")
    bare = digest.decode(wire.decode(Topic.STATUS, box.latest(Topic.STATUS)).data)
    assert (bare.vehicle, bare.samples, bare.coarse, bare.route_deg) == ("boat1", 400, None, ())
    for topic, value in (
        (Topic.MODEL, model_snapshot(model, 2)),
        (Topic.PLAN, plan_notice()),
        (Topic.SURVEY, survey_notice()),
    ):
        box.offer(topic, value)
    box.digest("boat1")
    told = digest.decode(wire.decode(Topic.STATUS, box.latest(Topic.STATUS)).data)
    assert told.utc_s == round(1000.0 + 1.7e9 - 1000.0)
    np.testing.assert_allclose(told.route_deg, plan_notice().route_deg, atol=1e-4)
    frame = LocalFrame(34.4, -120.5)
    lat, lon = np.mgrid[34.405:34.475:5j, -120.49:-120.38:5j]
    truth = model.predict(frame.to_local(lat.ravel(), lon.ravel())).mean.reshape(5, 5)
    rows = np.rint((lat - 34.4) / 0.08 * 40 - 0.5).astype(int)
    columns = np.rint((lon + 120.5) / 0.13 * 40 - 0.5).astype(int)
    assert np.abs(told.map(40, 40)[rows, columns] - truth).mean() < 0.2 * np.std(truth)


def test_a_model_that_no_digest_can_hold_costs_the_digest_and_nothing_else(caplog) -> None:
    huge = SparseOnlineGP(
        Kernel((Component(1.0, SquaredExponential((900.0, 900.0))),), 0.1), 5, prior_mean=1e39
    )
    huge.update((0.0, 0.0), 1e39)
    box = outbox()
    for topic, value in (
        (Topic.HEALTH, health_notice()),
        (Topic.SURVEY, survey_notice()),
        (Topic.MODEL, model_snapshot(huge.model())),
    ):
        box.offer(topic, value)
    box.digest("boat1")
    assert box.latest(Topic.STATUS) is None
    assert "no digest: a prior mean of 1e+39" in caplog.text


def test_the_limit_is_overdrawn_by_one_message_and_then_waited_out() -> None:
    limit = RateLimit(100.0)
    assert limit.wait_s(0.0) == 0.0
    limit.spend(1000 - OVERHEAD_BYTES)
    assert limit.wait_s(0.0) == pytest.approx(10.0)
    assert limit.wait_s(4.0) == pytest.approx(6.0)
    assert limit.wait_s(11.0) == 0.0
    assert RateLimit(None).wait_s(0.0) == 0.0
