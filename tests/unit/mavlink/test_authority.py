"""Who has the boat, as scripts of what the vehicle does."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from autonomy.mavlink.authority import Authority, OnBoard
from autonomy.mavlink.authority_table import Action, Command, Mode
from autonomy.mavlink.rover import mode_name
from autonomy.mavlink.vehicle import VehicleState

HOLD = VehicleState(1, 1, autopilot=3, vehicle_type=11, mode=4, armed=False, system_status=3)
AUTO = replace(HOLD, mode=10, armed=True, system_status=4)
MANUAL = replace(AUTO, mode=0)
CRITICAL = replace(AUTO, system_status=5)


def started() -> Authority:
    authority = Authority(adopt=False)
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    authority.observe(AUTO)
    assert authority.in_command
    return authority


@pytest.mark.parametrize("on_board", [OnBoard.EMPTY, OnBoard.OURS])
def test_before_the_first_auto_one_mission_is_put_on_board(on_board: OnBoard) -> None:
    authority = Authority(adopt=False)
    assert not authority.decide(HOLD).allowed, "the mission on board is not known yet"
    authority.mission_read(on_board)
    assert authority.decide(HOLD).allowed
    authority.upload_verified()
    permission = authority.decide(HOLD)
    assert not permission.allowed
    assert "operator to arm and select AUTO" in permission.reason
    assert not authority.survey_started


def test_a_mission_we_do_not_know_is_never_overwritten() -> None:
    authority = Authority(adopt=False)
    authority.mission_read(OnBoard.FOREIGN)
    for state in (HOLD, AUTO, MANUAL):
        permission = authority.decide(state)
        assert not permission.allowed
        assert "adopt" in permission.reason
    assert not authority.survey_started


def test_unless_we_may_adopt_it() -> None:
    authority = Authority(adopt=True)
    authority.mission_read(OnBoard.FOREIGN)
    assert authority.decide(HOLD).allowed
    assert authority.decide(AUTO).allowed


def test_in_auto_we_may_upload_until_the_operator_takes_the_boat() -> None:
    authority = started()
    assert authority.decide(AUTO).allowed
    permission = authority.decide(MANUAL)
    assert (permission.allowed, authority.command) == (False, Command.YIELDED)
    assert "the operator has the boat (MANUAL)" in permission.reason
    assert authority.survey_started
    assert authority.decide(AUTO).allowed, "AUTO is back"


@pytest.mark.parametrize("status", [5, 6, 7, 8])
def test_a_failsafe_has_the_boat_even_in_auto(status: int) -> None:
    authority = started()
    permission = authority.decide(replace(AUTO, system_status=status))
    assert not permission.allowed
    assert "failsafe" in permission.reason
    assert authority.command is Command.YIELDED


def test_disarming_in_auto_is_a_takeover_too() -> None:
    authority = started()
    assert "disarmed" in authority.decide(replace(AUTO, armed=False)).reason
    assert authority.command is Command.YIELDED


def test_a_mission_that_is_not_ours_any_more_ends_our_permission() -> None:
    authority = started()
    for on_board in (OnBoard.FOREIGN, OnBoard.EMPTY, OnBoard.UNREAD):
        authority.mission_read(on_board)
        assert not authority.decide(AUTO).allowed


def test_an_upload_of_ours_that_died_may_be_mended() -> None:
    authority = started()
    authority.upload_failed(on_board_unknown=True)
    assert authority.decide(AUTO).allowed
    waiting = Authority(adopt=False)
    waiting.mission_read(OnBoard.EMPTY)
    waiting.upload_failed(on_board_unknown=True)
    assert waiting.decide(HOLD).allowed


def test_after_a_reboot_the_boat_waits_for_its_operator_anew() -> None:
    authority = started()
    rebooted = replace(MANUAL, armed=False, reboots=1)
    authority.mission_read(OnBoard.UNREAD)
    assert not authority.decide(rebooted).allowed
    rebooted = replace(rebooted, heartbeats=1)
    authority.mission_read(OnBoard.EMPTY)
    assert authority.decide(rebooted).allowed, "without a mission no operator could select AUTO"
    assert not authority.survey_started, "readings on deck teach nothing"
    authority.upload_verified()
    assert not authority.decide(rebooted).allowed
    assert authority.decide(replace(rebooted, mode=10, armed=True)).allowed
    assert authority.in_command


READY = replace(HOLD, heartbeats=10, heard=50.0, ekf_ok=True, gps_fix_type=3, lat_deg=33.5, lon_deg=-118.5)
SAILS = replace(READY, mode=10, armed=True, system_status=4)
CLOCK: dict[str, Any] = {"reboots": 1, "booted": 50.5}


def beat(number: int, **changes: Any) -> VehicleState:
    """Heard a second after the one before, from a vehicle that has begun anew half a second after the tenth."""
    return replace(READY, heartbeats=number, heard=40.0 + number, **changes)


ORDERS = {
    "clock": [replace(SAILS, heard=50.9, **CLOCK), beat(11, **CLOCK)],
    "heartbeat": [
        beat(11),
        *(beat(number) for number in range(12, 30)),
        beat(29, **CLOCK),
        beat(30, **CLOCK),
    ],
    "both at once": [beat(11, **CLOCK), beat(12, **CLOCK)],
    "an empty mission": [replace(SAILS, heard=50.9, mission_state=1, **CLOCK), beat(11, **CLOCK)],
}
"""Which is heard first after a reboot under way."""


def rebooted(authority: Authority, order: str) -> VehicleState:
    """The autopilot begins anew, and its mission is put on board again."""
    for state in ORDERS[order]:
        authority.observe(state)
        if state.reboots:
            authority.mission_read(OnBoard.UNREAD if state.mission_state != NO_MISSION else OnBoard.EMPTY)
            authority.observe(state)
    authority.mission_read(OnBoard.EMPTY)
    assert authority.decide(state).allowed, "without a mission no operator could select AUTO"
    authority.upload_verified()
    authority.observe(state)
    return state


@pytest.mark.parametrize("order", ORDERS)
def test_in_full_a_boat_whose_autopilot_began_anew_under_way_waits_for_its_operator(order: str) -> None:
    authority = Authority(adopt=False, mode="full")
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    authority.observe(SAILS)
    assert authority.in_command
    state = rebooted(authority, order)
    assert (authority.command, authority.action) == (Command.BEFORE_START, Action.PREPARE)
    assert authority.take_restart()
    assert not authority.take_restart(), "it is told once"
    assert not authority.was_ever_taken, "a reboot is nobody's will"
    assert "arm and select AUTO, or for `start` from ashore" in authority.reason
    authority.allow_start(True)
    authority.observe(state)
    assert authority.action is Action.SELECT_AUTO


@pytest.mark.parametrize("order", ORDERS)
def test_in_full_a_boat_that_was_taken_before_its_autopilot_began_anew_is_started_by_its_operator(
    order: str,
) -> None:
    authority = Authority(adopt=False, mode="full")
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    authority.observe(SAILS)
    authority.observe(replace(READY, mode=0, armed=True))
    authority.observe(READY)
    state = rebooted(authority, order)
    assert authority.was_ever_taken
    assert "start" not in authority.reason
    authority.allow_start(True)
    authority.observe(state)
    assert (authority.command, authority.action) == (Command.BEFORE_START, Action.PREPARE)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("seen", ["to be set in motion", "stopped before it was seen to move"])
def test_in_full_a_boat_that_breaks_down_as_it_is_set_in_motion_is_not_armed_again_and_again(
    order: str, seen: str
) -> None:
    authority = Authority(adopt=False, mode="full")
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    authority.observe(READY)
    assert authority.action is Action.SELECT_AUTO
    if seen != "to be set in motion":
        authority.order_undone(beat(11))
    rebooted(authority, order)
    assert (authority.action, authority.was_ever_taken) == (Action.PREPARE, False)
    assert authority.waits_for_start


@pytest.mark.parametrize("order", ["heartbeat", "both at once"])
def test_in_full_a_boat_whose_autopilot_began_anew_while_it_was_steered_by_hand_is_not_set_in_motion(
    order: str,
) -> None:
    authority = Authority(adopt=False, mode="full")
    authority.mission_read(OnBoard.EMPTY)
    authority.observe(replace(READY, mode=0, armed=True))
    rebooted(authority, order)
    assert (authority.command, authority.action) == (Command.BEFORE_START, Action.PREPARE)
    assert authority.waits_for_start
    assert authority.take_restart()


def test_in_full_a_boat_that_was_never_to_be_set_in_motion_starts_by_itself_after_a_reboot() -> None:
    authority = Authority(adopt=False, mode="full")
    authority.mission_read(OnBoard.EMPTY)
    authority.observe(HOLD)
    rebooted(authority, "both at once")
    assert authority.action is Action.SELECT_AUTO
    assert not authority.take_restart()


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("mode", ["missions", "full"])
def test_with_resume_never_a_reboot_under_way_is_a_disarmed_boat(mode: Mode, order: str) -> None:
    authority = Authority(adopt=False, mode=mode, resume="never")
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    authority.observe(SAILS)
    for state in [*ORDERS[order], replace(SAILS, **CLOCK, heard=90.0, heartbeats=40)]:
        authority.observe(state)
    assert (authority.command, authority.action) == (Command.YIELDED, Action.LISTEN)
    assert not authority.take_restart()


def test_nobody_is_told_of_a_start_that_would_be_refused_or_that_nobody_can_give() -> None:
    ready = replace(READY, heartbeats=0)
    for heeds_start, taken, told in [(True, False, True), (True, True, False), (False, False, False)]:
        authority = Authority(adopt=False, mode="full", starts_by_itself=False, heeds_start=heeds_start)
        authority.mission_read(OnBoard.OURS)
        if taken:
            authority.observe(AUTO)
            for _ in range(2):
                authority.observe(replace(MANUAL, mission_state=NO_MISSION))
        authority.observe(ready)
        assert authority.command is Command.BEFORE_START
        assert ("start" in authority.reason) is told


def test_a_clock_that_starts_again_under_an_armed_boat_gives_us_nothing() -> None:
    authority = started()
    authority.mission_read(OnBoard.OURS)
    held = replace(MANUAL, heartbeats=7)
    assert not authority.decide(held).allowed
    for heartbeats, armed in [(7, True), (7, False), (8, True), (9, True), (60, False)]:
        state = replace(held, reboots=1, heartbeats=heartbeats, armed=armed)
        assert not authority.decide(state).allowed, "only the first heartbeat since decides"
        assert authority.command is Command.YIELDED
    authority.mission_read(OnBoard.OURS)
    assert authority.decide(replace(AUTO, reboots=1, heartbeats=61)).allowed


def test_a_reboot_under_way_with_our_mission_on_board_changes_nothing_for_long() -> None:
    authority = started()
    authority.mission_read(OnBoard.UNREAD)
    under_way = replace(AUTO, reboots=1)
    assert not authority.decide(under_way).allowed
    authority.mission_read(OnBoard.OURS)
    assert authority.decide(under_way).allowed
    assert authority.in_command


def test_other_autopilots_are_named_and_left_alone() -> None:
    authority = Authority(adopt=True)
    authority.mission_read(OnBoard.EMPTY)
    assert "unsupported autopilot PX4" in authority.decide(replace(HOLD, autopilot=12)).reason
    assert "unsupported vehicle type 2" in authority.decide(replace(HOLD, vehicle_type=2)).reason
    assert not authority.decide(replace(HOLD, autopilot=12)).allowed


def test_modes_have_names() -> None:
    assert (mode_name(10), mode_name(12), mode_name(99)) == ("AUTO", "SMART_RTL", "mode 99")


def test_a_mission_cleared_out_of_auto_is_replaced_once_so_that_the_boat_can_be_given_back() -> None:
    authority = started()
    authority.observe(MANUAL)
    assert authority.command is Command.YIELDED
    cleared = replace(MANUAL, mission_state=1)
    authority.mission_read(OnBoard.UNREAD)
    assert not authority.decide(cleared).allowed, "not before it has been read"
    authority.mission_read(OnBoard.EMPTY)
    assert authority.decide(cleared).allowed
    authority.upload_verified()
    assert not authority.decide(replace(MANUAL, mission_state=2)).allowed
    authority.observe(replace(AUTO, mission_state=3))
    assert authority.in_command


def test_a_mission_cleared_under_a_failsafe_is_left_alone() -> None:
    authority = started()
    authority.observe(replace(CRITICAL, mode=4, mission_state=1))
    assert authority.command is Command.YIELDED


@pytest.mark.parametrize("adopt", [False, True])
def test_what_the_operator_starts_in_the_middle_of_an_upload_is_only_part_of_our_mission(adopt: bool) -> None:
    authority = Authority(adopt)
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_begun()
    authority.observe(AUTO)
    assert not authority.in_command
    assert "part of it at most" in authority.reason
    authority.upload_verified()
    authority.observe(AUTO)
    assert authority.in_command
    authority.upload_begun()
    assert authority.on_board is OnBoard.OURS, "under way it sails on meanwhile"


@pytest.mark.parametrize("remembered", [Command.SENT_HOME, Command.RETURNING, Command.STOPPING, Command.HELD])
def test_what_was_begun_in_full_is_the_operators_once_missions_is_configured(remembered: Command) -> None:
    authority = Authority(adopt=False, mode="missions")
    authority.command = remembered
    authority.settle(Command.BEFORE_START)
    assert authority.command is Command.YIELDED
    in_full = Authority(adopt=False, mode="full")
    in_full.command = remembered
    in_full.settle(Command.BEFORE_START)
    assert in_full.command is remembered


# Lines of the table, said as a person would ------------------------------------------------------------------------

NO_MISSION = 1
RTL = replace(AUTO, mode=11)
IN_HOLD = replace(HOLD, armed=True, system_status=4)


def under_way(**options: Any) -> Authority:
    """In `full`, ours."""
    authority = Authority(adopt=False, mode="full", **options)
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    authority.observe(AUTO)
    assert authority.in_command
    return authority


def held() -> Authority:
    authority = under_way()
    assert authority.hold(AUTO)
    authority.observe(IN_HOLD)
    assert authority.command is Command.HELD
    return authority


def returning() -> Authority:
    authority = under_way(return_battery=0.5)
    authority.observe(replace(AUTO, battery_remaining=0.4))
    assert authority.action is Action.GO_HOME
    authority.observe(RTL)
    assert authority.command is Command.RETURNING
    return authority


def displaced() -> Authority:
    authority = started()
    authority.mission_read(OnBoard.REPLACED)
    authority.observe(AUTO)
    assert authority.command is Command.DISPLACED
    return authority


def test_auto_gives_the_boat_back_before_its_mission_is_read_so_that_it_can_be() -> None:
    authority = started()
    authority.observe(MANUAL)
    authority.mission_read(OnBoard.UNREAD)
    assert not authority.decide(AUTO).allowed
    assert (authority.command, authority.action) == (Command.OURS, Action.SAIL)


def test_under_somebody_elses_mission_we_read_and_do_no_more() -> None:
    authority = displaced()
    authority.observe(AUTO)
    assert authority.action is Action.READ
    authority.mission_read(OnBoard.UNREAD)
    authority.observe(AUTO)
    assert (authority.command, authority.action) == (Command.DISPLACED, Action.READ)


@pytest.mark.parametrize("taken", [RTL, MANUAL, IN_HOLD, replace(AUTO, armed=False)])
def test_who_takes_a_boat_from_another_station_has_it(taken: VehicleState) -> None:
    authority = displaced()
    authority.observe(taken)
    assert (authority.command, authority.action) == (Command.YIELDED, Action.LISTEN)


def test_a_boat_that_was_started_with_half_of_its_first_mission_gets_the_rest() -> None:
    authority = Authority(adopt=False)
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_failed(on_board_unknown=True)
    assert authority.decide(AUTO).allowed
    assert (authority.command, authority.action) == (Command.BEFORE_START, Action.PREPARE)


@pytest.mark.parametrize(
    "cleared", [replace(MANUAL, mission_state=NO_MISSION), replace(HOLD, mission_state=NO_MISSION)]
)
@pytest.mark.parametrize("begun", [started, under_way, held, returning, displaced])
def test_who_clears_the_mission_in_a_mode_that_it_was_not_told_to_take_has_taken_the_boat(
    begun: Callable[[], Authority], cleared: VehicleState
) -> None:
    authority = begun()
    for _ in range(2):
        authority.observe(cleared)
    assert authority.was_ever_taken
    assert authority.command is Command.BEFORE_START
    assert authority.action is Action.PREPARE, "or he could not select AUTO"


def test_who_clears_the_mission_of_a_boat_that_is_as_it_was_told_to_be_has_not_taken_it() -> None:
    stopping = under_way()
    assert stopping.hold(AUTO)
    for authority in (stopping, held()):
        authority.observe(replace(IN_HOLD, mission_state=NO_MISSION))
        assert (authority.command, authority.action) == (Command.BEFORE_START, Action.PREPARE)
        assert not authority.was_ever_taken
    brought_home = returning()
    brought_home.observe(replace(RTL, mission_state=NO_MISSION))
    assert (brought_home.command, brought_home.action) == (Command.RETURNING, Action.LISTEN)


def test_a_boat_that_is_to_hold_goes_home_if_it_must() -> None:
    authority = under_way(return_battery=0.5)
    assert authority.hold(AUTO)
    authority.observe(replace(AUTO, battery_remaining=0.4))
    assert (authority.command, authority.action) == (Command.SENT_HOME, Action.GO_HOME)


def test_with_another_battery_it_is_sent_home_again_when_that_is_low() -> None:
    authority = returning()
    low, charged = replace(AUTO, battery_remaining=0.4), replace(AUTO, battery_remaining=0.9)
    for state in (low, charged, low, replace(low, armed=False), low, replace(AUTO, armed=False), low):
        authority.observe(state)
        assert authority.action is not Action.GO_HOME, "he who selects AUTO has decided otherwise"
    authority.observe(replace(charged, armed=False))
    for state, action in [(charged, Action.SAIL), (low, Action.GO_HOME)]:
        authority.observe(state)
        assert authority.action is action


def test_for_a_cause_other_than_its_battery_it_is_sent_home_once() -> None:
    authority = under_way()
    authority.return_cause = "critical"
    authority.observe(AUTO)
    assert authority.action is Action.GO_HOME
    authority.observe(RTL)
    for state in (replace(HOLD, battery_remaining=0.9), AUTO):
        authority.observe(state)
    assert authority.action is Action.SAIL


def test_on_its_way_home_it_is_told_nothing() -> None:
    authority = returning()
    authority.observe(RTL)
    assert authority.action is Action.LISTEN


def test_disarmed_in_auto_or_under_a_failsafe_nothing_is_put_on_board() -> None:
    authority = Authority(adopt=False)
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    ready = replace(AUTO, armed=False, ekf_ok=True, gps_fix_type=3, lat_deg=33.5, lon_deg=-118.5)
    for state in (ready, replace(ready, ekf_ok=False), replace(HOLD, system_status=5)):
        authority.observe(state)
        assert (authority.command, authority.action) == (Command.BEFORE_START, Action.READ)


def test_who_stops_a_boat_at_once_has_taken_it() -> None:
    ready = replace(HOLD, ekf_ok=True, gps_fix_type=3, lat_deg=33.5, lon_deg=-118.5)
    waiting = Authority(adopt=False, mode="full")
    waiting.mission_read(OnBoard.EMPTY)
    waiting.upload_verified()
    waiting.observe(ready)
    assert waiting.action is Action.SELECT_AUTO
    waiting.order_undone(ready)
    assert (waiting.command, waiting.action, waiting.was_ever_taken) == (
        Command.BEFORE_START,
        Action.PREPARE,
        True,
    )
    released = held()
    released.release(IN_HOLD)
    assert released.action is Action.SELECT_AUTO
    released.order_undone(IN_HOLD)
    assert (released.command, released.action) == (Command.YIELDED, Action.LISTEN)


def test_who_stops_a_boat_at_once_has_taken_it_for_good_where_taken_is_taken() -> None:
    ready = replace(HOLD, ekf_ok=True, gps_fix_type=3, lat_deg=33.5, lon_deg=-118.5)
    authority = Authority(adopt=False, mode="full", resume="never")
    authority.mission_read(OnBoard.EMPTY)
    authority.upload_verified()
    authority.observe(ready)
    assert authority.action is Action.SELECT_AUTO
    authority.order_undone(ready)
    assert (authority.command, authority.action) == (Command.YIELDED, Action.LISTEN)
    assert not authority.decide(ready).allowed


def test_in_the_mode_that_brings_it_home_the_boat_is_the_operators_unless_it_was_sent() -> None:
    authority = started()
    authority.observe(RTL)
    assert (authority.command, authority.action) == (Command.YIELDED, Action.LISTEN)
