"""Following a vehicle from ashore: late joiners, restarts, hostile bytes, and the command line."""

import argparse
import contextlib
import json
import logging
import os
import queue
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cbor2
import numpy as np
import pytest
from zenoh import CongestionControl

from autonomy.effects import Topic
from autonomy.endpoints import check_endpoint
from autonomy.shore import watch_cli
from autonomy.shore.inbox import Arrival
from autonomy.shore.picture import write_map
from autonomy.shore.roster import MAXIMUM_VEHICLES
from autonomy.shore.subscriber import Presence, Subscriber, VehicleView
from autonomy.wire import LogBatch, LogNotice, ModelSnapshot, encode

sys.path.insert(0, str(Path(__file__).parent))
from shore_helpers import (
    SOON_S,
    field,
    free_endpoint,
    health_notice,
    learnt_model,
    model_snapshot,
    observation,
    plan_notice,
    publisher,
    router,
    session,
)

pytestmark = pytest.mark.process

BLOCK = CongestionControl.BLOCK  # or zenoh drops what a busy machine does not take at once

X_AXIS, Y_AXIS = np.linspace(0, 12_000, 61), np.linspace(0, 9_000, 46)
WATCH = """
import argparse
from autonomy.shore import watch_cli
from autonomy.verbs import leave
parser = argparse.ArgumentParser(prog="watch")
watch_cli.add_arguments(parser)
leave(watch_cli.run(parser.parse_args()))
"""


@pytest.fixture(scope="module")
def learnt():
    return learnt_model()


def has_model(sequence, vehicle="boat1"):
    def condition(subscriber):
        model = subscriber.latest(vehicle).model
        return model is not None and model.sequence == sequence

    return condition


def publish_all(boat, model, sequence=0):
    boat.publish(Topic.MODEL, model_snapshot(model, sequence))
    boat.publish(Topic.PLAN, plan_notice(sequence))
    boat.publish(Topic.HEALTH, health_notice(str(sequence)))


def test_a_late_joiner_has_the_vehicles_map(learnt):
    model, _ = learnt
    endpoint = free_endpoint()
    with router(endpoint), publisher(endpoint) as boat:
        publish_all(boat, model)
        with Subscriber("boat1", connect=[endpoint]) as early:
            # From here on the vehicle has published and says nothing new.
            assert early.wait_for(has_model(0), SOON_S)
        with Subscriber(connect=[endpoint]) as late:
            assert late.wait_for(has_model(0), SOON_S)
            assert late.wait_for(lambda one: one.latest("boat1").health is not None, SOON_S)
            assert late.wait_for(lambda one: one.latest("boat1").plan is not None, SOON_S)
            assert late.wait_for(lambda one: one.latest("boat1").alive, SOON_S)
            view = late.latest("boat1")
            assert view.plan == replace(plan_notice(), run=view.health.run)
            assert late.vehicles() == ["boat1"]
            spread = np.std(field(np.stack(np.meshgrid(X_AXIS, Y_AXIS), axis=-1)))
            theirs, ours = (one.predict_grid(X_AXIS, Y_AXIS) for one in (model, view.model.model))
            assert np.max(np.abs(ours.mean - theirs.mean)) < 0.005 * spread
            assert np.max(np.abs(np.sqrt(ours.variance) - np.sqrt(theirs.variance))) < 0.005 * spread


def test_the_subscriber_may_be_the_router_and_start_last(learnt):
    model, _ = learnt
    endpoint = free_endpoint()
    with publisher(endpoint) as boat:
        publish_all(boat, model, 5)
        boat.publish(Topic.OBSERVATIONS, (observation(0), observation(1)))
        updates = queue.Queue()
        with Subscriber("boat1", listen=[endpoint], on_update=updates.put) as shore:
            assert shore.wait_for(has_model(5), SOON_S)
            assert shore.wait_for(lambda one: len(one.track("boat1")) == 2, SOON_S)
            boat.publish(Topic.LOG, LogNotice("info", "hello"))
            while (update := updates.get(timeout=SOON_S)).value != LogNotice("info", "hello"):
                assert update.vehicle == "boat1"


def test_restarts_of_router_and_vehicle_are_survived(learnt):
    model, _ = learnt
    endpoint = free_endpoint()
    with Subscriber("boat1", connect=[endpoint]) as shore:
        with router(endpoint), publisher(endpoint) as boat:
            boat.publish(Topic.MODEL, model_snapshot(model, 1))
            assert shore.wait_for(has_model(1), SOON_S)
        assert shore.wait_for(lambda one: not one.latest("boat1").alive, SOON_S)
        with publisher(endpoint) as boat:
            with router(endpoint):
                boat.publish(Topic.MODEL, model_snapshot(model, 0))
                assert shore.wait_for(has_model(0), SOON_S)
            assert shore.wait_for(lambda one: not one.latest("boat1").alive, SOON_S)
            # Published while nobody can hear it, and not repeated.
            boat.publish(Topic.MODEL, model_snapshot(model, 1))
            with router(endpoint):
                assert shore.wait_for(has_model(1), SOON_S)
                assert shore.wait_for(lambda one: one.latest("boat1").alive, SOON_S)


def test_hostile_bytes_are_counted_and_change_nothing(learnt, caplog):
    model, _ = learnt
    endpoint = free_endpoint()
    good = encode(model_snapshot(model, 3))
    attacks = [
        ("usv/boat1/model", b""),
        ("usv/boat1/model", b"\xff" * 100),
        ("usv/boat1/model", good[: len(good) // 2]),
        ("usv/boat1/plan", b"\x81" * 100_000),
        ("usv/boat1/health", encode(LogBatch(1, 0, 0, 1, (LogNotice("info", "wrong place"),)))),
        ("usv/boat1/nonsense", good),
        ("usv/boat2/model", good),
        ("usv/böat/model", good),
        ("usv/boat1/model", bytes(17 * 2**20)),
    ]
    caplog.set_level(logging.ERROR, logger="autonomy")
    with Subscriber(listen=[endpoint]) as shore, session("client", connect=[endpoint]) as stranger:
        for key, payload in attacks:
            stranger.put(key, payload, congestion_control=BLOCK)
        assert shore.wait_for(lambda one: one.counters.refused == len(attacks), SOON_S)
        assert shore.latest("boat1") == VehicleView("boat1")
        stranger.put("usv/boat1/model", good, congestion_control=BLOCK)
        assert shore.wait_for(has_model(3), SOON_S)
        assert shore.counters.refused == len(attacks)


def test_a_vehicle_of_another_version_is_named_once(caplog):
    endpoint = free_endpoint()
    content = cbor2.loads(encode(health_notice()))
    older = cbor2.dumps({**content, "v": 2})
    with Subscriber(listen=[endpoint]) as shore, session("client", connect=[endpoint]) as stranger:
        for _ in range(5):
            stranger.put("usv/boat1/health", older, congestion_control=BLOCK)
        assert shore.wait_for(lambda one: one.counters.refused == 5, SOON_S)
    (line,) = [record.message for record in caplog.records if "refused" in record.message]
    assert "usv/boat1/health" in line
    assert "must be 3 (got 2): the software on board and ashore must be of the same version" in line


def test_names_from_strangers_do_not_fill_the_memory():
    endpoint = free_endpoint()
    line = encode(LogBatch(1, 0, 0, 1, (LogNotice("info", "hello"),)))
    with Subscriber(listen=[endpoint]) as shore, session("client", connect=[endpoint]) as stranger:
        for number in range(1000):
            stranger.put(f"usv/stranger{number}/log", line, congestion_control=BLOCK)
        assert shore.wait_for(lambda one: one.counters.refused == 1000 - MAXIMUM_VEHICLES, SOON_S)
        assert len(shore.vehicles()) == MAXIMUM_VEHICLES
        with publisher(endpoint):
            assert shore.wait_for(lambda one: one.latest("boat1").alive, SOON_S)
            assert len(shore.vehicles()) == MAXIMUM_VEHICLES


def test_what_was_heard_live_is_not_undone_by_an_older_answer(learnt):
    model, _ = learnt
    seen = []
    shore = Subscriber(connect=["tcp/127.0.0.1:1"], on_update=seen.append)
    older, newer = model_snapshot(model, 1), model_snapshot(model, 2)
    entry = shore._roster.entry("boat1")

    def keep(value, query):
        arrival = Arrival("usv/boat1/model", 0.0, payload=encode(value), query=query)
        shore._keep(entry, Topic.MODEL, value, arrival)

    shore._session.queries = 1
    keep(newer, None)
    keep(older, 1)
    assert shore.latest("boat1").model is newer
    shore._session.queries = 2
    keep(older, 2)
    assert shore.latest("boat1").model is newer
    restarted = replace(older, run=8)
    keep(restarted, 2)
    assert shore.latest("boat1").model is restarted
    keep(restarted, None)
    assert len(seen) == 2


def test_a_vehicle_that_does_not_answer_at_first_is_asked_again():
    """As a router does for it that knows of the vehicle's token already, and not yet that it answers."""
    endpoint = free_endpoint()
    payload = encode(plan_notice(7))

    def answer(query):
        with query:
            query.reply("usv/boat1/plan", payload)

    with (
        Subscriber("boat1", listen=[endpoint]) as shore,
        session("client", connect=[endpoint]) as boat,
        boat.liveliness().declare_token("usv/boat1/alive"),
    ):
        assert shore.wait_for(lambda one: one.latest("boat1").alive, SOON_S)
        assert shore.latest("boat1").plan is None
        with boat.declare_queryable("usv/boat1/*", answer):
            assert shore.wait_for(lambda one: one.latest("boat1").plan == plan_notice(7), SOON_S)


def test_arguments_are_checked():
    for arguments in ({}, {"connect": ["tcp/a:1"], "listen": ["tcp/a:1"]}):
        with pytest.raises(ValueError, match="either connect to a router or listen"):
            Subscriber(**arguments)
    with pytest.raises(ValueError, match="not a vehicle"):
        Subscriber("a/b", connect=["tcp/a:1"])
    for right in ("tcp/127.0.0.1:7447", "tls/shore.example.org:7447#x=y", "quic/[fe80::1]:7447"):
        assert check_endpoint(right) == right
    for wrong in (
        "127.0.0.1:7447",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:70000",
        "tcp:127.0.0.1:7447",
        "",
        "tcp/:1",
    ):
        with pytest.raises(ValueError, match="such as tcp/"):
            check_endpoint(wrong)


def test_a_picture_is_replaced_as_a_whole(learnt, tmp_path):
    model, _ = learnt
    target = tmp_path / "map.png"
    target.write_bytes(b"old")
    view = VehicleView("boat1", model=model_snapshot(model), plan=plan_notice())
    write_map(target, view, [observation(number) for number in range(50)])
    assert target.read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.iterdir()) == [target]
    with pytest.raises(ValueError, match="has not published a model"):
        write_map(target, VehicleView("boat1"), [])
    with pytest.raises(OSError, match="nowhere"):
        write_map(tmp_path / "nowhere" / "map.png", view, [])


@contextlib.contextmanager
def watch(*arguments, **options):
    """The command in a process of its own, which doesn't outlive the test."""
    command = [sys.executable, "-c", WATCH, *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, **options) as child:
        try:
            yield child
        finally:
            child.kill()


def test_watch_prints_a_line_per_snapshot_and_keeps_the_map(learnt, tmp_path):
    model, _ = learnt
    endpoint = free_endpoint()
    target = tmp_path / "map.png"
    watching = watch("--listen", endpoint, "--png", str(target), "--json", "--count", "2")
    with watching as shore, publisher(endpoint) as boat:
        boat.publish(Topic.HEALTH, health_notice())
        boat.publish(Topic.MODEL, model_snapshot(model, 0))
        first = json.loads(shore.stdout.readline())
        boat.publish(Topic.MODEL, model_snapshot(model, 1))
        second = json.loads(shore.stdout.readline())
        assert shore.wait(SOON_S) == 0
    assert (first["sequence"], second["sequence"]) == (0, 1)
    assert first["basis_size"] == len(model)
    assert first["kernel"] == "smooth 1.5 km x 1.2 km"
    (component,) = first["components"]
    assert (component["lengthscales_m"], component["timescale_s"]) == ([1500.0, 1200.0], None)
    assert (first["calibration"]["coverage_95"], first["ahead"]["count"]) == (0.942, 43)
    assert (first["repairs"], first["transform"]) == (0, "none")
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_watch_ends_cleanly_on_a_signal(learnt, number):
    model, _ = learnt
    endpoint = free_endpoint()
    with router(endpoint), publisher(endpoint) as boat, watch("boat1", "--connect", endpoint) as shore:
        boat.publish(Topic.MODEL, model_snapshot(model))
        line = shore.stdout.readline()
        assert "boat1" in line
        assert "samples 400  basis" in line
        assert (
            "smooth 1.5 km x 1.2 km  σn 0.032  95 % intervals held 94 % of 400 readings, 91 % of 43 ahead"
            in line
        )
        os.kill(shore.pid, number)
        assert shore.wait(SOON_S) == 0
        assert shore.stderr.read() == "boat1: connected\n"


def run_watch(*arguments):
    """The command in this process: its exit code."""
    parser = argparse.ArgumentParser(prog="watch")
    watch_cli.add_arguments(parser)
    try:
        return watch_cli.run(parser.parse_args(arguments))
    except SystemExit as stop:
        return stop.code


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--listen", "ENDPOINT", "--timeout", "0.1"], 1, "0 snapshots came in 0.1 s"),
        (["--connect", "ENDPOINT", "--timeout", "0.1", "--count", "3"], 1, "0 of 3 snapshots came"),
        (["--listen", "7447"], 2, "not an address: '7447'"),
        (["--listen", "ENDPOINT", "--connect", "ENDPOINT"], 2, "not allowed with argument"),
        ([], 2, "one of the arguments --listen --connect is required"),
        (["a/b", "--listen", "ENDPOINT"], 2, "must be * or match"),
        (["--listen", "ENDPOINT", "--png", "nowhere/map.png"], 2, "there is no directory"),
        (["--listen", "ENDPOINT", "--count", "0"], 2, "must be a whole number from 1"),
        (["--listen", "ENDPOINT", "--timeout", "soon"], 2, "must be seconds above 0"),
    ],
)
def test_watch_says_what_is_wrong(arguments, code, words, capsys):
    endpoint = free_endpoint()
    assert run_watch(*[endpoint if word == "ENDPOINT" else word for word in arguments]) == code
    assert words in capsys.readouterr().err


def test_watch_says_that_the_address_is_taken(capsys):
    endpoint = free_endpoint()
    with router(endpoint):
        assert run_watch("--listen", endpoint) == 1
    assert f"cannot listen at {endpoint}" in capsys.readouterr().err


def test_text_from_the_network_does_not_steer_the_terminal():
    endpoint = free_endpoint()
    with publisher(endpoint) as boat, watch("--listen", endpoint) as shore:
        boat.publish(Topic.LOG, LogNotice("error", "\x1b[2Jsunk\n"))
        assert {shore.stderr.readline() for _ in range(2)} == {
            "boat1: connected\n",
            "boat1: error: \ufffd[2Jsunk\ufffd\n",
        }


def test_watch_needs_matplotlib_for_pictures_only(tmp_path):
    (tmp_path / "matplotlib.py").write_text("raise ModuleNotFoundError('none here', name='matplotlib')")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    endpoint = free_endpoint()
    with watch("--listen", endpoint, "--png", "map.png", cwd=tmp_path, env=environment) as shore:
        assert shore.wait(SOON_S) == 2
        assert "pip install 'halocline[shore]'" in shore.stderr.read()
    with watch("--connect", endpoint, "--timeout", "0.1", cwd=tmp_path, env=environment) as shore:
        assert shore.wait(SOON_S) == 1
        assert "matplotlib" not in shore.stderr.read()


def test_presence_is_told():
    endpoint = free_endpoint()
    updates = queue.Queue()
    with Subscriber("boat1", listen=[endpoint], on_update=updates.put):
        with publisher(endpoint):
            assert updates.get(timeout=SOON_S).value == Presence(True)
        assert updates.get(timeout=SOON_S).value == Presence(False)


def test_models_of_a_second_vehicle_are_kept_apart(learnt):
    model, _ = learnt
    endpoint = free_endpoint()
    with (
        Subscriber(listen=[endpoint]) as shore,
        publisher(endpoint) as one,
        publisher(endpoint, "boat2") as two,
    ):
        one.publish(Topic.MODEL, model_snapshot(model, 1))
        two.publish(Topic.MODEL, model_snapshot(model, 2, "boat2"))
        assert shore.wait_for(has_model(1), SOON_S)
        assert shore.wait_for(has_model(2, "boat2"), SOON_S)
        assert isinstance(shore.latest("boat1").model, ModelSnapshot)
