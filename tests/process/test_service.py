"""`autonomy run` as a process, with a real vehicle and real routers: coming, going and coming again."""

import os
import signal
import socket
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import SPACING_M, VEHICLE, VESSEL, configure, operating
from processes import SOON_S, Processes, Running, free_port, wait_until

from autonomy.shore.subscriber import Subscriber

pytestmark = pytest.mark.process


def samples(shore: Subscriber) -> int:
    model = shore.latest(VEHICLE).model
    return 0 if model is None else model.samples


def wait_for_samples(service: Running, shore: Subscriber, at_least: int) -> None:
    service.wait_until(lambda: samples(shore) >= at_least, what=f"{at_least} samples")


def vessel_at(port: int, operator: int) -> tuple[str, ...]:
    return ("--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}", *VESSEL)


def test_a_wrong_configuration_ends_it_with_78(tmp_path: Path) -> None:
    with Processes() as processes:
        running = processes.service(configure(tmp_path, "udpin:127.0.0.1"))
        assert running.wait() == 78
    assert "boat.yaml:5:3: mavlink.endpoint: not an endpoint (got 'udpin:127.0.0.1')" in running.said


def test_the_vehicle_comes_late_goes_and_comes_again(tmp_path: Path) -> None:
    port, operator, shore_at = free_port(), free_port(), f"tcp/127.0.0.1:{free_port()}"
    with Processes() as processes, Subscriber(VEHICLE, listen=[shore_at]) as shore:
        running = processes.service(configure(tmp_path, f"udpin:127.0.0.1:{port}", [shore_at]))
        wait_until(lambda: shore.latest(VEHICLE).health, what="health without a vehicle")
        assert shore.latest(VEHICLE).health.state == "waiting_for_vehicle"
        first = processes.vessel(*vessel_at(port, operator))
        with operating(f"tcp:127.0.0.1:{operator}"):
            wait_for_samples(running, shore, 10)
        first.kill()
        wait_until(lambda: shore.latest(VEHICLE).health.state == "waiting_for_vehicle", what="the loss")
        learnt = samples(shore)
        processes.vessel(*vessel_at(port, operator))
        with operating(f"tcp:127.0.0.1:{operator}") as bridge:
            wait_for_samples(running, shore, learnt + 10)
            started = time.monotonic()
            assert running.stop() == 0
            print(f"stopped within {time.monotonic() - started:.1f} s")
            assert running.family() == []
            wait_until(lambda: "halocline: service stops" in bridge.texts(), what="the goodbye")
        wait_until(lambda: not shore.latest(VEHICLE).alive, what="its leaving")
    assert "Traceback" not in running.said


def test_routers_come_late_go_and_come_again(tmp_path: Path) -> None:
    port, operator, shore_at = free_port(), free_port(), f"tcp/127.0.0.1:{free_port()}"
    with Processes() as processes:
        running = processes.service(configure(tmp_path, f"udpin:127.0.0.1:{port}", [shore_at]))
        processes.vessel(*vessel_at(port, operator))
        with operating(f"tcp:127.0.0.1:{operator}") as bridge:
            running.wait_for("re-estimated")
            seen = [0]
            for _ in range(2):
                with Subscriber(VEHICLE, listen=[shore_at]) as shore:
                    wait_until(lambda shore=shore: shore.latest(VEHICLE).alive, what="the connection")
                    connected = time.monotonic()
                    wait_until(lambda shore=shore: shore.latest(VEHICLE).model, what="the last model")
                    print(f"the last model came {time.monotonic() - connected:.2f} s after the connection")
                    # What was learnt while nobody listened is in it, and it goes on growing.
                    assert samples(shore) >= seen[-1] + 10
                    seen.append(samples(shore) + 10)
                    wait_for_samples(running, shore, seen[-1])
                # Way enough for 30 samples, of which 10 are asked for.
                there_m = bridge.sailed_m + 30 * SPACING_M
                running.wait_until(lambda m=there_m: bridge.sailed_m > m, what="a way made unheard")
        print(f"samples seen: {seen}")
        assert running.stop() == 0
        assert running.family() == []
    assert "Traceback" not in running.said


def test_a_hung_router_does_not_hold_up_the_stop(tmp_path: Path) -> None:
    shore_at = f"tcp/127.0.0.1:{free_port()}"
    with Processes() as processes:
        router = processes.start("-m", "autonomy", "shore", "watch", VEHICLE, "--listen", shore_at)
        running = processes.service(configure(tmp_path, f"udpin:127.0.0.1:{free_port()}", [shore_at]))
        running.wait_for("shore: connected")
        router.send(signal.SIGSTOP)
        assert running.stop(within_s=15.0) == 0, "TimeoutStopSec of the unit"
        assert running.family() == []


def test_its_worker_does_not_outlive_it(tmp_path: Path) -> None:
    with Processes() as processes:
        running = processes.service(configure(tmp_path, f"udpin:127.0.0.1:{free_port()}"))
        running.wait_until(lambda: len(running.family()) == 2, what="a worker")
        running.send(signal.SIGKILL)
        assert running.wait() == -signal.SIGKILL
        wait_until(lambda: running.family() == [], what="the worker's end")


def test_systemd_is_told(tmp_path: Path) -> None:
    address = str(tmp_path / "notify")
    with Processes() as processes, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        manager.settimeout(SOON_S)
        environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "500000"}
        running = processes.service(
            configure(tmp_path, f"udpin:127.0.0.1:{free_port()}"), environment=environment
        )
        assert manager.recv(100) == b"READY=1"
        told = [manager.recv(100) for _ in range(5)]
        status = b"STATUS=waiting_for_vehicle: nothing heard from the autopilot yet"
        assert sorted(told) == [status, *[b"WATCHDOG=1"] * 4]
        os.kill(running.pid, signal.SIGTERM)
        last = []
        while not last or last[-1] != b"STOPPING=1":
            last.append(manager.recv(100))
        assert set(last) <= {b"WATCHDOG=1", b"STOPPING=1"}
        assert running.wait() == 0
        manager.setblocking(False)
        with pytest.raises(BlockingIOError):
            manager.recv(100)
