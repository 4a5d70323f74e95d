"""`autonomy shore serve` as a process: what it shows, what it keeps, how it ends, and what does not disturb it."""

import argparse
import asyncio
import json
import os
import re
import signal
import sys
import urllib.error
import urllib.request
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pytest
from aiohttp import ClientSession

from autonomy.effects import Topic
from autonomy.shore import serve_cli
from autonomy.shore.recording import Recorder, is_recording, read_recording
from autonomy.wire import LogNotice, decode

sys.path.insert(0, str(Path(__file__).parent))
from processes import SOON_S, Processes, free_port, wait_until
from shore_helpers import (
    free_endpoint,
    health_notice,
    learnt_model,
    model_snapshot,
    observation,
    plan_notice,
    publisher,
    session,
    survey_notice,
)

pytestmark = pytest.mark.process

FLEET = os.environ.get("HALOCLINE_FLEET")


@pytest.fixture(scope="module")
def learnt():
    return learnt_model()[0]


class Server:
    """`autonomy shore serve`, ready."""

    def __init__(self, processes, *options, endpoint=None):
        self.endpoint = endpoint or free_endpoint()
        words = ("--listen", self.endpoint, "--http", "127.0.0.1:0", *map(str, options))
        self.process = processes.start("-m", "autonomy", "shore", "serve", *words)
        self.process.wait_for("/\n")
        self.port = int(re.search(r"the page is at http://127\.0\.0\.1:(\d+)/", self.process.said)[1])

    def get(self, path):
        """A body, or None where there is none of that name (yet)."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=SOON_S) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            if error.code in (404, 503):
                return None
            raise

    def json(self, path):
        """The same, read."""
        body = self.get(path)
        return None if body is None else json.loads(body)


@pytest.fixture(scope="module")
def server():
    """One for all tests that leave it as it was."""
    with Processes() as processes:
        started = Server(processes)
        yield started
        assert started.process.stop() == 0
        assert "Traceback" not in started.process.said


def options_of(*words):
    parser = argparse.ArgumentParser(prog="serve")
    serve_cli.add_arguments(parser)
    return parser.parse_args(words)


def publish_all(boat, model, sequence=1, vehicle="boat1"):
    boat.publish(Topic.MODEL, model_snapshot(model, sequence, vehicle))
    boat.publish(Topic.SURVEY, survey_notice())
    boat.publish(Topic.PLAN, plan_notice(sequence))
    boat.publish(Topic.HEALTH, health_notice(f"number {sequence}"))
    boat.publish(Topic.OBSERVATIONS, (observation(2 * sequence - 2), observation(2 * sequence - 1)))
    boat.publish(Topic.LOG, LogNotice("info", f"line {sequence}"))


def sequence_of(latest):
    return latest is not None and latest["model"] is not None and latest["model"]["sequence"]


def is_whole(latest):
    """Whether everything that `publish_all` says has come."""
    names = ("model", "plan", "health", "log")
    return latest is not None and all(latest[name] for name in names) and len(latest["track"]) == 2


def test_what_a_vehicle_publishes_is_on_the_page(server, learnt):
    async def follow(server, boat):
        async with (
            ClientSession(f"http://127.0.0.1:{server.port}") as client,
            client.ws_connect("/api/live?vehicles=boat1") as socket,
        ):
            boat.publish(Topic.MODEL, model_snapshot(learnt, 9))
            while True:
                news = await socket.receive_json()
                if news["type"] == "model" and news["data"]["sequence"] == 9:
                    return

    with publisher(server.endpoint) as boat:
        publish_all(boat, learnt)
        wait_until(lambda: is_whole(server.json("/api/vehicle/boat1")))
        latest = server.json("/api/vehicle/boat1")
        assert (latest["alive"], sequence_of(latest)) == (True, 1)
        assert latest["survey"]["name"] == "off Point Conception"
        assert latest["log"][-1]["text"] == "line 1"
        body = server.get("/api/vehicle/boat1/map?rows=30&columns=40")
        mean = np.frombuffer(body, dtype="<f4")[:1200]
        assert 32.0 < np.nanmin(mean) < np.nanmax(mean) < 34.0
        asyncio.run(asyncio.wait_for(follow(server, boat), SOON_S))
    wait_until(lambda: not server.json("/api/vehicle/boat1")["alive"])
    assert b"<html" in server.get("/")


def test_what_was_recorded_is_there_after_a_restart(learnt, tmp_path):
    folder = tmp_path / "kept"
    with Processes() as processes:
        server = Server(processes, "--record", folder)
        with publisher(server.endpoint) as boat:
            for sequence in (1, 2, 3):
                publish_all(boat, learnt, sequence)
                wait_until(lambda wanted=sequence: sequence_of(server.json("/api/vehicle/boat1")) == wanted)
            wait_until(lambda: len(server.json("/api/vehicle/boat1")["track"]) == 6)
            recording = server.json("/api/server")["recording"]
            assert (recording["recorded"] > 10, recording["lost"], recording["trouble"]) == (True, 0, "")
        assert server.process.stop(signal.SIGINT) == 0
        again = Server(processes, "--record", folder)
        latest = again.json("/api/vehicle/boat1")
        assert (latest["alive"], sequence_of(latest)) == (False, 3)
        assert [row[0] for row in latest["track"]] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
        assert [line["text"] for line in latest["log"]][-3:] == ["line 1", "line 2", "line 3"]
        stops = again.json("/api/vehicle/boat1/history")["models"]
        assert stops == [1.7e9 + 1, 1.7e9 + 2, 1.7e9 + 3]
        assert again.get(f"/api/vehicle/boat1/map?rows=5&columns=5&at={stops[0]}") is not None
        assert again.process.stop() == 0


def test_a_vehicle_that_is_still_there_after_a_restart_tells_nothing_twice(learnt, tmp_path):
    def told(server):
        latest = server.json("/api/vehicle/boat1")
        return latest and ([row[0] for row in latest["track"]], [line["text"] for line in latest["log"]])

    def all_of(count):
        return [float(number) for number in range(2 * count)], [
            f"line {number + 1}" for number in range(count)
        ]

    with Processes() as processes:
        options = ("--record", tmp_path / "kept")
        server = Server(processes, *options)
        with publisher(server.endpoint) as boat:
            for sequence in (1, 2, 3):
                publish_all(boat, learnt, sequence)
            wait_until(lambda: told(server) == all_of(3), what="all is told once")
            assert server.process.stop() == 0
            # Nobody hears this as it is told.
            publish_all(boat, learnt, 4)
            again = Server(processes, *options, endpoint=server.endpoint)
            publish_all(boat, learnt, 5)
            wait_until(lambda: told(again) == all_of(5), what="all is told once")
            assert again.process.stop() == 0


def test_a_recording_has_all_that_was_told_before_the_server_was_there(learnt, tmp_path):
    def lines():
        found = [one for one in read_recording(tmp_path) if one.topic == "log"]
        return [line.text for one in found for line in decode(Topic.LOG, one.payload).items]

    endpoint = free_endpoint()
    with Processes() as processes, publisher(endpoint) as boat:
        # More than a page shows.
        wanted = [f"line {number}" for number in range(500)]
        for text in wanted:
            boat.publish(Topic.LOG, LogNotice("info", text))
        boat.publish(Topic.HEALTH, health_notice())
        server = Server(processes, "--record", tmp_path, endpoint=endpoint)
        wait_until(lambda: is_recording(tmp_path) and lines() == wanted, what="all lines are recorded")
        assert server.process.stop() == 0


def test_hostile_bytes_on_every_key_change_nothing(server, learnt):
    rng = np.random.default_rng(5)
    before = server.json("/api/server")["refused"]
    with (
        publisher(server.endpoint, "boat2") as boat,
        session("client", connect=[server.endpoint]) as stranger,
    ):
        publish_all(boat, learnt, 1, "boat2")
        wait_until(lambda: sequence_of(server.json("/api/vehicle/boat2")) == 1)
        for number in range(400):
            name = f"ghost{number}" if number % 2 else "boat2"
            for topic in Topic:
                stranger.put(f"usv/{name}/{topic.value}", rng.bytes(int(rng.integers(0, 2000))))
        wait_until(lambda: server.json("/api/server")["refused"] > before + 500)
        assert server.json("/api/server")["vehicles"] <= 256
        publish_all(boat, learnt, 4, "boat2")
        wait_until(lambda: sequence_of(server.json("/api/vehicle/boat2")) == 4)


def test_an_address_that_is_taken_ends_it(server, capsys):
    http = f"127.0.0.1:{server.port}"
    assert serve_cli.run(options_of("--listen", free_endpoint(), "--http", http)) == 1
    assert f"cannot listen at {http}: " in (said := capsys.readouterr().err)
    assert "--http" in said
    other = f"127.0.0.1:{free_port()}"
    assert serve_cli.run(options_of("--listen", server.endpoint, "--http", other)) == 1
    assert "cannot listen at tcp/" in capsys.readouterr().err


@pytest.mark.parametrize("missing", ["aiohttp", "matplotlib", "cmocean"])
def test_without_the_extra_it_says_what_to_install(monkeypatch, capsys, missing):
    def nowhere(name):
        raise PackageNotFoundError(name)

    for name in [name for name in sys.modules if name.startswith("autonomy.shore.server")]:
        monkeypatch.delitem(sys.modules, name)
    if missing == "cmocean":
        monkeypatch.setattr("importlib.metadata.distribution", nowhere)
    else:
        monkeypatch.setitem(sys.modules, missing, None)
    assert serve_cli.run(options_of("--listen", "tcp/127.0.0.1:7447")) == 2
    assert (
        capsys.readouterr().err == f"autonomy shore serve: needs {missing}: pip install 'halocline[shore]'\n"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--http", "0.0.0.0:8080"), "others can reach it; ask them for a --token"),
        (("--http", "192.0.2.1:8080"), "others can reach it"),
        (("--http", "[::]:8080"), "others can reach it"),
        (("--token", "/nowhere/token"), "--token: no readable file '/nowhere/token'"),
        (("--key", "/nowhere/key"), "--certificate and --key belong together"),
    ],
)
def test_usage_that_cannot_be_meant(capsys, words, said):
    assert serve_cli.run(options_of("--listen", "tcp/127.0.0.1:7447", *words)) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("address", ["8080", "localhost", "localhost:99999", "a b:1", "http://x:1", "::1:80"])
def test_an_address_for_browsers_is_a_host_and_a_port(capsys, address):
    with pytest.raises(SystemExit, match="2"):
        options_of("--listen", "tcp/127.0.0.1:7447", "--http", address)
    assert "must be HOST:PORT" in capsys.readouterr().err


def test_a_folder_without_a_recording_is_said(tmp_path, capsys):
    http = f"127.0.0.1:{free_port()}"
    words = ("--listen", free_endpoint(), "--http", http, "--history", str(tmp_path))
    assert serve_cli.run(options_of(*words)) == 1
    assert "holds no recording" in capsys.readouterr().err


def test_a_folder_that_another_records_in_is_said(tmp_path, capsys):
    with Recorder(tmp_path):
        words = ("--listen", free_endpoint(), "--http", "127.0.0.1:0", "--record", str(tmp_path))
        assert serve_cli.run(options_of(*words)) == 1
    assert capsys.readouterr().err == f"autonomy shore serve: another process records in {tmp_path}\n"


def test_one_process_follows_a_fleet():
    """Ten vessels for a few seconds; as many as HALOCLINE_FLEET says for two minutes."""
    vessels, seconds = (10, 4) if FLEET is None else (int(FLEET), 120)
    names = [f"boat{number:03d}" for number in range(vessels)]
    with Processes() as processes:
        server = Server(processes)
        sea = Path(__file__).parent / "fleet_of_publishers.py"
        processes.start(str(sea), server.endpoint, str(vessels)).wait_for("at sea")
        for name in names:
            wait_until(lambda name=name: has_sailed(server, name, seconds), SOON_S + 2 * seconds, name)
        state = server.json("/api/server")
        tracks = [server.json(f"/api/vehicle/{name}")["track"] for name in names]
        if FLEET is not None:
            print(f"\n{vessels} vessels, {seconds} s: {state}")
            assert state["lag_s"] < 1.0
        assert (state["vehicles"], state["refused"], state["dropped"]) == (vessels, 0, 0)
        assert state["memory_mb"] < 500.0
        for track in tracks:
            # A reading a second, none lost, none twice.
            assert [row[0] for row in track] == list(range(len(track)))
        assert server.process.stop() == 0


def has_sailed(server, name, seconds):
    """Whether a vessel has a map, a survey, and as many readings as seconds have gone by."""
    latest = server.json(f"/api/vehicle/{name}")
    return latest is not None and latest["model"] and latest["alive"] and len(latest["track"]) >= seconds
