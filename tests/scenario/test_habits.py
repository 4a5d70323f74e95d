"""Autopilots as they are: each of their habits, and the survey goes on, or yields where it must."""

from dataclasses import fields
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.autopilot import MissionState, Mode, Options

from .conftest import FRAME, HARBOUR_M, boat

WEST_HALF = ((-200.0, -400.0), (1200.0, -400.0), (1200.0, 2600.0), (-200.0, 2600.0))
INSIDE = shapely.Polygon(WEST_HALF)
WRAP_S = 2**32 / 1000.0


NO_HABITS = {"system_id", "speed_mps", "waypoint_radius_m", "start_utc_s"}


@pytest.mark.parametrize("habit", [field.name for field in fields(Options) if field.name not in NO_HABITS])
def test_each_habit_of_the_simulated_autopilot_has_a_scenario(habit):
    """Named where it is switched on; whoever gives it another habit shows what comes of it."""
    scenarios = [path.read_text() for path in Path(__file__).parent.glob("test_*.py")]
    assert any(f"{habit}=" in text or f'"{habit}"' in text for text in scenarios)


def track_of(voyage, duration_s, step_s=2.0):
    """Where the boat sails, shape (n, 2), local metres."""
    places = []
    for _ in range(int(duration_s / step_s)):
        voyage.advance(step_s)
        places.append(FRAME.to_local(*voyage.autopilot.vessel.position))
    return np.array(places)


@pytest.mark.parametrize("habit", ["as ArduPilot", "request_int"])
def test_whoever_asks_for_items_in_his_own_way_gets_the_mission(make_voyage, habit):
    voyage = make_voyage(boat(**({} if habit == "as ArduPilot" else {habit: True})))
    voyage.start()
    voyage.until("verified on board")
    assert (abs(voyage.on_board_m() - voyage.plan_m()) < 0.05).all()
    assert voyage.verified == 2
    assert voyage.samples > 20


def test_items_that_arrive_twice_are_answered_13_and_the_upload_goes_on(make_voyage):
    voyage = make_voyage()
    receive = voyage._router.receive

    def twice(now, client, data):
        first = receive(now, client, data)
        return first + receive(now, client, data) if client == "core" and data[7] == 73 else first

    voyage._router.receive = twice
    voyage.start()
    voyage.until("plan 2")
    assert voyage.advance(30.0, until=lambda: voyage.verified == 2)
    assert not voyage.lines("transfer failed")


def test_an_upload_that_an_item_out_of_turn_has_ended_is_begun_again(make_voyage):
    voyage = make_voyage(boat(ends_on_wrong_item=True))
    receive, items = voyage._router.receive, count()

    def third_twice(now, client, data):
        first = receive(now, client, data)
        again = client == "core" and data[7] == 73 and next(items) == 2
        return first + receive(now, client, data) if again else first

    voyage._router.receive = third_twice
    voyage.start()
    assert not voyage.lines("given up")
    assert len(voyage.said("MISSION_COUNT")) == 2
    assert (abs(voyage.on_board_m() - voyage.plan_m()) < 0.05).all()


@pytest.mark.parametrize("atomic", [False, True])
def test_an_upload_that_dies_half_way_is_read_back_and_sent_again(make_voyage, atomic):
    """The boat sails a hybrid of old and new items until then, or the old ones; nothing is believed of it."""
    voyage = make_voyage(boat(atomic_uploads=atomic))
    voyage.start()
    before = voyage.on_board_m()
    voyage.stall_upload_after(3)
    voyage.until("mission transfer failed", patience_s=3000.0)
    died = voyage.now
    assert not voyage.core._helm.headway.sailing_ours
    left = voyage.on_board_m()
    assert left.shape != voyage.plan_m().shape or not np.allclose(left, voyage.plan_m(), atol=0.1)
    assert np.array_equal(left, before) == atomic
    voyage.unstall()
    assert voyage.advance(60.0, until=lambda: voyage.verified == 2)
    assert len(voyage.plans) == 2, "it is this one that was sent again, not a later one"
    kinds = voyage.traffic(since=died)
    assert kinds.index("MISSION_REQUEST_LIST") < kinds.index("MISSION_COUNT")
    assert (abs(voyage.on_board_m() - voyage.plan_m(voyage.verified - 1)) < 0.05).all()
    assert voyage.autopilot.navigator.current == 1


def test_a_new_mission_under_way_is_sailed_from_its_first_waypoint_though_the_index_was_kept(voyage):
    assert voyage.advance(900.0, until=lambda: voyage.autopilot.navigator.current >= 3)
    voyage.until("plan 2")
    assert voyage.advance(20.0, until=lambda: voyage.verified == 2)
    assert voyage.autopilot.navigator.current == 1


def test_a_mission_that_was_complete_is_followed_by_one_that_is_sailed(make_voyage):
    voyage = make_voyage(exploration={"rho0": 1.0})
    voyage.start()
    voyage.until("(path finished)")
    assert voyage.lines("Mission Complete")
    sailed = voyage.autopilot.vessel.distance_sailed_m
    assert voyage.advance(120.0, until=lambda: voyage.verified == 2)
    voyage.advance(60.0)
    assert voyage.autopilot.navigator.mission_state is MissionState.ACTIVE
    assert voyage.autopilot.vessel.distance_sailed_m > sailed + 200.0


def test_a_boat_that_does_not_make_for_the_first_waypoint_is_told_again(make_voyage):
    """DO_SET_MISSION_CURRENT is accepted, and the boat sails on along the index that it had."""
    # Twice: the next mission goes round the land that lies before the boat.
    voyage = make_voyage(boat(deaf_to_set_current=2))
    voyage.start()
    voyage.until("plan 2")
    voyage.job_s = 100.0  # the plan that is made then shall come too late to help
    assert voyage.advance(20.0, until=lambda: voyage.verified == 2)
    assert voyage.autopilot.navigator.current > 1
    begun = voyage.now
    assert voyage.advance(60.0, until=lambda: voyage.autopilot.navigator.current == 1)
    assert len(voyage.plans) == 2, "it is this mission that was made current, not a later one"
    assert voyage.advance(600.0, until=lambda: bool(voyage.lines("Reached waypoint #1", since=begun)))


def test_plans_stay_inside_the_fence_and_the_boat_never_meets_it(make_voyage):
    voyage = make_voyage()
    voyage.fence(*WEST_HALF)
    voyage.start()
    assert voyage.lines("the autopilot has a fence of 1 zone")
    track = track_of(voyage, 900.0)
    assert len(voyage.plans) >= 2
    for k in range(len(voyage.plans)):
        route = [FRAME.to_local(*voyage.plans[k].start_deg), *voyage.plan_m(k)]
        assert all(INSIDE.buffer(-19.9).covers(shapely.LineString(leg)) for leg in pairwise(route[1:]))
        assert INSIDE.covers(shapely.LineString(route[:2]))
    assert not voyage.lines("does not get to")
    assert (np.hypot(*np.diff(track, axis=0).T) > 0.0).all()


@pytest.mark.parametrize("stops", [True, False])
def test_a_fence_that_comes_under_way_is_kept_too(voyage, stops):
    voyage.advance(30.0)
    voyage.fence(*WEST_HALF, stops_the_boat=stops)
    voyage.autopilot.parameters.set("FENCE_TOTAL", 4.0)
    voyage.autopilot._announce(voyage.autopilot.parameters.message("FENCE_TOTAL"))
    plans = len(voyage.plans)
    assert voyage.advance(60.0, until=lambda: len(voyage.plans) > plans)
    voyage.advance(20.0)
    assert all(INSIDE.covers(shapely.Point(point)) for point in voyage.on_board_m())
    track_of(voyage, 400.0)
    assert voyage.autopilot.navigator.mode is Mode.AUTO


def test_a_fence_that_leaves_no_water_is_told_and_nothing_is_planned(make_voyage):
    voyage = make_voyage()
    voyage.fence((-400.0, -400.0), (-100.0, -400.0), (-100.0, -100.0))
    voyage.advance(60.0)
    assert not voyage.plans
    assert "no navigable water is left" in voyage.health.reason


def test_a_circle_about_home_is_a_fence(make_voyage):
    voyage = make_voyage()
    for name, value in {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 2.0, "FENCE_RADIUS": 1500.0}.items():
        voyage.autopilot.parameters.set(name, value)
    voyage.start()
    voyage.advance(300.0)
    home = np.array(HARBOUR_M)
    assert np.hypot(*(voyage.on_board_m() - home).T).max() < 1500.0
    assert not voyage.lines("does not get to")


def test_failsafes_that_are_off_are_told(make_voyage):
    voyage = make_voyage()
    voyage.advance(10.0)
    assert voyage.lines("the failsafe for a lost ground station is off (FS_GCS_ENABLE 0)")
    assert voyage.lines("a low battery has no consequence (BATT_FS_LOW_ACT 0)")
    assert not voyage.lines("FS_THR_ENABLE")


def test_they_are_read_again_after_a_reboot(voyage):
    voyage.advance(100.0)
    voyage.reboot()
    voyage.fence(*WEST_HALF)
    booted = voyage.now
    voyage.until("the autopilot has a fence of 1 zone", patience_s=30.0)
    assert len(voyage.said("PARAM_REQUEST_READ", since=booted)) >= 10


def test_after_a_reboot_in_mid_mission_nothing_is_commanded_until_the_operator_starts_it_again(make_voyage):
    voyage = make_voyage(boat(reboots_after_s=150.0))
    voyage.start()
    assert voyage.advance(200.0, until=lambda: not voyage.autopilot.navigator.armed)
    booted, samples, mission = voyage.now, voyage.samples, voyage.on_board_m()
    voyage.advance(60.0)
    assert voyage.core._helm.telemetry.reboots == 1
    assert voyage.lines("on board: our mission is on board", since=booted - 1.0)
    assert (voyage.on_board_m() == mission).all()
    assert not voyage.autopilot.navigator.armed
    assert voyage.autopilot.navigator.mode is Mode.MANUAL
    voyage.arm()
    voyage.select(Mode.AUTO)
    voyage.until("exploring", patience_s=60.0)
    voyage.advance(100.0)
    assert voyage.samples > samples + 5
    assert voyage.health.model_time_s > 250.0  # goes on, though the vehicle's clock began anew


def test_a_boat_that_stops_at_a_fence_nobody_told_us_of_sails_elsewhere(make_voyage):
    voyage = make_voyage(boat(tells_fence=False))
    voyage.fence(*WEST_HALF)
    voyage.start()
    voyage.until("the boat is in AUTO and does not get to", patience_s=600.0)
    stopped = FRAME.to_local(*voyage.autopilot.vessel.position)
    assert stopped[0] > 1150.0
    target = voyage.core._seaway.restrictions.given_up[0]
    assert "stalled" in str(voyage.said("STATUSTEXT")[-1].text)
    verified = voyage.verified
    assert voyage.advance(30.0, until=lambda: voyage.verified > verified)
    disc = shapely.Point(target.corners_m[0]).buffer(0.99 * target.radius_m)
    assert not any(disc.covers(shapely.Point(point)) for point in voyage.on_board_m())
    samples = voyage.samples
    voyage.advance(900.0)
    assert voyage.samples > samples


def test_water_given_up_is_taken_up_again(make_voyage):
    voyage = make_voyage(boat(tells_fence=False), exploration={"give_up_s": 200.0})
    voyage.fence(*WEST_HALF)
    voyage.start()
    voyage.until("is given up for 3 min")
    assert voyage.core._seaway.restrictions.given_up
    voyage.fence((-9e3, -9e3), (9e3, -9e3), (9e3, 9e3), (-9e3, 9e3))
    voyage.advance(210.0)
    assert not voyage.core._seaway.restrictions.given_up


def test_nothing_is_planned_before_the_estimator_is_ready(make_voyage):
    voyage = make_voyage(boat(ready_after_s=42.0))
    voyage.advance(41.0)
    assert not voyage.plans
    voyage.start()
    assert voyage.health.state == "exploring"


def test_the_clock_wraps_in_mid_survey(make_voyage):
    voyage = make_voyage(boat(boot_clock_s=WRAP_S - 150.0))
    voyage.start()
    voyage.advance(100.0)
    samples, verified = voyage.samples, voyage.verified
    voyage.advance(200.0)
    assert voyage.autopilot.reports.time_boot_ms < 300_000
    assert voyage.health.model_time_s > WRAP_S
    assert voyage.core._helm.telemetry.reboots == 0
    assert voyage.samples > samples + 15
    assert voyage.health.state == "exploring"
    assert not voyage.lines("mission on board has not been read", since=voyage.now - 200.0)
    assert verified <= voyage.verified


@pytest.mark.parametrize("mode", ["missions", "observe"])
def test_a_probe_that_is_routed_to_those_who_spoke_is_heard(make_voyage, mode):
    voyage = make_voyage(boat(probe_component=158), authority={"mode": mode})
    if mode == "missions":
        voyage.start()
    else:
        voyage.upload_as_operator((300.0, 300.0), (800.0, 1800.0), (2500.0, 2000.0))
        voyage.advance(5.0)
        voyage.arm()
        voyage.select(Mode.AUTO)
    voyage.advance(300.0)
    assert voyage.samples > 15


@pytest.mark.parametrize("action", [2.0, 1.0])
def test_the_ground_stations_failsafe_takes_the_boat_and_the_operator_gives_it_back(voyage, action):
    voyage.advance(100.0)
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    voyage.operate(beat)
    voyage.autopilot.parameters.set("FS_GCS_ENABLE", 1.0)
    voyage.autopilot.parameters.set("FS_ACTION", action)
    voyage.until("a failsafe has the boat", patience_s=30.0)
    struck = voyage.now
    voyage.operate(beat)  # the link is back, the mode stays
    voyage.advance(4.0)
    voyage.operate(beat)
    voyage.advance(4.0)
    assert voyage.autopilot.navigator.mode in (Mode.HOLD, Mode.RTL)
    assert voyage.traffic(since=struck) == []
    assert voyage.health.state == "yielded"
    said = [str(each.text) for each in voyage.said("STATUSTEXT", since=struck - 1.0)]
    assert any("failsafe has the boat" in text for text in said)
    voyage.autopilot.parameters.set("FS_GCS_ENABLE", 0.0)
    voyage.select(Mode.AUTO)
    voyage.until("exploring: in AUTO under our mission")


def test_an_upload_that_restarts_the_mission_by_itself_is_sailed_from_its_first_waypoint_too(make_voyage):
    voyage = make_voyage(boat(restarts_on_upload=True))
    voyage.start()
    assert voyage.advance(900.0, until=lambda: voyage.autopilot.navigator.current >= 3)
    voyage.until("plan 2")
    assert voyage.advance(20.0, until=lambda: voyage.verified == 2)
    assert voyage.autopilot.navigator.current == 1
    begun = voyage.now
    assert voyage.advance(600.0, until=lambda: bool(voyage.lines("Reached waypoint #1", since=begun)))


def test_an_autopilot_that_is_not_ready_to_be_armed_is_armed_when_it_is(make_voyage):
    """It refuses with MAV_RESULT_FAILED; nobody else is there to arm it."""
    voyage = make_voyage(boat(arming_checks=True, ready_after_s=60.0), authority={"mode": "full"})
    voyage.advance(59.0)
    assert not voyage.autopilot.navigator.armed
    assert voyage.advance(60.0, until=lambda: bool(voyage.lines("exploring: in AUTO under our mission")))
    assert voyage.autopilot.navigator.armed


def test_while_another_station_uploads_ours_waits_and_does_not_lose_its_turn(voyage):
    """ACK 14 until the other, who never goes on, is given up after eight seconds."""
    answers, announced = [], []
    deliver = voyage.happened

    def happened(event):
        message = getattr(event, "message", None)
        if message is not None and message.get_type() == "MISSION_ACK":
            answers.append(message.type)
        deliver(event)

    def is_forestalled(message):
        if message.get_type() == "MISSION_COUNT" and not announced:
            announced.append(voyage.now)
            voyage.announce_as_operator(len(voyage.autopilot.store) + 1)
        return True

    voyage.happened = happened
    voyage.passes = is_forestalled
    voyage.until("plan 2")
    assert voyage.advance(60.0, until=lambda: voyage.verified == 2)
    assert mavlink.MAV_MISSION_DENIED in answers
    assert not voyage.lines("given up")
    assert voyage.now >= announced[0] + 8.0
    assert (abs(voyage.on_board_m() - voyage.plan_m()) < 0.05).all()
    assert voyage.health.state == "exploring"
