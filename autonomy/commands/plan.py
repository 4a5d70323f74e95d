"""`autonomy plan`: the planner without a boat, for the desk."""

import argparse
import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autonomy.commands.configuration import add_override_argument, doubts, load_with_survey, tell
from autonomy.commands.places import launch_m, place
from autonomy.config import Configuration, ConfigurationError
from autonomy.geometry import FloatArray
from autonomy.option_types import above_zero
from autonomy.planning.survey import SurveyArea

if TYPE_CHECKING:
    from autonomy.commands.known import Known
    from autonomy.planning.plan import Plan
    from autonomy.planning.request import PlanRequest

EXIT_NO_PLAN = 1
EXIT_USAGE = 2
EXIT_DATA = 65
"""EX_DATAERR of sysexits.h."""

EXIT_NO_INPUT = 66
"""EX_NOINPUT of sysexits.h."""

EXIT_NO_OUTPUT = 73
"""EX_CANTCREAT of sysexits.h."""

_SHOWN_REJECTED = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration in YAML")
    parser.add_argument(
        "--model",
        type=Path,
        metavar="SNAPSHOT",
        help="what is known: a file of `autonomy shore watch --save`, a checkpoint of the service or the folder of "
        "its checkpoints; without it nothing is",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="where the plan goes, as GeoJSON"
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="a picture of the plan (PNG)")
    parser.add_argument(
        "--start",
        type=place,
        metavar="LAT,LON",
        help="where the vessel begins; without it where the checkpoint had it, at budget.home, or in the south-west "
        "(for a southern latitude: --start=-33.5,18.4)",
    )
    parser.add_argument(
        "--budget-km",
        type=above_zero("kilometres"),
        metavar="KM",
        help="how far it may sail, the way home and the reserve included, for budget.distance_m",
    )
    add_override_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Plan and tell.

    Exit codes: 0 planned, 1 there is no plan, 2 usage, 65 and 66 the model can't be used or found, 73 a file can't be
    written, 78 configuration.
    """
    overrides = list(arguments.overrides)
    if arguments.budget_km is not None:
        overrides.append(f"budget.distance_m={arguments.budget_km * 1e3!r}")
    try:
        loaded, survey = load_with_survey(arguments.config, overrides)
    except ConfigurationError as error:
        return tell(error)
    draw = None
    if arguments.picture is not None:
        draw = _painter()
        if draw is None:
            return _failed("--picture needs matplotlib: pip install 'halocline[shore]'", EXIT_USAGE)
    for doubt in doubts(loaded, survey):
        sys.stderr.write(f"{arguments.config}: warning: {doubt}\n")
    # The learner takes a while to import: a wrong configuration is told before.
    from autonomy.commands.known import UnknownModelError, known_from
    from autonomy.planning.errors import PlanningError
    from autonomy.planning.passage import Unreachable

    try:
        known = known_from(arguments.model, loaded.configuration, survey)
        desk = Desk.made(loaded.configuration, survey, known, arguments.start)
    except OSError as error:
        return _failed(f"{error.filename}: {error.strerror}", EXIT_NO_INPUT)
    except UnknownModelError as error:
        return _failed(f"{arguments.model}: {error}", EXIT_DATA)
    except (PlanningError, Unreachable) as error:
        return _failed(f"no plan: {error}", EXIT_NO_PLAN)
    sys.stdout.write("\n".join(desk.told()) + "\n")
    try:
        arguments.out.write_text(json.dumps(desk.geojson(), indent=1, allow_nan=False) + "\n")
        if draw is not None:
            draw(arguments.picture, desk.plan, desk.request, survey)
    except OSError as error:
        return _failed(f"{error.filename}: {error.strerror}", EXIT_NO_OUTPUT)
    return 0


@dataclass(frozen=True, eq=False)
class Desk:
    """A plan, and what it was made from."""

    configuration: Configuration
    survey: SurveyArea
    known: "Known"
    request: "PlanRequest"
    plan: "Plan"

    @staticmethod
    def made(
        configuration: Configuration, survey: SurveyArea, known: "Known", place: tuple[float, float] | None
    ) -> "Desk":
        """Plan as the service would for a vessel that begins there, latitude and longitude.

        Raises:
            PlanningError: there is no plan.
            Unreachable: there is no way home.
        """
        from autonomy.homeward import Homeward
        from autonomy.planning.planners import PlanRequest, make_plan

        start_m = _start(configuration, survey, known, place)
        homeward = Homeward(configuration, survey)
        homeward.told_home(start_m)
        budget_m, home_m = homeward.bounds(start_m, start_m, survey)
        request = PlanRequest(
            model=known.model,
            start_m=start_m,
            spots=configuration.planning.spots,
            lattice=configuration.planning.lattice,
            reason="asked for at the desk",
            seed=configuration.seed,
            iterations=configuration.planning.iterations,
            measured=known.measured,
            roughness=known.roughness,
            budget_m=budget_m,
            home_m=home_m,
            sample_spacing_m=configuration.sampling.spacing_m,
            speed_mps=configuration.budget.speed_mps,
            model_version=known.readings,
        )
        plan = make_plan(configuration.planning.planner, request, survey)
        return Desk(configuration, survey, known, request, homeward.fitted(plan, start_m, survey))

    @property
    def duration_s(self) -> float:
        """At the configured speed, with the stay at each spot."""
        at_spots_s = self.configuration.planning.hold_s * len(self.plan.spots_m)
        return self.plan.length_m / self.configuration.budget.speed_mps + at_spots_s

    @property
    def energy_wh(self) -> float | None:
        """By the configured consumption; None if there is none."""
        each = self.configuration.budget.consumption_j_per_m
        return None if each is None else each * self.plan.length_m / 3600.0

    def geojson(self) -> dict[str, Any]:
        """For a file."""
        from autonomy.planning.plan_geojson import plan_geojson

        rmse, before, nats = self._worth()
        energy_wh = self.energy_wh
        properties = {
            "duration_s": round(self.duration_s, 1),
            "energy_wh": None if energy_wh is None else round(energy_wh, 1),
            "expected_rmse": rmse,
            "rmse_before": before,
            "information_nats": nats,
        }
        return plan_geojson(self.plan, self.survey.frame, properties)

    def told(self) -> list[str]:
        """For a person."""
        plan, speed_mps = self.plan, self.configuration.budget.speed_mps
        lat_deg, lon_deg = self.survey.frame.to_geodetic(self.request.start_m)
        rmse, before, nats = self._worth()
        # Before anything was read the field's scale is a guess: only the shares mean something.
        scale = (
            1.0 if self.known.readings is not None else math.sqrt(self.request.model.kernel.signal_variance)
        )
        unit = "" if self.known.readings is not None else " of the field's standard deviation"
        lines = [
            f"planner      {plan.planner}, from {lat_deg:.5f}, {lon_deg:.5f}, with {self.known.says}",
            f"route        {plan.length_m / 1e3:.2f} km, {len(plan.route_m)} corners, {len(plan.spots_m)} spots",
            f"time         {_hours(self.duration_s)} at {speed_mps:g} m/s",
            "energy       "
            + (
                "not known: no budget.consumption_j_per_m"
                if self.energy_wh is None
                else f"{self.energy_wh:.1f} Wh"
            ),
            f"rmse         {rmse / scale:.3g}{unit} expected, {before / scale:.3g} without the plan",
            f"information  {nats:.2f} nats from readings along the way",
        ]
        if plan.mutual_information > 0.0:
            lines[-1] += f", {plan.mutual_information:.2f} from the spots about the rest"
        if plan.objective_after is not None:
            lines.append(f"objective    {plan.objective_after:.6g}")
        for name, objective in plan.rejected[:_SHOWN_REJECTED]:
            lines.append(f"rejected     {name}, {objective:.6g}")
        return lines

    def _worth(self) -> tuple[float, float, float]:
        """Expected RMSE after and before the plan, and what readings along the way tell of the field, in nats."""
        from autonomy.planning.expectation import along_route

        found = along_route(self.plan, self.request, self.survey)
        return found.rmse, found.rmse_before, found.information_nats


def _start(
    configuration: Configuration, survey: SurveyArea, known: "Known", place: tuple[float, float] | None
) -> FloatArray:
    """Where the vessel begins, shape (2,)."""
    if place is None and known.position_m is not None:
        return known.position_m
    return launch_m(configuration, survey, place)


def _painter() -> Callable[..., None] | None:
    try:
        from autonomy.shore.plan_picture import write_plan
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        return None
    return write_plan


def _hours(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    return f"{minutes // 60} h {minutes % 60:02d} min"


def _failed(why: str, code: int) -> int:
    sys.stderr.write(f"autonomy plan: {why}\n")
    return code
