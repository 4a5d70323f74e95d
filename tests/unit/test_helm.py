"""The vehicle as the core sees it: position, progress, the rest of the way, and what is said when."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.dispatch import Dispatched
from autonomy.geometry import LocalFrame
from autonomy.helm import Helm
from autonomy.mavlink.authority import OnBoard
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission import Route, waypoint
from autonomy.planning.plan import Plan

FRAME = LocalFrame(33.5, -118.5)
AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
CORNERS = np.array([(100.0, 0.0), (100.0, 100.0), (0.0, 100.0)])
AUTO, HOLD = 10, 4


class Boat:
    """A helm, and the words of an autopilot to it."""

    def __init__(self, **sections) -> None:
        configuration = Configuration.model_validate({"survey": {"area": AREA}, **sections})
        self.helm = Helm(configuration, FRAME)
        self.now = 100.0
        self._vehicle, self._own = Codec(1, 1), Codec(1, 191)

    def hear(self, message):
        (decoded,) = self._own.decode(self._vehicle.encode(message), "vehicle")
        return self.helm.handle(self.now, decoded)

    def beats(self, mode=AUTO, *, armed=True, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA):
        base = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        return self.hear(
            mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_SURFACE_BOAT, autopilot, base, mode, 4, 3)
        )

    def is_at(self, x, y, *, speed_mps=2.0, at_s=None):
        lat_deg, lon_deg = FRAME.to_geodetic((x, y))
        stamp = round(1000 * (self.now if at_s is None else at_s))
        place = (round(lat_deg * 1e7), round(lon_deg * 1e7))
        return self.hear(
            mavlink.MAVLink_global_position_int_message(stamp, *place, 0, 0, round(100 * speed_mps), 0, 0, 0)
        )

    def tells_current(self, seq, state=mavlink.MISSION_STATE_ACTIVE, total=3):
        return self.hear(mavlink.MAVLink_mission_current_message(seq, total, state, 1))

    def reaches(self, seq):
        return self.hear(mavlink.MAVLink_mission_item_reached_message(seq))

    def sails(self):
        """Our mission is on board, verified, and the operator has started it."""
        self.beats(HOLD)
        self.is_at(0.0, 0.0)
        self.brings_on_board()
        self.beats(AUTO)
        self.tells_current(1)
        return self

    def brings_on_board(self):
        items = tuple(
            waypoint(*position, acceptance_radius_m=5.0) for position in FRAME.to_geodetic(CORNERS).tolist()
        )
        plan = Plan(np.zeros(2), CORNERS, np.ones(len(CORNERS), dtype=bool), 0.0, "paper", "test")
        self.helm.dispatch._verified(Dispatched(plan, items))

    def sails_to_the_end(self):
        self.tells_current(3)
        self.reaches(3)


@pytest.fixture
def boat() -> Boat:
    return Boat()


def kinds(messages):
    return [each.get_type() for each in messages]


def test_before_a_vehicle_is_heard_there_are_heartbeats_only(boat):
    assert kinds(boat.helm.step(boat.now)) == ["HEARTBEAT"]
    assert boat.helm.next_deadline() == boat.now + 1.0
    assert boat.helm.step(boat.now + 0.5) == []
    assert not boat.helm.is_heard(boat.now)
    with pytest.raises(RuntimeError, match="position"):
        boat.helm.headway.remaining_route_m()


def test_another_vehicle_that_is_heard_first_is_not_ours():
    boat = Boat(mavlink={"system_id": 7})
    boat.beats(AUTO)
    assert boat.helm.state is None
    boat._vehicle = Codec(7, 1)
    boat.beats(HOLD)
    assert boat.helm.state.system_id == 7


def test_a_vehicle_is_asked_for_streams_and_its_mission(boat):
    boat.beats(HOLD)
    said = kinds(boat.helm.step(boat.now))
    assert said[:2] == ["HEARTBEAT", "COMMAND_LONG"]
    assert set(said[2:-2]) == {"PARAM_REQUEST_READ"}
    assert said[-2:] == ["COMMAND_LONG", "MISSION_REQUEST_LIST"]  # home, and the mission on board
    assert boat.helm.next_deadline() > boat.now


def test_an_unknown_autopilot_is_told_nothing(boat):
    boat.beats(autopilot=mavlink.MAV_AUTOPILOT_PX4)
    boat.is_at(0.0, 0.0)
    for second in range(10):
        assert kinds(boat.helm.step(boat.now + second)) == ["HEARTBEAT"]
        assert boat.helm.next_deadline() == boat.now + second + 1.0


def test_a_silent_vehicle_is_told_nothing_and_asked_anew_when_it_is_back(boat):
    boat.beats(HOLD)
    boat.helm.step(boat.now)
    for _ in range(20):
        boat.now += 1.0
        said = boat.helm.step(boat.now)
        assert boat.helm.next_deadline() > boat.now
    assert not boat.helm.is_heard(boat.now)
    assert kinds(said) == ["HEARTBEAT"]
    boat.beats(HOLD)
    said = kinds(boat.helm.step(boat.now))
    assert said[0] == "COMMAND_LONG"
    assert said[-1] == "MISSION_REQUEST_LIST"


def asked_for_positions(boat, seconds, *, tells):
    """How often it is, while a boat in full that is ready grants what it is asked for; and the orders it is given."""
    asked, orders = 0, []
    for _ in range(seconds):
        boat.now += 1.0
        boat.beats(HOLD, armed=False)
        if tells:
            boat.is_at(0.0, 0.0)
        for each in boat.helm.step(boat.now):
            if each.get_type() == "COMMAND_LONG":
                boat.hear(mavlink.MAVLink_command_ack_message(each.command, 0, 0, 0, 1, 191))
                asked += each.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL and each.param1 == 33.0
                orders += [each.command] if each.command == mavlink.MAV_CMD_DO_SET_MODE else []
    return asked, orders


def test_positions_that_have_stopped_are_asked_for_again_now_and_then(boat):
    assert asked_for_positions(boat, 60, tells=True)[0] == 1
    assert asked_for_positions(boat, 28, tells=False)[0] == 0
    assert asked_for_positions(boat, 62, tells=False)[0] in (2, 3)
    assert asked_for_positions(boat, 60, tells=True)[0] == 0


def test_a_boat_that_does_not_tell_its_position_any_more_is_not_set_in_motion():
    boat = Boat(authority={"mode": "full"})
    asked_for_positions(boat, 20, tells=True)
    asked_for_positions(boat, 20, tells=False)
    boat.hear(mavlink.MAVLink_ekf_status_report_message(0x10, 0, 0, 0, 0, 0))
    boat.brings_on_board()
    assert boat.helm.authority.is_ready(boat.helm.state)
    assert asked_for_positions(boat, 20, tells=False)[1] == []
    assert mavlink.MAV_CMD_DO_SET_MODE in asked_for_positions(boat, 5, tells=True)[1]


def test_position_and_distance(boat):
    boat.beats()
    for x in (0.0, 30.0, 30.0, 60.0):
        boat.now += 1.0
        boat.is_at(x, 0.0)
    np.testing.assert_allclose(boat.helm.headway.position_m, (60.0, 0.0), atol=0.05)
    assert boat.helm.headway.distance_m == pytest.approx(60.0, abs=0.1)
    boat.is_at(0.0, 0.0, at_s=boat.now - 2.0)  # a straggler moves nobody
    np.testing.assert_allclose(boat.helm.headway.position_m, (60.0, 0.0), atol=0.05)


def test_a_position_that_the_vehicle_is_not_sure_of_is_none(boat):
    boat.beats()
    boat.is_at(0.0, 0.0)
    boat.hear(mavlink.MAVLink_ekf_status_report_message(0x80, 0, 0, 0, 0, 0))
    for _ in range(40):
        boat.now += 1.0
        boat.is_at(30.0, 0.0)
    np.testing.assert_allclose(boat.helm.headway.position_m, (0.0, 0.0), atol=0.05)
    boat.hear(mavlink.MAVLink_ekf_status_report_message(0x1F, 0, 0, 0, 0, 0))
    boat.now += 1.0
    boat.is_at(40.0, 0.0)
    np.testing.assert_allclose(boat.helm.headway.position_m, (40.0, 0.0), atol=0.05)
    assert boat.helm.headway.distance_m == pytest.approx(40.0, abs=0.1)


@pytest.mark.parametrize("fixes", [1, 2, 4])
def test_a_jump_that_no_boat_can_make_is_left_out(boat, fixes):
    boat.beats()
    boat.is_at(0.0, 0.0)
    for _ in range(fixes):
        boat.now += 1.0
        boat.hear(
            mavlink.MAVLink_global_position_int_message(
                round(1000 * boat.now), -335000000, 615000000, 0, 0, 0, 0, 0, 0
            )
        )
        np.testing.assert_allclose(boat.helm.headway.position_m, (0.0, 0.0), atol=0.05)
    boat.now += 1.0
    boat.is_at(10.0, 0.0)
    np.testing.assert_allclose(boat.helm.headway.position_m, (10.0, 0.0), atol=0.05)
    assert boat.helm.headway.distance_m == pytest.approx(10.0, abs=0.1)


def test_a_jump_that_persists_is_believed_and_is_no_distance(boat):
    boat.beats()
    boat.is_at(90_000.0, 0.0)  # the first one was wrong
    for step in range(12):
        boat.now += 1.0
        boat.is_at(2.0 * step, 0.0)
    np.testing.assert_allclose(boat.helm.headway.position_m, (22.0, 0.0), atol=0.05)
    assert boat.helm.headway.distance_m == pytest.approx(12.0, abs=0.1)


def test_jumps_that_agree_on_nothing_are_never_believed(boat):
    boat.beats()
    boat.is_at(0.0, 0.0)
    for step in range(40):
        boat.now += 1.0
        boat.is_at(20_000.0 * (-1) ** step, 0.0)
    np.testing.assert_allclose(boat.helm.headway.position_m, (0.0, 0.0), atol=0.05)


def test_messages_that_tell_nothing_are_no_news(boat):
    boat.sails()
    assert not boat.hear(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)).news
    assert boat.is_at(1.0, 0.0).news
    assert boat.reaches(1).news
    assert boat.beats(HOLD).news


def test_the_rest_of_the_way(boat):
    boat.sails()
    assert boat.helm.headway.sailing_ours
    np.testing.assert_allclose(boat.helm.headway.remaining_route_m(), [(0, 0), *CORNERS], atol=0.05)
    boat.tells_current(2)
    np.testing.assert_allclose(boat.helm.headway.remaining_route_m(), [(0, 0), *CORNERS[1:]], atol=0.05)
    boat.beats(HOLD)
    np.testing.assert_allclose(boat.helm.headway.remaining_route_m(), [(0, 0)], atol=0.05)


def test_how_far_the_boat_gets_meanwhile(boat):
    boat.sails()
    assert boat.helm.headway.reach_m(25.0) == pytest.approx(50.0, abs=0.1)


def test_the_next_corner_is_the_one_after_those_reached(boat):
    assert boat.helm.headway.next_row == 0
    boat.sails()
    assert boat.helm.headway.next_row == 0
    boat.tells_current(2)
    boat.reaches(2)  # MISSION_CURRENT 3 is still to come
    assert boat.helm.headway.next_row == 2
    boat.beats(HOLD)
    assert boat.helm.headway.next_row == 2


def ask(boat):
    """Whether the helm wants the mission read again."""
    boat.helm.dispatch._read_s = boat.now
    return kinds(boat.helm.dispatch.step(boat.now, boat.helm.state, Route(1, 191, 1, 1), 1.0)) == [
        "MISSION_REQUEST_LIST"
    ]


def sails_surely(boat):
    """And its autopilot has been heard for a while."""
    boat.sails()
    for _ in range(10):
        boat.beats()


def claims(boat, distance_m, *, number=1, times=3):
    for _ in range(times):
        boat.now += 1.0
        boat.is_at(0.0, 0.0)
        boat.tells_current(number)
        boat.hear(mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, distance_m, 0, 0, 0))


def test_a_boat_that_is_not_where_its_autopilot_reckons_has_its_mission_read(boat):
    sails_surely(boat)
    for number, distance_m in ((1, 100), (2, 141), (3, 100), (1, 0), (1, 145)):
        claims(boat, distance_m, number=number, times=5)
        assert not ask(boat)
    claims(boat, 400, times=2)
    assert not ask(boat)
    claims(boat, 400, times=1)
    assert ask(boat)
    assert [note.text for note in boat.helm.take_notes(boat.now)][-1] == (
        "the boat sails 400 m to waypoint 1, ours is 100 m away: reading the mission on board"
    )


def test_what_another_component_tells_of_its_way_is_none_of_ours(boat):
    sails_surely(boat)
    own, boat._vehicle = boat._vehicle, Codec(2, 1)
    for _ in range(5):
        boat._vehicle = own
        boat.tells_current(1)
        boat._vehicle = Codec(2, 1)
        boat.hear(mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, 400, 0, 0, 0))
    assert not ask(boat)


@pytest.mark.parametrize("mode", [AUTO, HOLD])
def test_a_waypoint_reached_far_from_ours_has_the_mission_read(boat, mode):
    sails_surely(boat)
    boat.is_at(50.0, 0.0)
    boat.reaches(1)
    assert not ask(boat)
    boat.is_at(100.0, 10.0)
    boat.beats(mode)
    boat.reaches(2)
    assert ask(boat) == (mode == AUTO)
    boat.reaches(7)  # ours has no such item: that is for its length to tell


def test_a_boat_that_makes_for_nothing_is_not_doubted(boat):
    sails_surely(boat)
    for state in (mavlink.MISSION_STATE_PAUSED, mavlink.MISSION_STATE_COMPLETE):
        for _ in range(5):
            boat.tells_current(3, state)
            boat.hear(mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, 900, 0, 0, 0))
    assert not ask(boat)


def test_a_mission_begun_anew_lies_before_the_boat_again(boat):
    boat.sails()
    for seq in (1, 2):
        boat.tells_current(seq)
        boat.reaches(seq)
    boat.tells_current(3)
    assert boat.helm.headway.next_row == 2
    boat.tells_current(1)
    assert boat.helm.headway.next_row == 0
    boat.reaches(1)
    boat.tells_current(2)
    assert boat.helm.headway.next_row == 1


def test_a_waypoint_that_is_named_again_after_it_was_reached_is_sailed_to(boat):
    boat.sails()
    boat.tells_current(2)
    boat.reaches(2)
    boat.tells_current(2)  # overtaken on the way
    assert boat.helm.headway.next_row == 2
    boat.tells_current(2)
    assert boat.helm.headway.next_row == 1


@pytest.mark.parametrize("state", [mavlink.MISSION_STATE_UNKNOWN, mavlink.MISSION_STATE_COMPLETE])
def test_the_last_waypoint_stays_the_current_one_and_reached(boat, state):
    boat.sails()
    for seq in (1, 2, 3):
        boat.tells_current(seq)
        boat.reaches(seq)
    for _ in range(5):
        boat.tells_current(3, state)
    assert boat.helm.headway.next_row == 3
    assert boat.helm.headway.path_finished


def test_the_pace_is_measured_under_way(boat):
    boat.sails()
    usual_mps = boat.helm.headway.pace_mps
    for second in range(60):
        boat.is_at(3.0 * second, 0.0, speed_mps=3.0, at_s=boat.now + second)
    assert usual_mps < boat.helm.headway.pace_mps < 3.0
    assert boat.helm.headway.pace_mps == pytest.approx(3.0, abs=0.3)
    pace_mps = boat.helm.headway.pace_mps
    boat.beats(HOLD)
    for second in range(60, 120):
        boat.is_at(180.0, 0.0, speed_mps=0.0, at_s=boat.now + second)
    assert boat.helm.headway.pace_mps == pace_mps


def test_the_path_is_finished_with_its_last_waypoint(boat):
    boat.sails()
    for seq in (1, 2):
        boat.reaches(seq)
        assert not boat.helm.headway.path_finished
        boat.tells_current(seq + 1)
    boat.reaches(3)
    assert boat.helm.headway.path_finished


@pytest.mark.parametrize("state", [mavlink.MISSION_STATE_UNKNOWN, mavlink.MISSION_STATE_ACTIVE])
def test_the_last_waypoint_counts_though_the_message_before_it_was_lost(boat, state):
    boat.sails()
    boat.tells_current(2, state)
    boat.reaches(2)
    boat.reaches(3)  # MISSION_CURRENT 3 was lost
    assert not boat.helm.headway.path_finished
    boat.tells_current(2, state)  # overtaken on the way
    boat.tells_current(3, state)
    assert not boat.helm.headway.path_finished
    boat.tells_current(3, state)
    assert boat.helm.headway.path_finished


def test_a_number_of_the_last_mission_is_not_kept_for_the_next(boat):
    boat.sails()
    boat.reaches(3)
    for seq in (1, 1, 2, 3, 3):
        boat.tells_current(seq)
    assert not boat.helm.headway.path_finished
    boat.reaches(4)
    boat.helm.dispatch._verified(Dispatched(boat.helm.dispatch.active.plan, boat.helm.dispatch.active.items))
    boat.tells_current(4)
    boat.tells_current(4)
    assert not boat.helm.headway.path_finished


def test_stragglers_of_the_last_mission_finish_nothing(boat):
    boat.sails()
    boat.reaches(3)
    boat.tells_current(3, mavlink.MISSION_STATE_COMPLETE)
    assert not boat.helm.headway.path_finished
    boat.tells_current(1)
    boat.tells_current(3)
    assert not boat.helm.headway.path_finished


def test_the_path_is_finished_when_the_vehicle_says_so(boat):
    boat.sails()
    boat.tells_current(3)
    assert not boat.helm.headway.path_finished
    boat.tells_current(3, mavlink.MISSION_STATE_COMPLETE)
    boat.tells_current(3, mavlink.MISSION_STATE_COMPLETE)
    assert boat.helm.headway.path_finished


def test_no_path_is_finished_while_another_is_on_its_way_or_somebody_else_sails(boat):
    boat.sails().sails_to_the_end()
    boat.helm.offer(boat.helm.dispatch.active.plan)
    assert not boat.helm.headway.path_finished
    boat.helm.dispatch._waiting = None
    assert boat.helm.headway.path_finished
    boat.beats(HOLD)
    assert not boat.helm.headway.path_finished


def test_what_was_reached_belongs_to_the_mission_that_was_on_board(boat):
    boat.sails().sails_to_the_end()
    boat.helm.dispatch._verified(boat.helm.dispatch.active)
    assert not boat.helm.headway.path_finished


def test_another_length_makes_us_read_the_mission(boat):
    boat.sails().tells_current(1, total=9)
    assert boat.helm.authority.on_board is OnBoard.UNREAD
    assert not boat.helm.headway.sailing_ours
