"""Where plans are cut, when the vessel turns homeward, and where home is: values worked out by hand."""

import numpy as np
import pytest
import shapely

from autonomy.budget import Reading, Stage
from autonomy.config import Configuration
from autonomy.geometry import FloatArray, LocalFrame, path_length_m
from autonomy.homeward import Homeward, Sailing
from autonomy.planning.passage import Unreachable
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(36.6, -122.0)
SEA = SurveyArea.from_geometry(FRAME, shapely.box(-1000.0, -1000.0, 5000.0, 1000.0), passage_cells=60)
WALL = shapely.box(1000.0, -600.0, 1200.0, 1000.0)
WALLED = SurveyArea.from_geometry(
    FRAME, shapely.box(-1000.0, -1000.0, 5000.0, 1000.0), land=WALL, standoff_m=50.0, passage_cells=60
)
CORNERS = [
    FRAME.to_geodetic(corner).tolist() for corner in ((-1e3, -1e3), (5e3, -1e3), (5e3, 1e3), (-1e3, 1e3))
]
ORIGIN = np.zeros(2)


def homeward(water: SurveyArea = SEA, **budget: object) -> Homeward:
    """Begun at the origin, which is home; nothing is kept in reserve."""
    settings = {"survey": {"area": CORNERS}, "budget": {"reserve": 0.0, **budget}}
    made = Homeward(Configuration.model_validate(settings), water)
    made.told_home(ORIGIN)
    tell(made, 0.0, ORIGIN, 0.0)
    return made


def tell(made: Homeward, time_s: float, point_m: FloatArray, sailed_m: float, **told: float) -> None:
    made.follow(Reading(time_s, point_m, sailed_m, **told), armed=True, commanded=True)  # type: ignore[arg-type]


def route(*corners: tuple[float, float], start: FloatArray = ORIGIN) -> Plan:
    return Plan(start, np.array(corners), np.ones(len(corners), dtype=bool), 1.0, "test", "test")


def sailing(plan: Plan, here_m: FloatArray, row: int = 0, *, finished: bool = False) -> Sailing:
    return Sailing(plan, np.vstack([here_m, plan.route_m[row:]]), finished)


def test_without_a_budget_plans_stay_as_they_are() -> None:
    endless, plan = homeward(), route((4000.0, 0.0), (0.0, 900.0))
    assert not endless.is_limited
    assert endless.fitted(plan, ORIGIN, SEA) is plan
    assert endless.bounds(ORIGIN, ORIGIN, SEA) == (None, None)
    assert endless.watch(0.0, sailing(plan, ORIGIN), SEA, 1.5) is None


def test_an_affordable_plan_stays_as_it_is() -> None:
    plan = route((1000.0, 0.0), (1000.0, 500.0))
    assert homeward(distance_m=1e4).fitted(plan, ORIGIN, SEA) is plan


def test_a_plan_is_cut_where_the_way_home_is_paid_with_its_margin() -> None:
    """Straight out and back: 1.02 x + (1.2 + 0.03) x = 3000."""
    cut = homeward(distance_m=3000.0).fitted(route((500.0, 0.0), (4000.0, 0.0)), ORIGIN, SEA)
    x = 3000.0 / (1.02 + 1.23)
    np.testing.assert_allclose(cut.route_m, [(500.0, 0.0), (x, 0.0), (0.0, 0.0)], atol=3500.0 / 2**8)
    assert cut.route_m[1, 0] <= x
    assert (cut.home_corners, cut.survey_corners) == (1, 2)
    assert cut.is_spot.tolist() == [True, False, False]


def test_the_way_home_is_over_water() -> None:
    made = homeward(WALLED, distance_m=6500.0)
    cut = made.fitted(route((900.0, -800.0), (2000.0, -800.0), (2000.0, 900.0)), ORIGIN, WALLED)
    assert cut.home_corners >= 2
    assert WALLED.legs_are_clear(np.vstack([ORIGIN, cut.route_m[:-1]]), cut.route_m).all()
    out = path_length_m(np.vstack([ORIGIN, cut.route_m[: cut.survey_corners]]))
    back = path_length_m(cut.route_m[cut.survey_corners - 1 :])
    assert 1.02 * out + 1.23 * back == pytest.approx(6500.0, rel=0.01)


def test_a_home_on_land_is_taken_for_the_nearest_water() -> None:
    made = homeward(WALLED, distance_m=9000.0)
    made.told_home(np.array([1100.0, 0.0]))
    way = made.way(np.array([3000.0, 0.0]), WALLED)
    assert WALLED.is_navigable(way[-1])[0]
    assert np.hypot(*(way[-1] - [1100.0, 0.0])) < 100.0 + 50.0 + 142.0  # half the wall, stand-off, a cell
    assert "no way over water leads home" in made.take_notes()[-1].text


def test_from_land_there_is_no_way_home() -> None:
    with pytest.raises(Unreachable):
        homeward(WALLED, distance_m=9000.0).way(np.array([1100.0, 0.0]), WALLED)


def test_a_harbour_outside_the_area_is_left_and_entered_straight() -> None:
    made = homeward(distance_m=9000.0)
    made.told_home(np.array([0.0, -1200.0]))
    np.testing.assert_array_equal(made.way(np.array([30.0, -1100.0]), SEA), [(30.0, -1100.0), (0.0, -1200.0)])
    assert path_length_m(made.way(np.array([0.0, 0.0]), SEA)) == pytest.approx(1200.0, rel=0.02)


def test_the_next_leg_is_begun_only_if_the_way_home_can_follow() -> None:
    """At x = 980 with 2420 left: 20 + 600 and 1.2 · 1600 after it are 1.02 · 620 + 1920 = 2552."""
    made, plan = homeward(distance_m=3400.0), route((1000.0, 0.0), (1600.0, 0.0), (2200.0, 0.0))
    here = np.array([980.0, 0.0])
    tell(made, 500.0, here, 980.0)
    instead = made.watch(500.0, sailing(plan, here), SEA, 2.0)
    assert instead is not None
    np.testing.assert_array_equal(instead.route_m[0], (1000.0, 0.0))
    x = instead.route_m[1, 0]
    assert 1.02 * (x - 980.0) + 1.23 * x == pytest.approx(2420.0, abs=8.0)
    assert instead.home_corners == 1
    assert not made.reason  # it still surveys
    richer = homeward(distance_m=3600.0)
    tell(richer, 500.0, here, 980.0)
    assert richer.watch(500.0, sailing(plan, here), SEA, 2.0) is None


def test_low_turns_back_on_the_leg_and_critical_is_louder() -> None:
    """At x = 1000: 1.1 · 1000 is low, 1000 critical."""
    plan = route((3000.0, 0.0), (3000.0, 500.0))
    here = np.array([1000.0, 0.0])
    made = homeward(distance_m=3000.0)
    tell(made, 500.0, here, 1890.0)  # 1110 left
    assert made.watch(500.0, sailing(plan, here), SEA, 2.0) is None
    tell(made, 510.0, here, 1905.0)
    back = made.watch(510.0, sailing(plan, here), SEA, 2.0)
    assert back is not None
    np.testing.assert_array_equal(back.route_m, [ORIGIN])
    assert (made.stage, back.home_corners, made.is_returning) == (Stage.LOW, 1, True)
    assert made.reason == "low: 1.1 km left to spend, the way home takes 1.0 km"
    assert not made.may_be_sent_home
    tell(made, 520.0, here, 2001.0)
    assert made.watch(520.0, sailing(back, here), SEA, 2.0) is None  # nothing better to sail
    assert made.stage is Stage.CRITICAL
    assert made.may_be_sent_home
    assert [note.is_warning for note in made.take_notes()] == [False, True, True]


def test_the_charge_turns_back_too() -> None:
    made, plan = homeward(low_battery=0.3, critical_battery=0.2), route((3000.0, 0.0))
    here = np.array([1000.0, 0.0])
    tell(made, 500.0, here, 1000.0, charge=0.31)
    assert made.watch(500.0, sailing(plan, here), SEA, 2.0) is None
    tell(made, 510.0, here, 1020.0, charge=0.3)
    assert made.watch(510.0, sailing(plan, here), SEA, 2.0) is not None
    assert made.reason == "low: the battery is at 30%"
    assert made.bounds(here, here, SEA) == (None, None)


def test_home_behind_land_is_not_for_the_autopilots_straight_line() -> None:
    made, plan = homeward(WALLED, distance_m=3000.0), route((3000.0, 0.0))
    tell(made, 500.0, np.array([2000.0, 0.0]), 2900.0)
    assert made.watch(500.0, sailing(plan, np.array([2000.0, 0.0])), WALLED, 2.0) is not None
    assert made.stage is Stage.CRITICAL
    assert not made.may_be_sent_home


def test_the_survey_ends_at_home_and_another_begins_after_disarming() -> None:
    made = homeward(distance_m=3000.0)
    plan = made.plan(np.array([500.0, 0.0]), SEA, "done")
    tell(made, 900.0, ORIGIN, 2900.0)
    assert made.watch(900.0, sailing(plan, ORIGIN, 1, finished=True), SEA, 2.0) is None
    assert made.is_finished
    tell(made, 910.0, ORIGIN, 2900.0)
    assert made.is_finished
    made.follow(Reading(920.0, ORIGIN, 2900.0), armed=False, commanded=False)
    tell(made, 930.0, ORIGIN, 2900.0)
    assert not made.is_finished
    assert (made.stage, made.reason) == (Stage.FINE, "")
    assert made.budget.metres() == pytest.approx(3000.0)


def test_much_to_spare_on_the_way_home_asks_for_another_plan() -> None:
    made = homeward(distance_m=3000.0)
    here = np.array([500.0, 0.0])
    plan = made.plan(here, SEA, "cut")
    tell(made, 500.0, here, 2100.0)  # 900 left, 1.23 · 500 for the way home: nearly a tenth to spare
    made.watch(500.0, sailing(plan, here), SEA, 2.0)
    assert (made.is_returning, made.has_room) == (True, True)
    again = homeward(distance_m=3000.0)
    tell(again, 500.0, here, 2290.0)
    again.watch(500.0, sailing(plan, here), SEA, 2.0)
    assert (again.is_returning, again.has_room) == (True, False)
    near = np.array([10.0, 0.0])
    tell(again, 900.0, near, 2780.0)  # 0.07 to spare, less 0.23 · 500 that were margin
    again.watch(900.0, sailing(plan, near), SEA, 2.0)
    assert not again.has_room
    tell(again, 910.0, near, 2600.0)
    again.watch(910.0, sailing(plan, near), SEA, 2.0)
    assert again.has_room


def test_when_no_leg_can_be_paid_the_way_home_is_all_there_is() -> None:
    made = homeward(distance_m=3000.0)
    here = np.array([1000.0, 0.0])
    tell(made, 500.0, here, 1765.0)  # 1235 left, 1.23 · 1000 for the way home
    cut = made.fitted(route((3000.0, 0.0), start=here), here, SEA)
    assert cut.survey_corners == 0
    assert made.reason == "what may still be spent is not enough for another leg"


def test_what_a_planner_may_use() -> None:
    """From 1000 m east: 2500 left, 0.23 · 1000 more than the way home must stay, 1 m in 50 is lost on the way."""
    made = homeward(distance_m=3000.0)
    here, start = np.array([950.0, 0.0]), np.array([1000.0, 0.0])
    tell(made, 500.0, here, 450.0)
    budget_m, home_m = made.bounds(here, start, SEA)
    assert budget_m == pytest.approx((2550.0 - 50.0 - 230.0) / 1.02)
    np.testing.assert_array_equal(home_m, ORIGIN)
