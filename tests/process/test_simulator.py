"""`sim vessel` as a process: endpoints, clients, the clock, MAVSDK as a ground station nobody here wrote."""

import asyncio
import contextlib
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionItem, MissionRawAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

pytestmark = pytest.mark.process
UDP, TCP = "udpin:127.0.0.1:0", "tcp:127.0.0.1:0"
START = (33.98, -118.795)
DEADLINE_S = 60.0


@dataclass
class Vessel:
    process: subprocess.Popen[str]
    ports: list[int]


@contextlib.contextmanager
def vessel(*options: str, listen: tuple[str, ...] = (UDP, TCP)) -> Iterator[Vessel]:
    """A vessel of its own; its ports in the order of `listen`."""
    words = [sys.executable, "-m", "sim", "vessel", f"--start={START[0]},{START[1]}", *options]
    for endpoint in listen:
        words += ["--listen", endpoint]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("sim vessel: ready on "), line
        yield Vessel(process, [int(port) for port in re.findall(r":\d+\.\d+\.\d+\.\d+:(\d+)", line)])
    finally:
        process.terminate()
        code = process.wait(DEADLINE_S)
        assert process.stdout is not None
        process.stdout.close()
        assert code == 0


class Client:
    """A MAVLink client of a few lines, over UDP or TCP."""

    def __init__(self, kind: str, port: int, system: int = 255, receive_bytes: int = 1 << 20) -> None:
        tcp = kind == "tcp"
        self.socket = socket.socket(type=socket.SOCK_STREAM if tcp else socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
        self.socket.connect(("127.0.0.1", port))
        self.parser = mav.MAVLink(None)
        self.parser.robust_parsing = True
        self.packer = mav.MAVLink(None, system, 190)
        self.pending: list[Any] = []

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *failure: object) -> None:
        self.socket.close()

    def send(self, message: Any) -> None:
        self.socket.send(message.pack(self.packer))

    def wait_for(self, kind: str, where=lambda message: True) -> Any:
        """The next message of a kind that satisfies `where`."""
        deadline = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline:
            while self.pending:
                message = self.pending.pop(0)
                if message.get_type() == kind and where(message):
                    return message
            self.socket.settimeout(max(0.01, deadline - time.monotonic()))
            self.pending += self.parser.parse_buffer(self.socket.recv(65536)) or []
        raise AssertionError(f"no {kind} within {DEADLINE_S} s")


def heartbeat() -> Any:
    return mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def test_udp_and_tcp_clients_are_served_at_once():
    with (
        vessel() as boat,
        Client("udp", boat.ports[0]) as one,
        Client("udp", boat.ports[0], 254) as two,
        Client("tcp", boat.ports[1], 253) as three,
    ):
        for client in (one, two, three):
            client.send(heartbeat())
        for client in (one, two, three):
            beat = client.wait_for("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
            assert (beat.type, beat.autopilot) == (11, 3)
            client.send(mav.MAVLink_param_request_read_message(1, 1, b"WP_RADIUS", -1))
            assert client.wait_for("PARAM_VALUE").param_value == 2.0
        # Each hears of the others, as on a real boat.
        one.send(heartbeat())
        assert three.wait_for("HEARTBEAT", lambda message: message.get_srcSystem() == 255)


def test_a_pymavlink_ground_station_connects():
    with vessel() as boat:
        link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{boat.ports[1]}", source_system=255)
        try:
            assert link.wait_heartbeat(timeout=DEADLINE_S) is not None
            assert link.target_system == 1
            link.set_mode("HOLD")
            ack = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=DEADLINE_S)
            assert ack.result == 0
            link.arducopter_arm()
            link.motors_armed_wait()
        finally:
            link.close()


def test_it_speaks_unprompted_to_a_udp_peer():
    with socket.socket(type=socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(DEADLINE_S)
        port = ground.getsockname()[1]
        with vessel(listen=(f"udpout:127.0.0.1:{port}",)) as boat:
            assert boat.ports == [port]
            parser = mav.MAVLink(None)
            kinds: set[str] = set()
            while "HEARTBEAT" not in kinds:
                kinds |= {each.get_type() for each in parser.parse_buffer(ground.recv(65536)) or ()}


def test_the_clock_runs_at_the_speed_up_and_every_reading_arrives():
    speedup = 500.0
    with (
        vessel("--speedup", f"{speedup}", "--sensor-name", "TEMP", "--noise", "0.01") as boat,
        # Of datagrams the kernel drops what a busy test fetches too late.
        Client("tcp", boat.ports[1]) as client,
    ):
        client.send(heartbeat())
        first = client.wait_for("NAMED_VALUE_FLOAT")
        assert first.name == "TEMP"
        before = first.time_boot_ms
        for _ in range(1500):
            reading = client.wait_for("NAMED_VALUE_FLOAT")
            assert reading.time_boot_ms == before + 1000
            before = reading.time_boot_ms


def test_a_client_that_does_not_read_is_dropped_and_holds_nobody_up():
    with (
        vessel("--speedup", "500", "--sample-interval-s", "0.02") as boat,
        Client("tcp", boat.ports[1], receive_bytes=4096) as stalled,
        Client("udp", boat.ports[0], 254) as lively,
    ):
        stalled.send(heartbeat())
        lively.send(heartbeat())
        deadline = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline:
            lively.wait_for("NAMED_VALUE_FLOAT")
            # Once dropped, the other end of the connection is reset.
            if stalled.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) != 0:
                break
        else:
            pytest.fail("the stalled client was never dropped")
        lively.wait_for("NAMED_VALUE_FLOAT")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_stops_cleanly(number):
    with vessel() as boat:
        boat.process.send_signal(number)
        assert boat.process.wait(DEADLINE_S) == 0


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--listen", "carrier-pigeon:127.0.0.1:1"], "no endpoint"),
        (["--listen", "udpin:127.0.0.1"], "no endpoint"),
        (["--listen", "udpout:127.0.0.1:0"], "not 0"),
        (["--speedup", "0"], "above 0"),
        (["--start=89.0,0.0"], "outside the field"),
        (["--sensor-name", "ELEVENCHARS"], "1 to 10"),
        (["--sysid", "255"], "1 to 254"),
        (["--field", "no-such-file.nc"], "no-such-file.nc"),
    ],
)
def test_mistakes_exit_2_with_a_reason(options, complaint):
    done = subprocess.run(
        [sys.executable, "-m", "sim", "vessel", *options],
        check=False,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("kind", ["udpin", "tcp"])
def test_an_occupied_port_exits_2_and_says_which(kind):
    with socket.socket(type=socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM) as holder:
        holder.bind(("127.0.0.1", 0))
        if kind == "tcp":
            holder.listen()
        endpoint = f"{kind}:127.0.0.1:{holder.getsockname()[1]}"
        words = [sys.executable, "-m", "sim", "vessel", "--listen", endpoint]
        done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=DEADLINE_S)
    assert done.returncode == 2
    assert endpoint in done.stderr
    assert "in use" in done.stderr


def mission() -> list[MissionItem]:
    """Home and three waypoints round a square of 40 m."""
    offsets = [(0, 0), (3600, 0), (3600, 4300), (0, 4300)]
    lat, lon = (round(1e7 * degrees) for degrees in START)
    return [
        MissionItem(
            seq=seq,
            frame=3,
            command=16,
            current=int(seq == 0),
            autocontinue=1,
            x=lat + dlat,
            y=lon + dlon,
            z=0.0,
        )
        for seq, (dlat, dlon) in enumerate(offsets)
    ]


@pytest.mark.parametrize(
    ("transport", "options"),
    [
        ("tcp", ("--speedup", "50")),
        ("udp", ("--speedup", "50")),
        ("tcp", ("--speedup", "10", "--sitl-timers")),
    ],
)
def test_mavsdk_connects_uploads_downloads_arms_starts_and_sees_the_end(transport, options):
    async def scenario(port: int) -> None:
        station = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        async with asyncio.timeout(3 * DEADLINE_S), Mavsdk(station) as sdk:
            await sdk.add_any_connection(f"{transport}out://127.0.0.1:{port}")
            system = await sdk.first_autopilot(timeout_s=DEADLINE_S)
            assert system is not None
            assert await system.get_system_id() == 1
            telemetry, raw, action = TelemetryAsync(system), MissionRawAsync(system), ActionAsync(system)
            async for health in telemetry.subscribe_health():
                if health.is_global_position_ok and health.is_home_position_ok and health.is_armable:
                    break
            sent = mission()
            await raw.upload_mission(sent)
            got = await raw.download_mission()
            assert [(each.seq, each.command, each.x, each.y) for each in got] == [
                (each.seq, each.command, each.x, each.y) for each in sent
            ]
            assert [each.frame for each in got] == [0, 3, 3, 3]  # item 0 is home
            await action.arm()
            async for armed in telemetry.subscribe_armed():
                if armed:
                    break
            await raw.start_mission()
            seen: set[int] = set()
            async for progress in raw.subscribe_mission_progress():
                assert progress.total == len(sent)
                seen.add(progress.current)
                if progress.current == progress.total:
                    break
            assert {2, 3, 4} <= seen
            for plugin in (raw, action, telemetry):
                plugin.destroy()

    with vessel(*options) as boat:
        asyncio.run(scenario(boat.ports[0 if transport == "udp" else 1]))
