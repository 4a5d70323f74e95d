"""Replay against the time that was recorded."""

import shutil
from collections.abc import Callable
from pathlib import Path

from autonomy.replay import replay

GOLDEN = Path(__file__).parents[1] / "replays" / "operator"


def test_replay(seconds: Callable[..., float], report: Callable[..., None], tmp_path: Path) -> None:
    """At most a twentieth of real time; most of it is the core's own work."""
    folder = tmp_path / "journal"
    shutil.copytree(GOLDEN, folder)
    recorded_s = replay(folder, 1).recorded_s
    report("replay of a run", seconds(lambda: replay(folder, 1), repeat=3), "the run", recorded_s)
