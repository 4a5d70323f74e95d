"""Random missions within a budget, without messages: a boat on its legs, planners, and the vehicle's own `Homeward`.

A mission draws its sea, boat, current, battery and limits from a seed. What the boat really spends is kept apart from
what `Homeward` is told, and every leg that it begins is judged by the truth.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from autonomy.budget import DISTANCE, DURATION, ENERGY, Reading, Stage
from autonomy.config import Configuration
from autonomy.geometry import FloatArray, LocalFrame, path_length_m
from autonomy.homeward import Homeward, Sailing
from autonomy.learning.learner import Learner
from autonomy.planning.passage import Unreachable
from autonomy.planning.plan import Plan
from autonomy.planning.planners import PLANNERS, PlanningError, PlanRequest
from autonomy.planning.survey import SurveyArea
from sim.vessel import Battery, UnsteadyCurrent

STEP = 0.03
"""Of the side of a square as large as the water: what is sailed between two looks at the budget."""

LONGEST_STEP_S = 30.0
"""And at most so long: nothing is learnt across gaps."""

PLANNING_S = 3.0
ACCEPTANCE_M = 10.0
LONGEST_STEPS = 100_000

_FRAME = LocalFrame(36.6, -122.0)


@dataclass(frozen=True, eq=False)
class Conditions:
    """What a mission is sailed in.

    Attributes:
        survey: the sea.
        configuration: with a `budget`.
        home_m: shape (2,), where the boat starts and the autopilot's home is.
        speed_mps: through the water.
        current: of the water.
        battery: which drains with noise.
        tells: what the autopilot tells of its battery: "energy", "charge" or "share".
        planner: its name.
    """

    survey: SurveyArea
    configuration: Configuration
    home_m: FloatArray
    speed_mps: float
    current: UnsteadyCurrent
    battery: Battery
    tells: str
    planner: str


@dataclass(eq=False)
class Outcome:
    """How a mission went; amounts are of metres, seconds and joules, inf where there is no limit.

    Attributes:
        limits: shape (3,).
        usable: shape (3,), the limits less their reserves.
        spent: shape (3,), when the boat was home.
        is_home: whether it got there.
        stage: how urgent the way home became.
        plans: how many were made.
        overdrawn_legs: by how much, as a share of what was left to spend, each leg that was begun with the way home
            after it exceeded that; empty if none did.
        legs: how many legs of the survey were begun.
        track_m: every position, shape (n, 2).
    """

    limits: FloatArray
    usable: FloatArray
    spent: FloatArray = field(default_factory=lambda: np.zeros(3))
    is_home: bool = False
    stage: Stage = Stage.FINE
    plans: int = 0
    legs: int = 0
    overdrawn_legs: list[float] = field(default_factory=list)
    track_m: list[FloatArray] = field(default_factory=list)

    @property
    def use(self) -> float:
        """Share of the scarcest usable limit that was spent."""
        return float((self.spent / self.usable).max())


def draw(seed: int, **changes: Any) -> Conditions:
    """The conditions of a random mission; `changes` replace keys of the section `budget`."""
    rng = np.random.default_rng(seed)
    side_m = rng.uniform(2000.0, 8000.0)
    survey, home_m = _sea(side_m, rng)
    speed_mps = rng.uniform(1.0, 3.0)
    direction = rng.uniform(0.0, 2.0 * math.pi)
    mean_mps = rng.uniform(0.0, 0.25) * speed_mps
    mean = (mean_mps * math.cos(direction), mean_mps * math.sin(direction))
    current = UnsteadyCurrent.draw(mean, 0.05 * speed_mps, rng)
    metres = rng.uniform(3.0, 16.0) * math.sqrt(survey.water.area)
    hotel_w, propulsion_w = rng.uniform(5.0, 40.0), rng.uniform(60.0, 200.0)
    j_per_m = (hotel_w + propulsion_w) / speed_mps
    battery = Battery(
        capacity_wh=metres * j_per_m / 3600.0 * rng.uniform(0.9, 1.1),
        hotel_w=hotel_w,
        propulsion_w_per_m3s3=propulsion_w / speed_mps**3,
        noise=rng.uniform(0.05, 0.2),
        rng=rng,
    )
    amounts = {
        "distance_m": metres,
        "duration_s": metres / speed_mps * rng.uniform(0.9, 1.1),
        "energy_wh": battery.capacity_wh,
    }
    limited = rng.permutation(list(amounts))[: rng.integers(1, 4)].tolist()
    limits = {name: amounts[name] for name in amounts if name in limited}
    if "energy_wh" not in limits:
        battery.capacity_wh *= 2.0
    guesses = {
        "consumption_j_per_m": j_per_m * rng.uniform(0.6, 1.6),
        "speed_mps": speed_mps * rng.uniform(0.7, 1.4),
    }
    budget = {**limits, **guesses, "reserve": rng.uniform(0.05, 0.2), **changes}
    corners = [tuple(_FRAME.to_geodetic(corner).tolist()) for corner in ((0, 0), (1e3, 0), (1e3, 1e3))]
    configuration = Configuration.model_validate({"survey": {"area": corners}, "budget": budget})
    tells = str(rng.choice(["energy", "charge", "share"]))
    planner = str(rng.choice(list(PLANNERS)))
    return Conditions(survey, configuration, home_m, speed_mps, current, battery, tells, planner)


def _sea(side_m: float, rng: np.random.Generator) -> tuple[SurveyArea, FloatArray]:
    """A sea with up to three islands, and a harbour at its edge or a mooring in it."""
    while True:
        area = shapely.box(0.0, 0.0, side_m, rng.uniform(0.6, 1.0) * side_m)
        _, _, width_m, height_m = area.bounds
        islands = [
            shapely.Point(rng.uniform(0.0, width_m), rng.uniform(0.0, height_m)).buffer(
                rng.uniform(0.04, 0.15) * side_m, quad_segs=3
            )
            for _ in range(rng.integers(0, 4))
        ]
        survey = SurveyArea.from_geometry(
            _FRAME,
            area,
            land=shapely.union_all(islands) if islands else None,
            standoff_m=40.0,
            passage_cells=60,
        )
        home_m = np.array([rng.uniform(0.0, width_m), rng.choice([-60.0, rng.uniform(0.0, height_m)])])
        # A harbour may lie outside the area, not behind an island at its edge.
        inwards = home_m if home_m[1] >= 0.0 else np.array([home_m[0], 100.0])
        if survey.is_navigable(inwards)[0] and survey.approach_is_clear(home_m, inwards):
            return survey, home_m


class Mission:
    """One mission; `sail` sails it to its end."""

    def __init__(self, conditions: Conditions, seed: int = 0) -> None:
        self._with = conditions
        self._seed = seed
        self._homeward = Homeward(conditions.configuration, conditions.survey)
        self._homeward.told_home(conditions.home_m)
        self._model = Learner(conditions.survey.span_m, area_m2=conditions.survey.area_m2).model()
        section = conditions.configuration.budget
        limits = self._homeward.budget.limits
        self.outcome = Outcome(limits, limits * (1.0 - section.reserve))
        self._here_m = conditions.home_m
        self._plan: Plan | None = None
        self._next = 0
        self._spent = self.outcome.spent
        step_m = STEP * math.sqrt(conditions.survey.water.area)
        self._step_s = min(LONGEST_STEP_S, step_m / conditions.speed_mps)

    def sail(self) -> Outcome:
        """Sail until home, or until nothing is left at all."""
        for _ in range(LONGEST_STEPS):
            if self._homeward.is_finished or (self._spent > self.outcome.limits).any():
                break
            self._tell()
            self._decide()
            self._step()
        self.outcome.is_home = self._homeward.is_finished and self._is_at(self._with.home_m)
        self.outcome.stage = self._homeward.stage
        return self.outcome

    def _tell(self) -> None:
        battery = self._with.battery
        joules = battery.used_wh * 3600.0
        reading = Reading(
            self._spent[DURATION],
            self._here_m,
            self._spent[DISTANCE],
            consumed_j=round(joules, -2) if self._with.tells == "energy" else None,
            drawn_c=battery.drawn_c if self._with.tells == "charge" else None,
            voltage_v=battery.voltage_v,
            charge=round(battery.remaining, 2) if self._with.tells == "share" else None,
            is_sailing=not self._is_sailed,
        )
        self._homeward.follow(reading, armed=True, commanded=True)

    @property
    def _is_sailed(self) -> bool:
        return self._plan is None or self._next >= len(self._plan.route_m)

    def _decide(self) -> None:
        """As the core does it: what the budget asks for comes first."""
        homeward, water = self._homeward, self._with.survey
        if self._plan is not None:
            route_m = np.vstack([self._here_m, self._plan.route_m[self._next :]])
            sailing = Sailing(self._plan, route_m, self._is_sailed)
            plan = homeward.watch(self._spent[DURATION], sailing, water, self._with.speed_mps)
            if plan is not None:
                self._follow(plan)
        if homeward.is_finished or homeward.reason:
            return
        if self._is_sailed or homeward.has_room:
            self._make_plan()

    def _make_plan(self) -> None:
        self.outcome.plans += 1
        self._loiter(PLANNING_S)
        water = self._with.survey
        budget_m, home_m = self._homeward.bounds(self._here_m, self._here_m, water)
        request = PlanRequest(
            self._model,
            self._here_m,
            spots=6,
            lattice=(8, 8),
            reason="trial",
            seed=self._seed + self.outcome.plans,
            budget_m=budget_m,
            home_m=home_m,
            speed_mps=self._with.speed_mps,
        )
        try:
            plan = PLANNERS[self._with.planner](request, water)
            self._follow(self._homeward.fitted(plan, self._here_m, water))
        except (PlanningError, Unreachable):
            self._homeward.give_up()

    def _follow(self, plan: Plan) -> None:
        self._plan, self._next = plan, 0
        self._begin_leg()

    def _begin_leg(self) -> None:
        """Judge the leg that is begun by what it and the way home after it will cost without noise."""
        plan = self._plan
        if plan is None or self._next >= plan.survey_corners:
            return
        self.outcome.legs += 1
        corner = plan.route_m[self._next]
        way = self._homeward.way(corner, self._with.survey)
        left = self.outcome.usable - self._spent
        over = self._true_cost(np.vstack([self._here_m, way])) - left
        past = over > 0.0
        if past.any():
            self.outcome.overdrawn_legs.append(float((over[past] / np.abs(left[past])).max()))

    def _true_cost(self, points_m: FloatArray) -> FloatArray:
        cost = np.zeros(3)
        for a, b in pairwise(points_m):
            length_m = math.hypot(*(b - a))
            if length_m > 0.0:
                duration_s = length_m / self._speed_along((b - a) / length_m)
                battery = self._with.battery
                power_w = battery.hotel_w + battery.propulsion_w_per_m3s3 * self._with.speed_mps**3
                cost += (length_m, duration_s, power_w * duration_s)
        return cost

    def _speed_along(self, towards: FloatArray) -> float:
        """Made good over ground, crabbing in the current of here and now."""
        lat_deg, lon_deg = _FRAME.to_geodetic(self._here_m).tolist()
        east, north = self._with.current.current(lat_deg, lon_deg, self._spent[DURATION])
        aside = east * towards[1] - north * towards[0]
        speed = self._with.speed_mps
        made_good = east * towards[0] + north * towards[1] + math.sqrt(max(0.0, speed**2 - aside**2))
        return max(0.1 * speed, float(made_good))

    def _loiter(self, duration_s: float) -> None:
        self._with.battery.drain(0.0, duration_s)
        self._spend(0.0, duration_s)

    def _spend(self, length_m: float, duration_s: float) -> None:
        self._spent[DISTANCE] += length_m
        self._spent[DURATION] += duration_s
        self._spent[ENERGY] = self._with.battery.used_wh * 3600.0

    def _step(self) -> None:
        """Sail on for a step, or stay where the plan has ended."""
        if self._is_sailed:
            self._loiter(self._step_s)
            return
        assert self._plan is not None
        left_s = self._step_s
        while left_s > 1e-9 and not self._is_sailed:
            to = self._plan.route_m[self._next] - self._here_m
            length_m = math.hypot(*to)
            speed = self._speed_along(to / max(length_m, 1e-9))
            taken_s = min(left_s, length_m / speed)
            self._with.battery.drain(self._with.speed_mps, taken_s)
            self._here_m = self._here_m + to * (taken_s * speed / max(length_m, 1e-9))
            self._spend(taken_s * speed, taken_s)
            left_s -= taken_s
            if length_m - taken_s * speed < 0.5:
                self._next += 1
                self._begin_leg()
        self.outcome.track_m.append(self._here_m)

    def _is_at(self, place_m: FloatArray) -> bool:
        return path_length_m([self._here_m, place_m]) <= ACCEPTANCE_M
