"""`autonomy shore record` in a process of its own: what a vehicle tells is kept, whatever happens to the recorder."""

import json
import signal
import socket
import sys
from pathlib import Path

import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from processes import Processes, Running, wait_until
from shore_helpers import (
    free_endpoint,
    health_notice,
    learnt_model,
    model_snapshot,
    observation,
    plan_notice,
    publisher,
    survey_notice,
)

from autonomy import cli
from autonomy.effects import Topic
from autonomy.shore.recording import Recorder, read_recording
from autonomy.wire import LogNotice

pytestmark = pytest.mark.process


def topics(folder: Path) -> set[str]:
    return {one.topic for one in read_recording(folder)} if list(folder.glob("*.recording")) else set()


def test_a_survey_is_whole_although_the_recorder_was_killed(tmp_path: Path) -> None:
    folder, endpoint = tmp_path / "recording", free_endpoint()
    words = ("-m", "autonomy", "shore", "record", str(folder), "--listen", endpoint)
    model, _ = learnt_model()
    with Processes() as processes, publisher(endpoint) as boat:

        def tell(first: int, last: int) -> None:
            boat.publish(Topic.HEALTH, health_notice(str(first)))
            for i in range(first, last):
                boat.publish(Topic.OBSERVATIONS, (observation(i),))
            boat.publish(Topic.LOG, LogNotice("info", f"from {first}", 1.7e9 + first))
            boat.publish(Topic.MODEL, model_snapshot(model, last))

        recorder: Running = processes.start(*words)
        recorder.wait_for("recording in")
        boat.publish(Topic.SURVEY, survey_notice())
        boat.publish(Topic.PLAN, plan_notice())
        tell(0, 50)
        wanted = {"health", "observations", "log", "model", "survey", "plan"}
        recorder.wait_until(lambda: topics(folder) >= wanted, what="one of each in the recording")
        recorder.send(signal.SIGKILL)
        recorder.wait()
        tell(50, 100)
        recorder = processes.start(*words)
        recorder.wait_for("recording in")
        tell(100, 150)

        def last_reading() -> bool:
            said = {one.payload for one in read_recording(folder) if one.topic == "log"}
            return any(b"from 100" in payload for payload in said) and exported(folder, tmp_path) == 150

        wait_until(last_reading, what="everything in the recording")
        assert recorder.stop() == 0
        assert "records" in recorder.said
    table = pd.read_csv(tmp_path / "a.csv")
    assert table.iloc[:, 3].tolist() == [observation(i).value for i in range(150)]
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert [each["properties"]["kind"] for each in features].count("spot") == 2


def exported(folder: Path, to: Path) -> int:
    """How many readings the recording has."""
    words = ["--csv", str(to / "a.csv"), "--geojson", str(to / "a.geojson"), "--force"]
    assert cli.main(["export", str(folder), *words]) == 0
    return len(pd.read_csv(to / "a.csv"))


def test_a_folder_that_somebody_records_in_and_a_taken_address_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Recorder(tmp_path / "a"), socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        for name, why in (("a", "another process records in"), ("b", "cannot listen at")):
            assert cli.main(["shore", "record", str(tmp_path / name), "--listen", endpoint]) == 1
            assert why in capsys.readouterr().err


def test_limits_that_contradict_each_other_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--listen", "tcp/127.0.0.1:1", "--file-mb", "10", "--total-mb", "5")
    assert cli.main(["shore", "record", str(tmp_path), *words]) == 2
    assert "--file-mb must be at most --total-mb" in capsys.readouterr().err
