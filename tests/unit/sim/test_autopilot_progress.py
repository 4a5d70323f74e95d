"""Driving missions: progress, holding, re-uploads under way, completion, and the other modes."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot import Mode
from sim.vessel import Position

START = Position(33.70, -118.40)
EAST, NORTH, FAR = START.moved(100.0, 0.0), START.moved(0.0, 100.0), START.moved(100.0, 100.0)
AUTO, HOLD, GUIDED, RTL, LOITER = 10, 4, 15, 11, 5
NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 2, 3, 4, 5


@pytest.fixture
def sailing(bench, gcs):
    """A boat in AUTO on its way east, then to the far corner, then north."""
    gcs.upload(EAST, FAR, NORTH)
    assert gcs.command(400, 1) == 0
    assert gcs.command(300) == 0
    gcs.heard.clear()
    return bench


def reached(gcs) -> list[int]:
    return [each.seq for each in gcs.of("MISSION_ITEM_REACHED")]


def states(gcs) -> list[tuple[int, int]]:
    """Distinct (seq, mission_state) in the order they were told."""
    told = [(each.seq, each.mission_state) for each in gcs.of("MISSION_CURRENT")]
    return [each for k, each in enumerate(told) if k == 0 or each != told[k - 1]]


def test_a_mission_is_driven_to_its_end(sailing, gcs):
    sailing.advance(300.0)
    assert reached(gcs) == [1, 2, 3]
    assert states(gcs) == [(1, ACTIVE), (2, ACTIVE), (3, ACTIVE), (3, COMPLETE)]
    assert gcs.of("MISSION_CURRENT")[0].total == 3
    assert "Mission Complete" in gcs.texts()
    heartbeat = gcs.of("HEARTBEAT")[-1]
    assert heartbeat.custom_mode == AUTO
    assert heartbeat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED
    assert sailing.autopilot.vessel.position.distance_to(NORTH) < 10.0


def test_it_loiters_at_the_end(sailing, gcs):
    sailing.advance(300.0)
    sailing.advance(2000.0, step_s=1.0)
    assert sailing.autopilot.vessel.position.distance_to(NORTH) < 10.0


def test_a_hold_delays_the_report_of_arrival(bench, gcs):
    gcs.upload(EAST, FAR, hold_s=40.0)
    gcs.command(400, 1)
    gcs.command(300)
    while bench.autopilot.vessel.position.distance_to(EAST) > 3.0:
        bench.advance(0.5)
    arrived = bench.now
    while not reached(gcs):
        bench.advance(0.5)
    assert bench.now - arrived == pytest.approx(40.0, abs=3.0)
    assert bench.autopilot.vessel.position.distance_to(EAST) < 8.0


def test_speed_up_changes_only_the_vehicles_time(bench, gcs):
    gcs.upload(EAST)
    gcs.command(400, 1)
    gcs.command(300)
    bench.advance(1.0, speedup=100.0, step_s=0.1)
    assert reached(gcs) == [1]


def test_auto_is_refused_without_a_mission(bench, gcs):
    assert gcs.command(176, 1, AUTO) == mav.MAV_RESULT_FAILED
    assert any("No Mission" in text for text in gcs.texts())
    assert gcs.command(300) == mav.MAV_RESULT_FAILED


def test_starting_does_not_arm_and_unarmed_it_does_not_move(bench, gcs):
    gcs.upload(EAST)
    assert gcs.command(300) == 0
    bench.advance(60.0)
    assert not bench.autopilot.navigator.armed
    assert bench.autopilot.vessel.position == START


def test_a_re_upload_in_auto_keeps_the_index_and_turns_to_the_new_item(sailing, gcs):
    sailing.advance(80.0)
    assert reached(gcs) == [1]
    west = START.moved(-100.0, 0.0)
    gcs.upload(EAST, west, FAR)
    sailing.advance(300.0)
    assert reached(gcs) == [1, 2, 3]
    assert states(gcs)[-1] == (3, COMPLETE)
    assert sailing.autopilot.vessel.position.distance_to(FAR) < 10.0


def test_a_re_upload_shorter_than_the_index_completes_and_is_never_driven(sailing, gcs):
    sailing.advance(80.0)
    gcs.upload(NORTH)
    sailing.advance(60.0)
    assert states(gcs)[-1][1] == COMPLETE
    assert sailing.autopilot.vessel.position.distance_to(NORTH) > 50.0
    # Neither setting the item nor starting heals it; the restart does.
    assert gcs.command(224, 1) == 0
    assert gcs.command(300) == 0
    sailing.advance(5.0)
    assert states(gcs)[-1][1] == COMPLETE
    assert gcs.command(224, 1, 1) == 0
    assert (gcs.of("MISSION_CURRENT")[-1].seq, gcs.of("MISSION_CURRENT")[-1].mission_state) == (1, ACTIVE)
    sailing.advance(120.0)
    assert reached(gcs)[-1] == 1
    assert sailing.autopilot.vessel.position.distance_to(NORTH) < 10.0


def test_setting_the_current_item_is_confirmed_at_once(sailing, gcs):
    answers = gcs.send("mission_set_current", 1, 1, 3)
    assert {(each.get_type(), each.seq) for each in answers} == {("MISSION_CURRENT", 3)}
    gcs.heard.clear()
    assert gcs.command(224, 2) == 0
    assert [each.seq for each in gcs.of("MISSION_CURRENT")] == [2, 2]
    assert gcs.command(224, 9) == mav.MAV_RESULT_FAILED
    assert gcs.send("mission_set_current", 1, 1, 9) == []


def test_leaving_auto_pauses_and_coming_back_resumes(sailing, gcs):
    sailing.advance(80.0)
    assert gcs.command(176, 1, HOLD) == 0
    sailing.advance(30.0)
    assert states(gcs)[-1] == (2, PAUSED)
    assert sailing.autopilot.vessel.speed_mps == 0.0
    assert gcs.command(176, 1, AUTO) == 0
    sailing.advance(200.0)
    assert reached(gcs) == [1, 2, 3]


def test_a_complete_mission_starts_again_on_entering_auto(sailing, gcs):
    sailing.advance(300.0)
    gcs.command(176, 1, HOLD)
    gcs.command(176, 1, AUTO)
    assert states(gcs)[-1] == (1, ACTIVE)


def test_the_mission_state_before_the_start(bench, gcs):
    bench.advance(2.0)
    assert states(gcs) == [(0, 1)]
    gcs.upload(EAST)
    bench.advance(2.0)
    assert states(gcs)[-1] == (0, NOT_STARTED)


def test_loiter_unlimited_never_ends(bench, gcs):
    gcs.send("mission_count", 1, 1, 3, 0)
    gcs.item(0)
    gcs.item(1, EAST, command=17)
    gcs.item(2, FAR)
    gcs.command(400, 1)
    gcs.command(300)
    bench.advance(400.0)
    assert reached(gcs) == []
    assert bench.autopilot.vessel.position.distance_to(EAST) < 10.0


def test_speed_changes_inside_a_mission_act(bench, gcs):
    gcs.send("mission_count", 1, 1, 3, 0)
    gcs.item(0)
    gcs.item(1, command=178, param1=1.0, param2=4.0)
    gcs.item(2, EAST)
    gcs.command(400, 1)
    gcs.command(300)
    bench.advance(20.0)
    assert bench.autopilot.vessel.speed_mps == pytest.approx(4.0)


def test_parameters_act(sailing, gcs):
    gcs.send("param_set", 1, 1, b"WP_SPEED", 0.5, mav.MAV_PARAM_TYPE_REAL32)
    sailing.advance(30.0)
    assert sailing.autopilot.vessel.speed_mps == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("mode", [RTL, 12])
def test_returning_home(sailing, gcs, mode):
    sailing.advance(40.0)
    assert gcs.command(176, 1, mode) == 0
    sailing.advance(150.0)
    assert sailing.autopilot.vessel.position.distance_to(START) < 10.0
    assert reached(gcs) == []


def test_guided_goes_where_it_is_sent_and_reports_a_bogus_item(bench, gcs):
    gcs.command(400, 1)
    target = (0, 1, 1, 6, 0xFFFC, round(EAST.lat_deg * 1e7), round(EAST.lon_deg * 1e7))
    gcs.send("set_position_target_global_int", *target, *[0.0] * 9)
    bench.advance(20.0)
    assert bench.autopilot.vessel.position == START  # not in GUIDED yet
    assert gcs.command(176, 1, GUIDED) == 0
    gcs.send("set_position_target_global_int", *target, *[0.0] * 9)
    bench.advance(100.0)
    assert bench.autopilot.vessel.position.distance_to(EAST) < 10.0
    assert reached(gcs) == [0]


def test_loiter_stays_where_it_was_told(sailing, gcs):
    sailing.advance(30.0)
    gcs.command(176, 1, LOITER)
    there = sailing.autopilot.vessel.position
    sailing.advance(100.0)
    assert sailing.autopilot.vessel.position.distance_to(there) < 8.0
    assert sailing.autopilot.navigator.mode is Mode.LOITER
