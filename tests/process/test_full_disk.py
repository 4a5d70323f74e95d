"""The service on a disk of its own that is too small: a real one, mounted for it alone."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import VEHICLE, VESSEL, configure, operating
from processes import Processes, free_port, wait_until

from autonomy.shell.checkpoint import decode
from autonomy.shell.journal_files import journal_files
from autonomy.shore.subscriber import Subscriber

pytestmark = pytest.mark.process

DISK_KB = 3000
LEFT_KB = 600
MOUNT = ("--mount", "--map-root-user", "--propagation", "private")


@pytest.fixture
def unshare() -> str:
    """The program that gives a process mounts of its own, where that is allowed."""
    program = shutil.which("unshare")
    if program is None:
        pytest.skip("unshare (util-linux) is not installed")
    script = "mount -t tmpfs -o size=64k none /tmp"
    tried = subprocess.run([program, *MOUNT, "sh", "-c", script], capture_output=True, text=True, check=False)
    if tried.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {tried.stderr.strip()}")
    return program


def test_a_full_disk_costs_the_oldest_records_and_nothing_else(tmp_path: Path, unshare: str) -> None:
    """Journal and checkpoints share three megabytes, and then somebody else takes nearly all that is left of them."""
    port, operator, shore_at = free_port(), free_port(), f"tcp/127.0.0.1:{free_port()}"
    disk = tmp_path / "disk"
    disk.mkdir()
    config = configure(
        tmp_path,
        f"udpin:127.0.0.1:{port}",
        [shore_at],
        journal={"directory": str(disk / "journal"), "file_mb": 0.1, "total_mb": 1000.0},
        checkpoint={"directory": str(disk / "kept"), "period_s": 1.0},
    )
    script = f'mount -t tmpfs -o size={DISK_KB}k none {disk} && exec "$@"'
    words = (
        *MOUNT,
        "sh",
        "-c",
        script,
        "sh",
        sys.executable,
        "-m",
        "autonomy",
        "run",
        "--config",
        str(config),
    )
    with Processes() as processes, Subscriber(VEHICLE, listen=[shore_at]) as shore:
        service = processes.program(unshare, *words)
        processes.vessel(
            *("--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}"), *VESSEL
        )
        service.wait_for("recording run 1 in")
        inside = Path(f"/proc/{service.pid}/root{disk}")

        def newest() -> int:
            return max(decode(path.read_bytes()).number for path in inside.glob("kept/*.checkpoint"))

        def told() -> str:
            health = shore.latest(VEHICLE).health
            return "" if health is None else health.journal

        with operating(f"tcp:127.0.0.1:{operator}"):
            wait_until(lambda: list(inside.glob("kept/reserve")), what="a checkpoint")
            free = shutil.disk_usage(inside).free
            (inside / "filler").write_bytes(bytes(max(0, free - LEFT_KB * 1000)))
            wait_until(lambda: "the disk is full: the oldest files are given up" in told(), 200.0, "its end")
            number = journal_files(inside / "journal")[0].number
            assert number > 1
            before, samples = newest(), shore.latest(VEHICLE).health.samples
            # It goes on: the survey, the journal at its oldest end, the checkpoints.
            wait_until(lambda: journal_files(inside / "journal")[0].number > number + 1, 200.0, "the next")
            wait_until(lambda: shore.latest(VEHICLE).health.samples > samples, what="more samples")
            wait_until(lambda: newest() > before + 3, what="further checkpoints")
            assert "records lost" not in told()
            assert "checkpoint" not in told()
        free = shutil.disk_usage(inside).free
        print(f"{free / 1000:.0f} kB free at the end; health: {told()}")
        assert service.stop() == 0
    assert "Traceback" not in service.said
    assert "journal: the disk is full: the oldest files are given up" in service.said
