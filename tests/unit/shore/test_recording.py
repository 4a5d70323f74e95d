"""The shore's recording: what arrived is read again byte by byte, whatever happened to disk and process."""

import errno
import os
import random
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import cbor2
import pytest

from autonomy.frames import OVERHEAD_BYTES, pack
from autonomy.shore import recording_files
from autonomy.shore.recording import (
    Limits,
    Recorded,
    Recorder,
    RecordingError,
    is_recording,
    known_vehicles,
    read_recording,
)
from autonomy.shore.recording_files import Files


def arrivals(count: int, vehicle: str = "boat1", seed: int = 1) -> list[Recorded]:
    draw = random.Random(seed)
    topics = ("model", "plan", "observations", "health", "log")
    return [
        Recorded(
            1.75e9 + i,
            f"usv/{vehicle}/{draw.choice(topics)}",
            "application/cbor;halocline/x/2",
            draw.randbytes(draw.randrange(2000)),
        )
        for i in range(count)
    ]


def record(folder: Path, wanted: list[Recorded], limits: Limits | None = None) -> None:
    with Recorder(folder, limits) as recorder:
        for one in wanted:
            recorder.write(one.received_utc_s, one.key, one.encoding, one.payload)
    assert recorder.status.lost == 0


def read(folder: Path, vehicle: str | None = None) -> tuple[list[Recorded], list[str]]:
    regrets: list[str] = []
    return list(read_recording(folder, vehicle, regrets.append)), regrets


def test_what_arrived_is_read_again_over_files_and_restarts(tmp_path: Path) -> None:
    first, second = arrivals(200), arrivals(50, "boat2", seed=2)
    record(tmp_path, first, Limits(file_bytes=20_000))
    record(tmp_path, second)
    assert len(list(tmp_path.glob("*.recording"))) > 5
    assert read(tmp_path) == (first + second, [])
    assert read(tmp_path, "boat2") == (second, [])
    assert known_vehicles(tmp_path) == ["boat1", "boat2"]


def test_a_folder_without_a_recording_is_told(tmp_path: Path) -> None:
    assert not is_recording(tmp_path)
    with pytest.raises(RecordingError, match="holds no recording"):
        read(tmp_path)
    with pytest.raises(FileNotFoundError):
        read(tmp_path / "nowhere")


def test_two_recorders_never_share_a_folder(tmp_path: Path) -> None:
    with Recorder(tmp_path), pytest.raises(BlockingIOError):
        Recorder(tmp_path)
    record(tmp_path, arrivals(3))


def test_the_oldest_files_go_when_the_bound_is_reached(tmp_path: Path) -> None:
    wanted = arrivals(400)
    record(tmp_path, wanted, Limits(file_bytes=20_000, total_bytes=100_000))
    assert sum(path.stat().st_size for path in tmp_path.glob("*.recording")) <= 100_000 + 25_000
    held, regrets = read(tmp_path)
    assert held == wanted[-len(held) :]
    assert len(held) > 50
    assert regrets == []


def test_damage_costs_the_records_it_touches(tmp_path: Path) -> None:
    wanted = arrivals(100)
    record(tmp_path, wanted)
    (path,) = tmp_path.glob("*.recording")
    data = bytearray(path.read_bytes())
    place = data.index(wanted[50].payload)
    data[place : place + 5] = b"\0\0\0\0\0"
    path.write_bytes(data)
    held, regrets = read(tmp_path)
    assert held == wanted[:50] + wanted[51:]
    assert "damaged, left out" in regrets[0]
    assert "1 records before it are missing" in regrets[1]
    assert all(str(path) in text for text in regrets)


def test_a_torn_tail_is_cut_and_the_recording_goes_on(tmp_path: Path) -> None:
    wanted = arrivals(20)
    record(tmp_path, wanted[:10])
    (path,) = tmp_path.glob("*.recording")
    path.write_bytes(path.read_bytes()[:-1])
    assert read(tmp_path) == (wanted[:9], [])
    record(tmp_path, wanted[10:])
    # The tenth is gone with the end of its file, and nothing else.
    assert read(tmp_path) == (wanted[:9] + wanted[10:], [])


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ({"schema": "halocline/recording", "version": 2}, "a newer version, 2; this software reads 1"),
        ({"schema": "halocline/recording", "version": "x"}, "another version, x"),
        ({"schema": "halocline/journal", "version": 1}, "no recording of this software"),
        ({}, "no recording of this software"),
    ],
)
def test_files_of_others_are_refused(tmp_path: Path, header: dict[str, object], said: str) -> None:
    path = tmp_path / "shore000001.recording"
    path.write_bytes(pack(0, 0, cbor2.dumps([0, header])))
    with pytest.raises(RecordingError, match=said) as raised:
        read(tmp_path)
    assert str(path) in str(raised.value)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xff", cbor2.dumps([7]), cbor2.dumps([1, 2, 3]), cbor2.dumps("x")]
)
def test_records_of_no_known_kind_are_left_out(tmp_path: Path, content: bytes) -> None:
    wanted = arrivals(2)
    record(tmp_path, wanted)
    (path,) = tmp_path.glob("*.recording")
    end = path.stat().st_size
    with path.open("ab") as file:
        file.write(pack(end, 3, content))
    held, regrets = read(tmp_path)
    assert held == wanted
    assert len(regrets) == 1
    assert f"byte {end}" in regrets[0]


class Disk:
    """A disk with so many bytes of room."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, descriptor: int, data: bytes) -> int:
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = data[: self.room]
        self.room -= len(taken)
        return os.write(descriptor, taken)


def test_a_full_disk_is_told_and_recording_goes_on_when_there_is_room(tmp_path: Path) -> None:
    disk, now = Disk(10_000), [0.0]
    files = Files(tmp_path, Limits(), lambda: b"header", lambda: now[0], disk.write)
    files.append([b"x" * 1000] * 20)
    assert files.trouble == "No space left on device: nothing is recorded"
    kept = (10_000 - OVERHEAD_BYTES - len(b"header")) // (1000 + OVERHEAD_BYTES)
    assert files.lost == 20 - kept
    disk.room = 10**6
    files.append([b"y"])
    assert files.lost == 20 - kept + 1  # not before the pause is over
    now[0] += recording_files.RETRY_S
    files.append([b"z"])
    assert files.trouble == ""
    files.close()
    with_payload = [path.read_bytes() for path in sorted(tmp_path.glob("*.recording"))]
    assert len(with_payload) == 2
    assert with_payload[0].count(b"x" * 1000) == kept
    assert with_payload[1].endswith(b"z")


def test_a_disk_without_any_room_leaves_no_empty_files(tmp_path: Path) -> None:
    files = Files(tmp_path, Limits(), lambda: b"header", lambda: 0.0, Disk(0).write)
    files.append([b"x"] * 5)
    files.close()
    assert files.lost == 5
    assert not list(tmp_path.glob("*.recording"))


def test_a_disk_that_hangs_delays_nobody_and_memory_stays_bounded(tmp_path: Path) -> None:
    let_go = threading.Event()

    def hang(descriptor: int, data: bytes) -> int:
        let_go.wait(60.0)
        return os.write(descriptor, data)

    recorder = Recorder(tmp_path, queue_bytes=100_000, write=hang)
    wanted = [Recorded(float(i), "usv/b/log", "x", bytes(1000)) for i in range(1000)]
    for one in wanted:
        recorder.write(one.received_utc_s, one.key, one.encoding, one.payload)
    assert recorder.status.lost > 800
    let_go.set()
    recorder.close()
    held, _ = read(tmp_path)
    assert len(held) == recorder.status.recorded == 1000 - recorder.status.lost
    assert held == wanted[: len(held)]


def test_kill_9_costs_nothing_that_was_written(tmp_path: Path) -> None:
    program = textwrap.dedent(
        """
        import sys, pathlib
        from autonomy.shore.recording import Recorder
        recorder = Recorder(pathlib.Path(sys.argv[1]))
        i = 0
        while True:
            recorder.write(float(i), "usv/boat1/log", "x", i.to_bytes(4, "big") * 300)
            i += 1
        """
    )
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)])
    path = tmp_path / "shore000001.recording"
    try:
        deadline = time.monotonic() + 60.0
        while not (path.exists() and path.stat().st_size > 10**6):
            assert time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    held, regrets = read(tmp_path)
    assert regrets == []
    assert [one.received_utc_s for one in held] == [float(i) for i in range(len(held))]
    assert len(held) >= 10**6 // 1400
    record(tmp_path, arrivals(3))
    assert read(tmp_path) == (held + arrivals(3), [])
