"""`autonomy bridge` as a process: a real port that is plugged and unplugged, a real socket, and a real survey.

HALOCLINE_BRIDGE_S: for how long lines come at 20 Hz, in all; without it for twelve seconds. With HALOCLINE_FIRST_DAY
the desk of docs/bridge.md goes on to preflight and a survey; without, to the bridge that sends.
"""

import contextlib
import itertools
import json
import os
import pty
import random
import re
import shlex
import socket
import sys
import threading
import time
import tty
from pathlib import Path
from typing import Any

import pytest
import yaml
from pymavlink.dialects.v20 import ardupilotmega as mavlink

sys.path.insert(0, str(Path(__file__).parent))
from processes import Processes, Running, free_port, wait_until

from autonomy.mavlink.codec import Codec

pytestmark = pytest.mark.process

LASTS_S = float(os.environ.get("HALOCLINE_BRIDGE_S", "12"))
DOCS = Path(__file__).parents[2] / "docs"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PORTS = re.compile("14560|14551|4001")
PLUGGED = 3
RATE_HZ = 20.0
_BAUD = 115200


class Port:
    """A serial port under a name that stays, with a plug."""

    def __init__(self, folder: Path) -> None:
        self.name = folder / "ttyPROBE"
        self._master: int | None = None
        self._slave: int | None = None

    def plug(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        assert self._master is not None
        assert self._slave is not None
        self.name.unlink()
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = None

    def write(self, data: bytes) -> None:
        assert self._master is not None
        with contextlib.suppress(BlockingIOError):  # nobody has opened it yet
            os.write(self._master, data)


class Vehicle:
    """An autopilot on UDP that only tells the time, four times a second, and notes what it hears."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.05)
        self._codec = Codec(1, 1)
        self._booted = time.monotonic() - 100.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._work)
        self.port = self._socket.getsockname()[1]
        self.readings: list[tuple[float, int]] = []
        """Value and `time_boot_ms`, as they came."""
        self.texts: list[str] = []

    def __enter__(self) -> "Vehicle":
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._done.set()
        self._thread.join()
        self._socket.close()

    def _work(self) -> None:
        peer: Any = None
        due = 0.0
        while not self._done.is_set():
            with contextlib.suppress(TimeoutError):
                data, peer = self._socket.recvfrom(65536)
                for message in self._codec.decode(data, peer):
                    self._hear(message)
            now = time.monotonic()
            if peer is not None and now >= due:
                due = now + 0.25
                stamp_ms = round(1000 * (now - self._booted))
                for message in (
                    mavlink.MAVLink_heartbeat_message(11, 3, 81, 0, 4, 3),
                    mavlink.MAVLink_system_time_message(0, stamp_ms),
                ):
                    self._socket.sendto(self._codec.encode(message), peer)

    def _hear(self, message: Any) -> None:
        assert message.get_srcSystem() in (1,)
        if message.get_type() == "NAMED_VALUE_FLOAT":
            self.readings.append((message.value, message.time_boot_ms))
        elif message.get_type() == "STATUSTEXT":
            self.texts.append(message.text)


def bridge_file(folder: Path, port: Port, endpoint: str, **sections: dict[str, Any]) -> Path:
    settings: dict[str, Any] = {
        "instrument": {"name": "probe", "endpoint": f"serial:{port.name}:{_BAUD}", "silence_s": 2},
        "line": {"columns": 3},
        "values": {"SALT": {"field": 2}},
        "mavlink": {"endpoint": endpoint},
        **sections,
    }
    file = folder / "bridge.yaml"
    file.write_text(yaml.safe_dump(settings), encoding="utf-8")
    return file


def bridge(processes: Processes, file: Path, *options: str) -> Running:
    return processes.start("-m", "autonomy", "bridge", str(file), *options)


def noise(rng: random.Random) -> bytes:
    """What gets on a line: bytes of any kind, without a whole line of three columns with a number in the second."""
    match rng.randrange(4):
        case 0:
            return bytes(rng.randrange(256) for _ in range(rng.randrange(40))).replace(b",", b"#") + b"\n"
        case 1:
            return b"#, 7" + b"\n"
        case 2:
            return b"#, seven, #\r\n"
    return b"x" * 3000 + b"\n"


def test_at_twenty_hertz_nothing_is_lost_or_doubled(tmp_path: Path) -> None:
    """Every line between two plugs gives one reading, in order, later than the one before; nothing else gives any."""
    rng, port = random.Random(5), Port(tmp_path)
    expected: list[float] = []

    def find_each_other(vehicle: Vehicle) -> None:
        """Below zero are readings that may or may not be heard: nobody listened from the beginning."""
        known = len(vehicle.readings)
        wait_until(
            lambda: port.write(b"#, -1, #\n") or time.sleep(0.05) or len(vehicle.readings) > known,
            what="the first reading after plugging in",
        )

    with Processes() as processes, Vehicle() as vehicle:
        running = bridge(processes, bridge_file(tmp_path, port, f"udpout:127.0.0.1:{vehicle.port}"))
        for _ in range(PLUGGED):
            port.plug()
            port.write(b"6, #\n")  # the rest of what was cut off
            find_each_other(vehicle)
            begun = time.monotonic()
            for k in range(round(LASTS_S * RATE_HZ / PLUGGED)):
                line = f"#, {len(expected)}, #\r\n".encode()
                expected.append(float(len(expected)))
                cut = rng.randrange(len(line))
                port.write((noise(rng) if rng.random() < 0.3 else b"") + line[:cut])
                port.write(line[cut:])
                time.sleep(max(0.0, begun + (k + 1) / RATE_HZ - time.monotonic()))
            wait_until(lambda: vehicle.readings[-1][0] == expected[-1], what="the last reading")
            port.write(b"#, 123456")  # half a line
            port.unplug()
        assert running.stop() == 0
    assert [value for value, _ in vehicle.readings if value >= 0.0] == expected
    stamps = [stamp for _, stamp in vehicle.readings]
    assert all(before < after for before, after in itertools.pairwise(stamps))
    assert "Traceback" not in running.said
    assert running.said.count("can't read") <= 3 + LASTS_S / 20.0  # once a minute, of hundreds
    assert "probe: sending" in vehicle.texts


def test_what_was_recorded_is_sent_again(tmp_path: Path) -> None:
    """Once the vehicle's clock is known: nothing is played to nobody."""
    raw = tmp_path / "raw.ndjson"
    lines = [{"host_s": 7.0 + 0.1 * k, "line": f"#, {k}, #"} for k in range(15)]
    raw.write_text("".join(json.dumps(each) + "\n" for each in [{"bridge": "0.1"}, *lines]))
    with Processes() as processes, Vehicle() as vehicle:
        file = bridge_file(tmp_path, Port(tmp_path), f"udpout:127.0.0.1:{vehicle.port}")
        running = bridge(processes, file, "--replay", str(raw))
        assert running.wait() == 0
        wait_until(lambda: len(vehicle.readings) == 15, what="all of it")
    assert [value for value, _ in vehicle.readings] == [float(k) for k in range(15)]
    steps = [after - before for (_, before), (_, after) in itertools.pairwise(vehicle.readings)]
    assert sum(steps) >= 1300  # milliseconds: at its own pace, or later on a busy machine


def test_the_desk_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """docs/bridge.md, typed as it stands there, on free ports: from lines of text to a survey that learns from them."""
    page = (DOCS / "bridge.md").read_text().partition("## At the desk")[2].partition("\n## ")[0]
    typed = [body.strip() for kind, body in FENCE.findall(page) if not kind for body in body.splitlines()]
    quoted = [body.splitlines() for kind, body in FENCE.findall(page) if kind]
    ports = {port: str(free_port()) for port in ("14560", "14551", "4001")}

    def words(line: str) -> list[str]:
        return ["-m", *shlex.split(PORTS.sub(lambda found: ports[found[0]], line))]

    for name in ("desk", "survey"):
        text = (DOCS / "bridge" / f"{name}.yaml").read_text()
        (tmp_path / "docs" / "bridge").mkdir(parents=True, exist_ok=True)
        (tmp_path / "docs" / "bridge" / f"{name}.yaml").write_text(
            PORTS.sub(lambda found: ports[found[0]], text)
        )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    sail, check, carry, preflight, survey = typed
    with Processes() as processes:
        processes.start(*words(sail)).wait_for("ready on")
        checked = processes.start(*words(check))
        assert checked.wait() == 0
        assert quoted[0][-1] in checked.said
        assert "SALT = 33." in checked.said
        bridge = processes.start(*words(carry))
        for line in quoted[1]:
            bridge.wait_for(PORTS.sub(lambda found: ports[found[0]], line))
        if not os.environ.get("HALOCLINE_FIRST_DAY"):
            return
        looked = processes.start(*words(preflight), "--seconds", "5")
        looked.wait()
        service = processes.start(*words(survey))
        for line in quoted[2][1:]:
            service.wait_for(line)
        assert quoted[2][0] in looked.said
        assert not re.search(r"sensor\.clock|FAIL sensor", looked.said)
        service.wait_for("re-estimated", within_s=240.0)
        assert service.stop() == 0
        assert bridge.stop() == 0
    for each in (bridge, service, checked, looked):
        assert "Traceback" not in each.said
