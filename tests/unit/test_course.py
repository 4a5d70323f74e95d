"""Where a new plan begins, what is frozen before it, when it is worth it, and the stretches of a long route."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from autonomy.compiler import Handling, compile_mission
from autonomy.config import Configuration
from autonomy.course import STRETCH_RETRY_S, Course
from autonomy.dispatch import Dispatched
from autonomy.exploration import Trigger
from autonomy.geometry import LocalFrame
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from autonomy.seaway import Seaway

FRAME = LocalFrame(33.5, -118.5)
ISLAND = shapely.box(400, 400, 600, 600)
SURVEY = SurveyArea.from_geometry(FRAME, shapely.box(0, 0, 1000, 1000), land=ISLAND, passage_cells=40)
AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
CORNERS = np.array([(300.0, 100.0), (300.0, 300.0), (700.0, 300.0), (700.0, 900.0)])
SPEED_MPS = 2.0


def plan_of(corners, **fields) -> Plan:
    corners = np.asarray(corners, dtype=float).reshape(-1, 2)
    return Plan(np.array([100.0, 100.0]), corners, np.ones(len(corners), bool), 0.0, "test", "test", **fields)


class Headway:
    """What a course asks of the vessel's way; `position_m` and `next_row` say where it is."""

    def __init__(self, dispatch: SimpleNamespace) -> None:
        self._dispatch = dispatch
        self.position_m = np.array([100.0, 100.0])
        self.sailing_ours, self.path_finished, self.pace_mps, self.next_row = True, False, SPEED_MPS, 0
        self.acceptance_radius_m, self.distance_m = 5.0, 0.0

    def remaining_route_m(self):
        if not self.sailing_ours:
            return self.position_m[None]
        return np.vstack([self.position_m, self._dispatch.active.plan.route_m[self.next_row :]])

    def reach_m(self, delay_s: float) -> float:
        return SPEED_MPS * delay_s


class Helm:
    """What a course asks of the helm."""

    def __init__(self, plan: Plan, items: int | None = None) -> None:
        self.offered: list[Plan] = []
        self.dispatch = SimpleNamespace(active=None, busy=False)
        self.headway = Headway(self.dispatch)
        self.comes_on_board(plan, items)

    def comes_on_board(self, plan: Plan, items: int | None = None) -> None:
        mission = compile_mission(plan, FRAME, Handling(SPEED_MPS, 0.3, 100.0))
        self.dispatch.active, self.headway.next_row = Dispatched(plan, mission[:items]), 0

    def offer(self, plan: Plan) -> None:
        self.offered.append(plan)


class Sea:
    """A course, the vessel it is of, and the log."""

    def __init__(self, plan: Plan | None = None, items: int | None = None, **planning) -> None:
        configuration = Configuration.model_validate({"survey": {"area": AREA}, "planning": planning})
        self.helm = Helm(plan_of(CORNERS) if plan is None else plan, items)
        self.log: list[str] = []
        reporter = SimpleNamespace(log=lambda level, text: self.log.append(text))
        self.course = Course(configuration, self.helm, Seaway(configuration, SURVEY), reporter)  # type: ignore[arg-type]

    def usually_takes(self, planning_s: float) -> None:
        for reestimated in (False, True):
            self.course.took(planning_s, reestimated=reestimated)

    def sails_to(self, x: float, y: float, row: int) -> None:
        self.helm.headway.position_m, self.helm.headway.next_row = np.array([x, y]), row


@pytest.fixture
def sea() -> Sea:
    return Sea()


@pytest.mark.parametrize(
    ("planning_s", "start", "row"),
    [(49.7, (200.0, 100.0), 0), (149.7, (300.0, 200.0), 1), (1e4, (700.0, 900.0), 4)],
)
def test_a_plan_begins_where_the_boat_will_be_and_replaces_what_comes_after(sea, planning_s, start, row):
    sea.usually_takes(planning_s)  # and 0.3 s for the upload, at 2 m/s
    departure = sea.course.begin(reestimates=False)
    np.testing.assert_allclose(departure.start_m, start, atol=1e-6)
    np.testing.assert_array_equal(departure.remainder_m, CORNERS[row:])
    assert len(departure.remainder_is_spot) == len(departure.remainder_m)


def test_plans_with_a_re_estimate_take_their_own_time(sea):
    sea.course.took(10.0, reestimated=False)
    sea.course.took(50.0, reestimated=True)
    short = sea.course.begin(reestimates=False).start_m
    long = sea.course.begin(reestimates=True).start_m
    np.testing.assert_allclose(long - short, (80.0, 0.0), atol=1e-6)


def test_a_boat_that_is_not_ours_is_expected_where_it_is(sea):
    sea.helm.headway.sailing_ours = False
    departure = sea.course.begin(reestimates=False)
    np.testing.assert_array_equal(departure.start_m, sea.helm.headway.position_m)
    assert departure.mission is None


def test_a_finished_path_leaves_nothing(sea):
    sea.helm.headway.path_finished = True
    sea.sails_to(700.0, 900.0, 4)
    assert not len(sea.course.begin(reestimates=False).remainder_m)


def test_corners_in_closed_water_and_the_way_home_are_not_left_over():
    corners = [*CORNERS[:2], (500.0, 500.0), *CORNERS[2:]]
    sea = Sea(plan_of(corners, home_corners=1))
    np.testing.assert_array_equal(sea.course.begin(reestimates=False).remainder_m, CORNERS[:3])


def test_the_frozen_corners_ahead_come_before_the_new_plan(sea):
    sea.usually_takes(149.7)
    departure = sea.course.begin(reestimates=False)  # beyond the first corner
    new = dataclasses.replace(plan_of([(100.0, 900.0)]), start_m=departure.start_m)
    sea.sails_to(200.0, 100.0, 0)  # earlier than expected
    joined = sea.course.joined(new)
    np.testing.assert_allclose(joined.route_m, [CORNERS[0], (300.0, 200.0), (100.0, 900.0)])
    assert joined.is_spot.tolist() == [True, False, True]
    np.testing.assert_array_equal(joined.start_m, sea.helm.headway.position_m)


@pytest.mark.parametrize(
    ("x", "y", "row"),
    [(300.0, 150.0, 1), (300.0, 250.0, 1), (297.0, 100.0, 0)],
    ids=["early, on the same leg", "late", "at the corner"],
)
def test_the_boat_never_sails_back_to_where_it_was_expected(sea, x, y, row):
    sea.usually_takes(149.7)
    departure = sea.course.begin(reestimates=False)
    new = dataclasses.replace(plan_of([(100.0, 900.0)]), start_m=departure.start_m)
    sea.sails_to(x, y, row)
    np.testing.assert_array_equal(sea.course.joined(new).route_m, [(100.0, 900.0)])


def test_after_another_mission_nothing_is_frozen(sea):
    sea.usually_takes(149.7)
    departure = sea.course.begin(reestimates=False)
    sea.helm.comes_on_board(plan_of([(900.0, 100.0)]))
    new = dataclasses.replace(plan_of([(100.0, 900.0)]), start_m=departure.start_m)
    np.testing.assert_array_equal(sea.course.joined(new).route_m, [(100.0, 900.0)])


def test_land_between_the_boat_and_the_new_plan_is_rounded(sea):
    sea.course.begin(reestimates=False)
    sea.sails_to(500.0, 300.0, 2)
    joined = sea.course.joined(plan_of([(500.0, 700.0)]))
    assert len(joined.route_m) > 1
    way = shapely.LineString([sea.helm.headway.position_m, *joined.route_m])
    assert not way.crosses(ISLAND)


def test_the_rest_of_the_plan_is_sailed_without_corners_that_have_been_closed(sea):
    sea.sails_to(250.0, 300.0, 1)
    seaway = sea.course._seaway
    seaway.give_up(0.0, np.array([250.0, 300.0]), CORNERS[1])
    seaway.refresh(1.0)
    sea.course.watch(1.0)
    (rest,) = sea.helm.offered
    assert not (rest.route_m == CORNERS[1]).all(axis=1).any()
    np.testing.assert_array_equal(rest.route_m[-2:], CORNERS[2:])
    assert sea.log == ["land lies before the vessel: the mission goes round it"]


def test_only_the_leg_home_may_leave_the_survey():
    seaway = Sea().course._seaway
    out = np.array([(300.0, 100.0), (300.0, -200.0)])
    assert seaway.is_open(out, ends_home=True)
    assert not seaway.is_open(out)
    assert not seaway.is_open(np.vstack([out, out]), ends_home=True)
    assert not seaway.is_open(np.array([(300.0, 500.0), (700.0, 500.0)]), ends_home=True)
    assert seaway.is_open(out[1:], ends_home=True)


def gain(
    before, after, trigger=Trigger.NOVELTY, minimum_gain=0.05, prepare=lambda sea: None
) -> tuple[bool, list[str]]:
    sea = Sea(minimum_gain=minimum_gain)
    sea.course.begin(reestimates=True)
    prepare(sea)
    new = dataclasses.replace(plan_of([(100.0, 900.0)]), objective_before=before, objective_after=after)
    return sea.course.keeps(new, trigger), sea.log


def test_a_small_gain_does_not_change_the_course_and_is_said_once():
    assert gain(1.0, 0.96) == (True, ["the course is kept (test): a new plan would gain 4.0 %"])
    assert gain(1.0, 0.94) == (False, [])
    assert gain(1.0, 1.2) == (True, ["the course is kept (test): a new plan would gain 0.0 %"])
    assert gain(-1.0, -1.04)[0]
    assert not gain(-1.0, -1.06)[0]
    assert not gain(1.0, 1.0, minimum_gain=0.0)[0]


@pytest.mark.parametrize("before_and_after", [(None, 0.9), (1.0, None), (None, None)])
def test_planners_that_cannot_tell_are_followed(before_and_after):
    assert not gain(*before_and_after)[0]


@pytest.mark.parametrize(
    "trigger",
    [
        Trigger.FIRST_PLAN,
        Trigger.PATH_FINISHED,
        Trigger.DAMAGED,
        Trigger.FENCE,
        Trigger.STALLED,
        Trigger.RESUMED,
    ],
)
def test_who_must_have_a_new_plan_gets_it(trigger):
    assert not gain(1.0, 1.0, trigger)[0]


def test_a_course_that_is_not_sailed_any_more_cannot_be_kept():
    assert gain(1.0, 1.0)[0]
    assert not gain(1.0, 1.0, prepare=lambda sea: setattr(sea.helm.headway, "sailing_ours", False))[0]
    assert not gain(1.0, 1.0, prepare=lambda sea: setattr(sea.helm.headway, "path_finished", True))[0]
    assert not gain(1.0, 1.0, prepare=lambda sea: sea.helm.comes_on_board(plan_of(CORNERS)))[0]


def test_the_next_stretch_is_sent_in_time_and_again_if_it_got_lost():
    corners = np.column_stack([100.0 + 30.0 * np.arange(28), np.full(28, 100.0)])
    sea = Sea(plan_of(corners), items=20)
    sea.course.watch(0.0)
    assert not sea.helm.offered
    sea.sails_to(425.0, 100.0, 11)  # the twentieth corner is at 670 m, and two minutes take 240 m
    sea.course.watch(5.0)
    assert not sea.helm.offered
    sea.sails_to(435.0, 100.0, 12)
    sea.course.watch(10.0)
    (rest,) = sea.helm.offered
    np.testing.assert_array_equal(rest.route_m, corners[12:])
    sea.course.watch(10.0 + 0.5 * STRETCH_RETRY_S)
    assert len(sea.helm.offered) == 1
    sea.course.watch(11.0 + STRETCH_RETRY_S)
    assert len(sea.helm.offered) == 2
    sea.helm.comes_on_board(rest)
    sea.course.watch(12.0 + 3.0 * STRETCH_RETRY_S)
    assert len(sea.helm.offered) == 2


def test_what_was_sailed_counts_from_the_last_plan_as_a_share_of_the_longest(sea):
    assert sea.course.sailed_share == 0.0
    sea.course.offer(0.0, plan_of([(100.0, 600.0)]))  # 500 m
    sea.course.offer(1.0, plan_of([(100.0, 200.0)]))
    sea.helm.headway.distance_m = 200.0
    assert sea.course.sailed_share == pytest.approx(0.4)
    sea.course.begin(reestimates=False)
    sea.helm.headway.distance_m = 300.0
    assert sea.course.sailed_share == pytest.approx(0.2)


def test_the_time_of_uploads_is_measured(sea):
    before_m = sea.course.begin(reestimates=False).start_m
    sea.course.offer(100.0, sea.helm.dispatch.active.plan)
    sea.course.watch(110.0)
    after_m = sea.course.begin(reestimates=False).start_m
    assert after_m[0] - before_m[0] == pytest.approx(SPEED_MPS * 0.5 * (10.0 - 0.3))


def test_land_on_the_way_to_the_waypoint_is_told_until_the_way_is_clear(sea):
    sea.sails_to(700.0, 500.0, 3)
    assert sea.course.watch(1.0) is None
    sea.helm.headway.next_row = 0
    sea.helm.headway.position_m = np.array([900.0, 900.0])  # the first corner lies behind the island
    alarm = sea.course.watch(2.0)
    assert (alarm.text, alarm.is_critical) == ("land ahead, goes round it", False)
    assert sea.course.trouble == "land lies before the vessel: the mission goes round it"
    (way,) = sea.helm.offered
    assert not shapely.LineString([sea.helm.headway.position_m, *way.route_m]).crosses(ISLAND)
    sea.helm.comes_on_board(way)
    assert sea.course.watch(3.0) is None
    assert sea.course.trouble is None


def test_a_boat_on_land_is_an_alarm_twice_a_minute(sea):
    sea.sails_to(500.0, 500.0, 0)
    told = [second for second in range(65) if sea.course.watch(float(second)) is not None]
    assert told == [0, 30, 60]
    assert not sea.helm.offered
    assert all("no way round" in line for line in sea.log)


def test_only_a_boat_that_was_moved_is_asked_whether_its_mission_begins_across_land(sea):
    assert not sea.course.begins_across_land(0.0)
    sea.helm.dispatch.active = dataclasses.replace(
        sea.helm.dispatch.active, plan=dataclasses.replace(plan_of(CORNERS), start_m=np.array([880.0, 880.0]))
    )
    sea.helm.headway.position_m = np.array([900.0, 900.0])
    assert not sea.course.begins_across_land(2.0)
    sea.helm.headway.position_m = np.array([900.0, 960.0])
    assert not sea.course.begins_across_land(2.5)  # not yet again
    assert sea.course.begins_across_land(4.0)
    sea.helm.headway.position_m = np.array([300.0, 900.0])
    assert not sea.course.begins_across_land(6.0)
