"""Who sails a comparison's voyages: the core under one of two configurations, or a strategy's waypoints."""

from collections.abc import Callable
from time import thread_time
from typing import Any

import numpy as np

from autonomy.config import Configuration
from autonomy.geometry import FloatArray
from autonomy.planning.plan import NO_SPOTS, Plan
from autonomy.planning.planners import PlanRequest
from autonomy.planning.survey import SurveyArea
from sim.experiment import strategies
from sim.experiment.compare_maps import Read
from sim.experiment.compare_seas import SPEED_MPS, Sea
from sim.experiment.compare_ways import LANES, ON_BOARD, PAPER
from sim.experiment.logbook import Voyage
from sim.experiment.orders import Orders, Planner, on_rails
from sim.experiment.paper_numbers import MAP_COLUMNS, MAP_ROWS
from sim.experiment.paper_setting import profile
from sim.experiment.voyage import sail
from sim.experiment.waters import cell_middles
from sim.truth_map import TruthMap

JUDGEMENTS = 20
"""Equal parts of a voyage after which the map is judged."""

COVER_SIDES = 4.0
"""Length of one cover of a lawnmower that goes to and fro over a sea that moves, in √(water area)."""

_DONE_M = 1.0


def sailed(sea: Sea, strategy: str, launch_m: FloatArray, seed: int) -> tuple[Voyage, float]:
    """The voyage, and CPU seconds of its planning and, if the core sails, its learning."""
    by = _by_the_core if strategy in ON_BOARD else _by_waypoints
    return by(sea, strategy, launch_m, seed)


def configuration(sea: Sea, strategy: str, seed: int) -> Configuration:
    """What the core is told: the default, or the paper's profile; within the budget, where it has to come home.

    Nobody keeps a reserve here, or all would sail different lengths: that is the one thing of the default that changes.
    """
    base = _paper(sea) if strategy == PAPER else _default(sea)
    update: dict[str, Any] = {
        "seed": seed,
        "sampling": base.sampling.model_copy(update={"spacing_m": sea.spacing_m}),
    }
    if strategy in ON_BOARD and not sea.choice.moves:
        limits = {"distance_m": sea.budget_m, "reserve": 0.0, "home_margin": 1.0, "speed_mps": SPEED_MPS}
        update["budget"] = base.budget.model_copy(update=limits)
    return base.model_copy(update=update)


def _default(sea: Sea) -> Configuration:
    x_min, y_min, x_max, y_max = sea.waters.survey.bounds
    corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
    area = [tuple(place) for place in sea.waters.survey.frame.to_geodetic(corners).tolist()]
    return Configuration.model_validate({"survey": {"area": area}})


def _paper(sea: Sea) -> Configuration:
    """The paper's profile; the lengths in it are counted in cells of a map as fine as the paper's."""
    waters = sea.waters
    x_min, y_min, x_max, y_max = waters.survey.bounds
    columns, rows = cell_middles(x_min, x_max, MAP_COLUMNS), cell_middles(y_min, y_max, MAP_ROWS)
    return profile(TruthMap(waters.field, waters.survey, columns, rows))


def _orders(
    sea: Sea, told: Configuration, launch_m: FloatArray, seed: int, planner: Planner | None = None
) -> Orders:
    # Waypoints over a sea that stands still may be sailed at any pace, and a coarse one is computed sooner.
    hurries = planner is not None and not sea.choice.moves
    return Orders(
        waters=sea.waters,
        configuration=told,
        launch_m=launch_m,
        distance_m=sea.budget_m,
        noise=sea.noise,
        seed=seed,
        speed_mps=None if hurries else SPEED_MPS,
        planner=planner,
        judgements=JUDGEMENTS,
        keep_models=True,
    )


def _by_the_core(sea: Sea, strategy: str, launch_m: FloatArray, seed: int) -> tuple[Voyage, float]:
    sailed = sail(_orders(sea, configuration(sea, strategy, seed), launch_m, seed))
    return sailed, sailed.cost.core_s + sailed.cost.jobs_s


def _by_waypoints(sea: Sea, strategy: str, launch_m: FloatArray, seed: int) -> tuple[Voyage, float]:
    pilot = _Pilot(_strategy(sea, strategy, seed), sea, launch_m, seed)
    told = on_rails(configuration(sea, strategy, seed))
    return sail(_orders(sea, told, launch_m, seed, pilot)), pilot.spent_s


def _strategy(sea: Sea, name: str, seed: int) -> strategies.Strategy:
    cover = COVER_SIDES if sea.choice.moves else None
    ways: dict[str, Callable[[], strategies.Strategy]] = {
        LANES[0]: lambda: strategies.Lawnmower(0, cover),
        LANES[1]: lambda: strategies.Lawnmower(1, cover),
        "random": lambda: strategies.RandomWaypoints(seed),
        "entropy": strategies.GreedyEntropy,
        "information": strategies.GreedyInformation,
    }
    return ways[name]()


class _Pilot:
    """A strategy as the voyage's planner; counts what is left of the budget."""

    def __init__(self, strategy: strategies.Strategy, sea: Sea, launch_m: FloatArray, seed: int) -> None:
        self._strategy, self._sea, self._seed = strategy, sea, seed
        self._home_m = None if sea.choice.moves else launch_m
        self._left_m = sea.budget_m
        self.spent_s = 0.0

    def __call__(self, request: PlanRequest, survey: SurveyArea) -> Plan | None:
        begun_s = thread_time()
        cells = request.measured
        read = (
            Read.nothing()
            if cells is None
            else Read(cells.points[:, :2], cells.means, cells.times_s, cells.counts)
        )
        underway = strategies.Underway(
            survey,
            np.asarray(request.start_m, dtype=float),
            self._home_m,
            self._left_m,
            float(read.times_s.max(initial=0.0)),
            read,
            self._sea.choice.moves,
            self._seed,
        )
        corners = self._strategy.stretch(underway) if self._left_m > _DONE_M else np.empty((0, 2))
        self.spent_s += thread_time() - begun_s
        if not len(corners):
            return None
        plan = Plan(
            underway.here_m, corners, np.ones(len(corners), dtype=bool), NO_SPOTS, "given", request.reason
        )
        self._left_m -= plan.length_m
        return plan
