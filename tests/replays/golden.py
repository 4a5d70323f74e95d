"""Makes the golden journals of this folder: `python tests/replays/golden.py [NAME …]`, from the repository's root.

Each is a short survey on the discrete driver with something going wrong in it. To be made again when what the core does
changes on purpose; that replays stay equal to them between such changes is what they are for.
"""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea
from autonomy.shell.journal import Journal, make_header
from sim.autopilot import Autopilot, Mode, Options
from sim.discrete import DiscreteRun
from sim.sensor import Sensor
from sim.vessel import Handling, Position, Vessel

FOLDER = Path(__file__).parent
UTC_S = 1_750_000_000.0
_FRAME = LocalFrame(33.5, -118.5)
_START_S = 1000.0


class _Sea:
    """Waves of a kilometre, no land."""

    def value(self, lat_deg: Any, lon_deg: Any, time_s: Any) -> Any:
        return 33.5 + 0.5 * np.sin((lon_deg + 118.5) * 220.0) * np.cos((lat_deg - 33.5) * 290.0)

    def is_land(self, lat_deg: Any, lon_deg: Any) -> Any:
        return np.zeros(np.shape(lat_deg), dtype=bool)


def survey() -> SurveyArea:
    """Three kilometres of sea with an island."""
    area, island = shapely.box(0.0, 0.0, 3000.0, 2400.0), shapely.box(1300.0, 900.0, 1700.0, 1500.0)
    return SurveyArea.from_geometry(_FRAME, area, land=island, standoff_m=60.0, passage_cells=40)


def configuration() -> Configuration:
    """A small model, re-estimated soon."""
    corners = [_FRAME.to_geodetic(corner).tolist() for corner in ((0, 0), (3000, 0), (3000, 2400), (0, 2400))]
    return Configuration.model_validate(
        {
            "mavlink": {"acceptance_radius_m": 15.0},
            "survey": {"area": [tuple(corner) for corner in corners]},
            "sampling": {"spacing_m": 60.0},
            "model": {"capacity": 16, "centring_samples": 6, "history_cells": 200},
            "estimation": {
                "maximum_points": 60,
                "iterations": 20,
                "candidates": ("squared_exponential", "ou"),
            },
            "exploration": {"minimum_basis": 12, "maximum_interval_s": None, "outgrown_ratio": None},
            "planning": {"planner": "paper", "lattice": (6, 5), "spots": 6},
            "shore": {"model_period_s": 60.0, "health_period_s": 20.0},
        }
    )


def sail(
    folder: Path,
    course: Callable[[DiscreteRun], None],
    run_job: Callable[..., object] = jobs.run,
    settings: Configuration | None = None,
) -> DiscreteRun:
    """Record a survey in a folder; `course` sails it once it is under way."""
    settings = configuration() if settings is None else settings
    area = survey()
    journal = Journal.open(
        folder, settings.journal, make_header(settings, area, now=_START_S, utc_s=UTC_S), utc_s=lambda: UTC_S
    )
    lat_deg, lon_deg = _FRAME.to_geodetic((150.0, -250.0)).tolist()
    vessel = Vessel(
        Position(lat_deg, lon_deg), handling=Handling(acceleration_mps2=4.0, turn_rate_deg_s=60.0)
    )
    sensor = Sensor(_Sea(), np.random.default_rng(1), "SALT", 1.5, noise_std=0.02)
    autopilot = Autopilot(vessel, sensor, Options(speed_mps=8.0, waypoint_radius_m=15.0))
    sailed = DiscreteRun(
        Core(settings, area), autopilot, area, run_job=run_job, now=_START_S, journal=journal
    )
    sailed.start_survey()
    course(sailed)
    journal.close()
    return sailed


def operator(run: DiscreteRun) -> None:
    """The operator takes the boat and gives it back."""
    run.advance(60.0)
    run.select(Mode.HOLD)
    run.advance(20.0)
    run.select(Mode.AUTO)
    run.advance(100.0)


def link(run: DiscreteRun) -> None:
    """The link goes, twice, and loses mission items in between."""
    run.advance(30.0)
    run.cut_link()
    run.advance(15.0)
    run.restore_link()
    passed = iter(range(10**9))
    run.passes = lambda message: message.get_type() != "MISSION_ITEM_INT" or next(passed) % 3 > 0
    run.advance(120.0)
    run.cut_link("unplugged again")
    run.advance(5.0)
    run.restore_link()
    run.advance(20.0)


class BrokenWorker:
    """Every second job crashes."""

    def __init__(self) -> None:
        self._jobs = 0

    def __call__(self, name: str, request: object, area: SurveyArea) -> object:
        """As `jobs.run`."""
        self._jobs += 1
        if self._jobs % 2 == 0:
            raise RuntimeError("the worker crashed")
        return jobs.run(name, request, area)


def worker(run: DiscreteRun) -> None:
    """Nothing but the worker's crashes."""
    run.advance(220.0)


COURSES: dict[str, tuple[Callable[[DiscreteRun], None], Callable[[], Callable[..., object]]]] = {
    "operator": (operator, lambda: jobs.run),
    "link": (link, lambda: jobs.run),
    "worker": (worker, BrokenWorker),
}


def main(names: list[str]) -> None:
    """Make the golden journals with these names, or all."""
    for name in names or COURSES:
        course, run_job = COURSES[name]
        folder = FOLDER / name
        shutil.rmtree(folder, ignore_errors=True)
        run = sail(folder, course, run_job())
        (folder / "lock").unlink()
        for stream in folder.glob("*.tlog"):
            stream.unlink()
        size = sum(path.stat().st_size for path in folder.iterdir())
        print(f"{name}: {size / 1000:.0f} kB, {run.now - _START_S:.0f} s; {run.log[-1][1]}")


if __name__ == "__main__":
    main(sys.argv[1:])
