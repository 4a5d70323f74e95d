"""The publisher against real routers: absent, late, restarted, hung; and who joins late."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
from dataclasses import replace
from pathlib import Path

import cbor2
import numpy as np
import pytest

from autonomy import wire
from autonomy.effects import Topic
from autonomy.geometry import LocalFrame
from autonomy.predicting import MAXIMUM_REQUEST
from autonomy.shell.publisher import Publisher

sys.path.insert(0, str(Path(__file__).parent))
from shore_helpers import (
    SOON_S,
    Listener,
    free_endpoint,
    health_notice,
    learnt_model,
    model_snapshot,
    observation,
    plan_notice,
    publisher,
    router,
    survey_notice,
)

pytestmark = pytest.mark.process


def test_everything_arrives_under_its_key_with_its_schema():
    endpoint = free_endpoint()
    with router(endpoint) as ashore, Listener(ashore) as listener, publisher(endpoint) as boat:
        wait_until(lambda: boat.status.listened)
        values = {
            Topic.PLAN: plan_notice(),
            Topic.SURVEY: survey_notice(),
            Topic.STATUS: wire.StatusDigest(b"digest"),
        }
        told = {
            Topic.OBSERVATIONS: (observation(0), observation(1)),
            Topic.LOG: wire.LogNotice("info", "under way", 1.7e9),
        }
        for topic, value in (values | told).items():
            boat.publish(topic, value)
        heard = {}
        for topic in values | told:
            sample = listener.wait(f"usv/boat1/{topic.value}")
            heard[topic] = wire.decode(topic, sample.payload)
            assert sample.encoding == f"application/cbor;halocline/{topic.value}/{wire.VERSION}"
        values[Topic.PLAN] = replace(plan_notice(), run=heard[Topic.LOG].run)
        assert {topic: heard[topic] for topic in values} == values
        assert heard[Topic.OBSERVATIONS].items == told[Topic.OBSERVATIONS]
        assert heard[Topic.LOG].items == (told[Topic.LOG],)
        boat.publish(Topic.HEALTH, health_notice())
        health = wire.decode(Topic.HEALTH, listener.wait("usv/boat1/health").payload)
        assert (health.run, health.observations_end, health.log_end) == (heard[Topic.LOG].run, 2, 1)


def test_without_a_router_the_newest_wins_and_queues_drop_their_oldest():
    endpoint = free_endpoint()
    with publisher(endpoint, backlog=10) as boat:
        # All of this returns although nobody will ever take it.
        for number in range(1000):
            boat.publish(Topic.HEALTH, health_notice(str(number)))
            boat.publish(Topic.OBSERVATIONS, observation(number))
        assert boat.status.dropped["observations"] == 990
        assert boat.status.connected == 0
        assert not boat.status.listened
        with router(endpoint) as late, Listener(late) as listener:
            assert listener.wait("usv/boat1/alive").appeared
            kept = listener.ask("usv/boat1/observations?from=0;count=4096")[Topic.OBSERVATIONS]
            assert [one.model_time_s for one in kept.items] == list(range(990, 1000))
            assert (kept.oldest, kept.first, kept.end) == (990, 990, 1000)
            answers = listener.ask("usv/boat1/*")
            assert answers.keys() == {Topic.HEALTH, Topic.STATUS}, (
                "what is told in order is asked for by number"
            )
            assert answers[Topic.HEALTH].reason == "999"


def test_what_is_asked_for_wrongly_is_answered_with_what_is_wrong():
    endpoint = free_endpoint()
    with router(endpoint) as ashore, Listener(ashore) as listener, publisher(endpoint):
        assert listener.wait("usv/boat1/alive").appeared
        for parameters in ("from=soon;count=1", "from=0", "count=1", "from=0;count=-1", "from=1e3;count=1"):
            (reply,) = ashore.get(f"usv/boat1/observations?{parameters}", timeout=SOON_S)
            assert "must be a whole number" in bytes(reply.err.payload).decode()


def test_predictions_can_be_asked_for():
    model, points_m = learnt_model()
    snapshot = model_snapshot(model, 3)
    frame = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg)
    places = frame.to_geodetic(points_m[:50]).astype("<f8")
    request = cbor2.dumps({"v": wire.VERSION, "points_deg": cbor2.CBORTag(86, places.tobytes())})
    endpoint = free_endpoint()
    with router(endpoint) as ashore, Listener(ashore) as listener, publisher(endpoint) as boat:
        assert listener.wait("usv/boat1/alive").appeared
        (reply,) = ashore.get("usv/boat1/predict", payload=request, timeout=SOON_S)
        assert "there is no model yet" in bytes(reply.err.payload).decode()
        boat.publish(Topic.MODEL, snapshot)
        (reply,) = ashore.get("usv/boat1/predict", payload=request, timeout=SOON_S)
        answer = cbor2.loads(bytes(reply.ok.payload))
        expected = model.predict(points_m[:50])
        assert np.abs(np.frombuffer(answer["mean"].value) - expected.mean).max() < 1e-6
        assert np.abs(np.frombuffer(answer["sd"].value) - np.sqrt(expected.variance)).max() < 1e-6
        assert str(reply.ok.encoding) == f"application/cbor;halocline/predict/{wire.VERSION}"
        (reply,) = ashore.get("usv/boat1/predict", payload=b"\xff", timeout=SOON_S)
        assert "predict: is not CBOR" in bytes(reply.err.payload).decode()
        (reply,) = ashore.get("usv/boat1/predict", payload=bytes(MAXIMUM_REQUEST + 1), timeout=SOON_S)
        assert "must have at most 480000 bytes" in bytes(reply.err.payload).decode()
        assert list(ashore.get("usv/boat1/predict", timeout=SOON_S)) == [], "nothing was asked"


def test_one_observation_that_cannot_be_written_does_not_take_the_others_with_it(caplog):
    endpoint = free_endpoint()
    wrong = wire.ObservationNotice(0.0, 200.0, 0.0, 33.0, 1, (1,) * 7)
    with router(endpoint) as ashore, Listener(ashore) as listener, publisher(endpoint) as boat:
        boat.publish(Topic.OBSERVATIONS, (observation(0), wrong, observation(1)))
        assert boat.status.refused == 1
        assert "observations: lat_deg: must be a number from -90 to 90" in caplog.text
        assert listener.wait("usv/boat1/alive").appeared
        kept = listener.ask("usv/boat1/observations?from=0;count=4096")[Topic.OBSERVATIONS]
        assert kept.items == (observation(0), observation(1))


def test_publishing_never_waits_for_the_thread_that_owns_the_session():
    boat = Publisher("boat1", [free_endpoint()])
    # The thread isn't even running: a publish that waited for anything would hang here.
    for number in range(100):
        boat.publish(Topic.HEALTH, health_notice(str(number)))
    assert boat.stop()


def test_presence_comes_and_goes_with_the_publisher():
    endpoint = free_endpoint()
    with router(endpoint) as ashore, Listener(ashore) as listener:
        with publisher(endpoint) as boat:
            assert listener.wait("usv/boat1/alive").appeared
            wait_until(lambda: boat.status.listened)
            boat.publish(Topic.LOG, wire.LogNotice("info", "last words"))
            assert boat.stop(SOON_S)
        assert not listener.wait("usv/boat1/alive").appeared
        assert listener.wait("usv/boat1/log")


def test_nobody_named_to_dial_nothing_opened():
    threads = threading.active_count()
    boat = Publisher("boat1", [])
    boat.start()
    boat.publish(Topic.LOG, wire.LogNotice("info", "hello"))
    assert threading.active_count() == threads
    assert boat.status.routers == 0
    assert boat.status.trouble == ""
    assert boat.stop()


def test_names_and_addresses_are_checked_at_once():
    with pytest.raises(ValueError, match="not an address: 'localhost'"):
        Publisher("boat1", ["localhost"])
    with pytest.raises(ValueError, match="vehicle name"):
        Publisher("boat/1", [])


HUNG_ROUTER = """
    import sys
    sys.path[:0] = {path!r}
    from shore_helpers import router
    with router({endpoint!r}):
        print("listening", flush=True)
        sys.stdin.read()
"""


def test_a_hung_router_holds_up_neither_publishing_nor_the_stop():
    endpoint = free_endpoint()
    program = textwrap.dedent(HUNG_ROUTER.format(path=[str(Path(__file__).parent)], endpoint=endpoint))
    with (
        subprocess.Popen(
            [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as child,
        publisher(endpoint) as boat,
    ):
        assert child.stdout.readline() == b"listening\n"
        wait_until(lambda: boat.status.connected == 1)
        os.kill(child.pid, signal.SIGSTOP)
        for number in range(2000):
            boat.publish(Topic.HEALTH, health_notice("x" * 300 + str(number)))
            boat.publish(Topic.OBSERVATIONS, observation(number))
        stopped = boat.stop(SOON_S)
        child.kill()
        assert stopped


def wait_until(condition, timeout_s=SOON_S):
    """Poll a condition of another thread's."""
    pause = threading.Event()
    for _ in range(int(timeout_s / 0.02)):
        if condition():
            return
        pause.wait(0.02)
    raise AssertionError("it didn't come to pass")
