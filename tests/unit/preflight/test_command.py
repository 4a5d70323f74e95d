"""`autonomy preflight` over real sockets: what it prints, how it ends, and faults that only sockets and disks have."""

import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh

from autonomy.cli import main
from autonomy.commands.preflight import _table
from autonomy.config import Configuration
from autonomy.endpoints import session_settings
from autonomy.preflight.finding import Grade, failed, passed, skipped
from autonomy.preflight.surroundings import folders
from autonomy.zenoh_session import zenoh_config

sys.path.insert(0, str(Path(__file__).parent))
from pier import autopilot, settings
from quay import served


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp, socket.socket() as tcp:
        udp.bind(("127.0.0.1", 0))
        tcp.bind(("127.0.0.1", udp.getsockname()[1]))
        return int(udp.getsockname()[1])


def of(check: str, found: list[dict[str, str]]) -> dict[str, str]:
    """The one finding of a check."""
    (one,) = [each for each in found if each["check"] == check]
    return one


@pytest.fixture
def router() -> Iterator[str]:
    locator = f"tcp/127.0.0.1:{free_port()}"
    with zenoh.open(zenoh_config(session_settings("router", listen=[locator]))):
        yield locator


@pytest.fixture
def preflight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Runs it with some keys changed; returns exit code and findings."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)

    def run(seconds: float, **changed: Any) -> tuple[int, list[dict[str, str]]]:
        tree = settings(tmp_path)
        tree["survey"]["land"] = "land.geojson"
        tree["shore"] = {"connect": []}
        tree["mavlink"] = {"system_id": None}
        tree["journal"] = {"total_mb": 100.0}
        for key, value in changed.items():
            section, _, name = key.partition("__")
            tree.setdefault(section, {})[name] = value
        tree["survey"]["area"] = [list(corner) for corner in tree["survey"]["area"]]
        file = tmp_path / "boat.yaml"
        file.write_text(yaml.safe_dump(tree))
        code = main(["preflight", "--config", str(file), "--seconds", str(seconds), "--json"])
        told = json.loads(capsys.readouterr().out)
        assert told["ready"] is (code == 0)
        return code, told["findings"]

    return run


def test_a_boat_that_may_leave_and_a_router_that_does_not_answer(preflight: Any, router: str) -> None:
    gone = f"tcp/127.0.0.1:{free_port()}"
    with served(autopilot(start_utc_s=time.time())) as port:
        code, found = preflight(
            4, mavlink__endpoint=f"udpout:127.0.0.1:{port}", shore__connect=[router, gone]
        )
    answers = [each for each in found if each["check"] == "shore.router"]
    assert answers[0]["says"] == f"{router} answers"
    assert answers[1]["says"].startswith(f"{gone}: no session can be opened: ")
    assert " at /" not in answers[1]["says"]
    assert [each for each in found if each["grade"] != "pass"] == answers[1:]
    assert code == 0
    said = {each["check"]: each["says"] for each in found}
    assert said["safeguards.read"] == "a fence of 1 zone and 1 rally point on board"
    assert said["autopilot.firmware"] == "ArduPilot Rover 4.7.0"


def test_a_probe_by_another_name(preflight: Any) -> None:
    with served(autopilot({"name": "COND"}, start_utc_s=time.time())) as port:
        code, found = preflight(2, mavlink__endpoint=f"udpout:127.0.0.1:{port}")
    assert code == 1
    assert of("sensor.name", found)["remedy"] == "if one of these is it, set sensor.message_name: COND"


def test_a_port_that_is_taken(preflight: Any) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        code, found = preflight(1, mavlink__endpoint=f"udpin:127.0.0.1:{other.getsockname()[1]}")
    assert code == 1
    assert "ddress already in use" in of("link.open", found)["says"]
    assert "stop the service" in of("link.open", found)["remedy"]
    assert of("autopilot", found)["grade"] == "skip"


def test_a_serial_port_that_is_not_there(preflight: Any, tmp_path: Path) -> None:
    code, found = preflight(1, mavlink__endpoint=f"serial:{tmp_path}/ttyACM0:115200")
    assert code == 1
    assert "/dev/serial/by-id" in of("link.open", found)["remedy"]


def test_bytes_that_are_no_mavlink(preflight: Any) -> None:
    port = free_port()
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", port))
        listening.listen()
        listening.settimeout(30.0)

        def babble() -> None:
            client, _ = listening.accept()
            with client:
                client.sendall(b"\x00\x55" * 500)
                client.recv(1)

        thread = threading.Thread(target=babble)
        thread.start()
        code, found = preflight(1, mavlink__endpoint=f"tcp:127.0.0.1:{port}")
        thread.join()
    assert code == 1
    assert of("link.vehicle", found)["says"] == "1000 bytes came in, and none of it is MAVLink"
    assert "baud rate" in of("link.vehicle", found)["remedy"]


def test_a_configuration_that_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "boat.yaml").write_text("survey: {area: 3}")
    assert main(["preflight", "--config", str(tmp_path / "boat.yaml")]) == 78
    assert "survey.area" in capsys.readouterr().err


def test_folders_that_can_and_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    tree = settings(tmp_path) | {"journal": {"directory": tmp_path / "file" / "journal"}}
    configuration = Configuration.model_validate(tree)
    journal, checkpoint = folders(configuration, {"STATE_DIRECTORY": str(tmp_path)})
    assert "file is no folder" in journal.trouble
    assert (checkpoint.trouble, checkpoint.path) == ("", tmp_path / "checkpoint")
    assert checkpoint.free_mb > 0.0
    assert not checkpoint.path.exists()
    (nowhere,) = folders(configuration.model_copy(update={"journal": configuration.journal.model_copy(
        update={"enabled": False})}), {})  # fmt: skip
    assert "HOME says where to keep" in nowhere.trouble


def test_the_table() -> None:
    lines = list(
        _table([passed("link.open", "open"), failed("sensor.name", "not " * 40, "do"), skipped("a.b", "so")])
    )
    assert lines[0] == f"pass {'link.open':26} open"
    assert lines[1].startswith("FAIL sensor.name ")
    assert all(len(line) <= 110 for line in lines)
    assert any(line.strip() == "→ do" for line in lines)
    assert lines[-1] == "1 pass, 1 fail, 1 skip: do not sail yet"
    assert Grade.SKIP.value == "skip"
