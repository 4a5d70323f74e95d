"""Operator, vehicle and other stations in any order: what may be done is held against a few plain sentences.

The sentences know nothing of the authority's table. HALOCLINE_EXAMPLES: how many sequences; without it 300.
"""

import os
from dataclasses import replace
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.authority import Authority, OnBoard, Permission
from autonomy.mavlink.authority_table import Action
from autonomy.mavlink.rover import AUTO, HOLD, RTL
from autonomy.mavlink.vehicle import VehicleState

MANUAL = 0
ACTIVE, CRITICAL, EMERGENCY = 4, 5, 6
UNDERWAY = (Action.SAIL, Action.GO_HOME)
STARTS = (Action.SELECT_AUTO, Action.ARM)
BEGUN = VehicleState(
    system_id=1,
    component_id=1,
    autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    vehicle_type=mavlink.MAV_TYPE_SURFACE_BOAT,
    mode=HOLD,
    armed=False,
    system_status=ACTIVE,
    lat_deg=33.5,
    lon_deg=-118.5,
    gps_fix_type=3,
    ekf_ok=True,
    battery_remaining=0.9,
)


class AuthorityMachine(RuleBasedStateMachine):
    """The vehicle as it is, what an honest dispatcher does with a permission, and what followed so far."""

    @initialize(
        adopt=st.booleans(),
        mode=st.sampled_from(["missions", "full", "full", "observe"]),
        resume=st.sampled_from(["when_auto_again", "never"]),
        return_battery=st.sampled_from([None, 0.3]),
        starts_by_itself=st.sampled_from([True, True, False]),
    )
    def begin(
        self, adopt: bool, mode: Any, resume: Any, return_battery: float | None, starts_by_itself: bool
    ) -> None:
        self.adopt, self.mode, self.resume, self.return_battery = adopt, mode, resume, return_battery
        self.may_start = starts_by_itself
        self.told_to_hold = self.seen_to_hold = self.released = False
        self.authority = Authority(
            adopt, mode, resume, return_battery=return_battery, starts_by_itself=starts_by_itself
        )
        self.state = BEGUN
        self.on_board = OnBoard.UNREAD
        self.sailed = False
        """Whether the boat was ours since the vehicle last came up, or its mission was cleared."""
        self.away = False
        """Whether it was then taken, and has not been given back."""
        self.taken_at: float | None = None
        """When it was first taken; a reboot, as far as it is told by then, takes nothing."""
        self.ever_set_off = False
        """Whether it was ever ours, or told to start."""
        self.ever_armed = False
        self.now = 0.0
        self.told_home = False
        self.verified = False
        """Whether a mission of ours waits, verified since the vehicle last came up."""
        self.uploading = False
        self.comes_up = False
        """Whether its clock began anew, and no heartbeat has told yet what that means."""
        self.before = Action.LISTEN
        self.permission = Permission(False, "")
        self.hear(heartbeat=False)

    # What happens ------------------------------------------------------------------------------------------------

    def hear(self, heartbeat: bool = True, **change: Any) -> None:
        """The vehicle says something; the model follows before the authority is asked."""
        self.now += 1.0
        beats = self.state.heartbeats + heartbeat
        self.state = replace(self.state, heartbeats=beats, heard=self.now, **change)
        self.ever_armed = self.ever_armed or self.state.armed
        self.before = self.authority.action
        self._follow(heartbeat)
        self.permission = self.authority.decide(self.state)
        self.ever_set_off = self.ever_set_off or self.authority.action in (*UNDERWAY, *STARTS)
        self.sailed = self.sailed or self.authority.action in UNDERWAY
        self.told_home = self.told_home or self.authority.action is Action.GO_HOME
        self.told_to_hold = self.told_to_hold and self.authority.action is not Action.GO_HOME
        self.released = self.released and self.told_to_hold

    def _follow(self, heartbeat: bool) -> None:
        came_up = self.comes_up and heartbeat
        self.comes_up = self.comes_up and not heartbeat
        emptied = (
            self.sound
            and self.state.mode != AUTO
            and self.state.mission_state == mavlink.MISSION_STATE_NO_MISSION
        )
        # The mode that it was told to take is not the operator's.
        homeward = self.told_home and self.state.mode == RTL and self.sound
        begins_anew = came_up and not self.state.armed
        if emptied and self.sailed and not begins_anew:
            # Out of AUTO: who has cleared it has taken the boat.
            as_told = homeward or (self.told_to_hold and self.holds)
            self.take(really=not as_told)
        if begins_anew:
            self._begin_anew()
        if begins_anew or emptied:
            self.sailed = self.away = self.told_to_hold = False
            self.verified = self.verified and not came_up
        elif self.ours_to_sail:
            self.away = False
            # AUTO, by whomever, ends it; before it has held it is told again.
            self.told_to_hold = self.told_to_hold and not self.seen_to_hold
        elif self.told_to_hold and self.holds:
            self.seen_to_hold = True
        elif self.before is Action.GO_HOME and self.under_way:
            pass  # told to return and still in AUTO: told again, whatever is on board by now
        elif self.sailed:
            self.away, self.told_to_hold = True, False
            self.take(really=not homeward)

    def _begin_anew(self) -> None:
        if self.resume == "never":
            self.take(really=self.sailed)
        elif self.taken_at is not None and self.taken_at >= self.state.booted:
            self.taken_at = None
        if self.ever_set_off or self.ever_armed:
            self.may_start = False

    def take(self, *, really: bool = True) -> None:
        if really and self.taken_at is None:
            self.taken_at = self.now

    @property
    def ever_taken(self) -> bool:
        return self.taken_at is not None

    @property
    def sound(self) -> bool:
        supported = self.state.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        return supported and self.state.system_status < CRITICAL

    @property
    def under_way(self) -> bool:
        return self.sound and self.state.mode == AUTO and self.state.armed

    @property
    def holds(self) -> bool:
        return self.sound and self.state.mode == HOLD and self.state.armed

    @property
    def ours_to_sail(self) -> bool:
        """In AUTO and armed, with nothing on board that is known to be somebody else's."""
        others = {OnBoard.REPLACED, OnBoard.EMPTY} | (set() if self.adopt else {OnBoard.FOREIGN})
        return self.under_way and self.on_board not in others

    @rule(mode=st.sampled_from([AUTO, AUTO, AUTO, HOLD, RTL, MANUAL]))
    def mode_selected(self, mode: int) -> None:
        self.hear(mode=mode)

    @rule(armed=st.booleans())
    def armed_or_disarmed(self, armed: bool) -> None:
        self.hear(armed=armed)

    @rule()
    def started_by_the_operator(self) -> None:
        self.on_board = OnBoard.OURS
        self.authority.mission_read(OnBoard.OURS)
        sound = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        self.hear(mode=AUTO, armed=True, system_status=ACTIVE, autopilot=sound)

    @rule(status=st.sampled_from([ACTIVE, ACTIVE, CRITICAL, EMERGENCY]))
    def status(self, status: int) -> None:
        self.hear(system_status=status)

    @rule(autopilot=st.sampled_from([mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA] * 2 + [mavlink.MAV_AUTOPILOT_PX4]))
    def another_autopilot(self, autopilot: int) -> None:
        self.hear(autopilot=autopilot)

    @rule(ekf_ok=st.sampled_from([True, False, None]), gps_fix_type=st.sampled_from([1, 3]))
    def position(self, ekf_ok: bool | None, gps_fix_type: int) -> None:
        self.hear(heartbeat=False, ekf_ok=ekf_ok, gps_fix_type=gps_fix_type)

    @rule(remaining=st.sampled_from([None, 0.1, 0.3, 0.9]))
    def battery(self, remaining: float | None) -> None:
        self.hear(heartbeat=False, battery_remaining=remaining)

    @rule(state=st.sampled_from([mavlink.MISSION_STATE_NO_MISSION, mavlink.MISSION_STATE_ACTIVE, 0]))
    def mission_state(self, state: int) -> None:
        self.hear(heartbeat=False, mission_state=state)

    @rule(
        heard_before=st.integers(0, 2),
        at_once=st.booleans(),
        armed=st.booleans(),
        mode=st.sampled_from([AUTO, HOLD, MANUAL]),
    )
    def reboot(self, heard_before: int, at_once: bool, armed: bool, mode: int) -> None:
        """Heartbeats may be heard before the clock tells of it."""
        booted = self.now + 0.5
        for _ in range(heard_before):
            self.hear(armed=armed, mode=mode)
        self.comes_up = True
        self.hear(heartbeat=False, reboots=self.state.reboots + 1, booted=booted)
        if at_once:
            self.hear(armed=armed, mode=mode)

    @rule()
    def heartbeat(self) -> None:
        self.hear()

    @rule(on_board=st.sampled_from(OnBoard))
    def mission_read(self, on_board: OnBoard) -> None:
        self.on_board = on_board
        self.authority.mission_read(on_board)
        self.hear(heartbeat=False)

    @precondition(lambda self: self.permission.allowed)
    @rule()
    def upload_begun(self) -> None:
        self.uploading = True

    @precondition(lambda self: self.uploading)
    @rule()
    def upload_verified(self) -> None:
        self.uploading, self.verified, self.on_board = False, True, OnBoard.OURS
        self.authority.upload_verified()
        self.hear(heartbeat=False)

    @precondition(lambda self: self.uploading)
    @rule(unknown=st.booleans())
    def upload_failed(self, unknown: bool) -> None:
        self.uploading = False
        self.on_board = OnBoard.DAMAGED if unknown else self.on_board
        self.authority.upload_failed(unknown)
        self.hear(heartbeat=False)

    @precondition(lambda self: self.permission.allowed)
    @rule()
    def upload_at_once(self) -> None:
        self.upload_begun()
        self.upload_verified()

    @rule()
    def another_is_asked_for(self) -> None:
        self.verified = False
        self.authority.ask_for_another()
        self.hear(heartbeat=False)

    @rule(cause=st.sampled_from([None, "the budget is spent"]))
    def return_cause(self, cause: str | None) -> None:
        self.authority.return_cause = cause
        self.hear(heartbeat=False)

    @precondition(lambda self: self.mode == "full" and self.authority.in_command)
    @rule()
    def held_from_ashore(self) -> None:
        self.before = self.authority.action
        self.told_to_hold = self.authority.hold(self.state)
        self.seen_to_hold = self.released = False
        self.told_home = self.told_home or self.authority.action is Action.GO_HOME
        self.permission = self.authority.decide(self.state)

    @precondition(lambda self: self.mode == "full")
    @rule()
    def started_and_held_from_ashore(self) -> None:
        self.started_by_the_operator()
        if self.authority.in_command:
            self.held_from_ashore()
            self.holds_as_it_was_told()

    @rule()
    def holds_as_it_was_told(self) -> None:
        if self.told_to_hold:
            self.hear(mode=HOLD)

    @rule()
    def released_from_ashore(self) -> None:
        self.released = self.released or (self.told_to_hold and self.seen_to_hold and self.holds)
        self.before = self.authority.action
        self.authority.release(self.state)
        self.told_home = self.told_home or self.authority.action is Action.GO_HOME
        self.permission = self.authority.decide(self.state)

    @rule()
    def order_given_up(self) -> None:
        """It was told to hold or to return, and has not."""
        self.before = self.authority.action
        self.told_to_hold = self.told_to_hold and self.before is not Action.HOLD
        self.authority.give_up_order(self.state)
        assert self.authority.action not in (Action.HOLD, Action.GO_HOME)
        self.permission = self.authority.decide(self.state)

    @precondition(lambda self: self.authority.action in STARTS)
    @rule()
    def order_undone(self) -> None:
        """It did what it was told, and somebody has stopped it at once."""
        self.before = self.authority.action
        self.authority.order_undone(self.state)
        self.take()
        self.away = self.sailed
        self.told_to_hold = self.released = False
        self.permission = self.authority.decide(self.state)

    @rule(allowed=st.booleans())
    def start_from_ashore(self, allowed: bool) -> None:
        self.may_start = allowed
        self.authority.allow_start(allowed)
        self.hear(heartbeat=False)

    # What holds whatever happens ---------------------------------------------------------------------------------

    @invariant()
    def who_looks_on_only_listens(self) -> None:
        if self.mode == "observe":
            assert self.authority.action is Action.LISTEN
            assert not self.permission.allowed
            assert not self.authority.may_speak
            assert not self.authority.may_transfer
            assert not self.authority.in_command

    @invariant()
    def missions_are_all_that_missions_allows(self) -> None:
        if self.mode == "missions":
            assert self.authority.action not in (*STARTS, Action.GO_HOME, Action.HOLD)

    @invariant()
    def a_failsafe_or_a_strange_autopilot_is_left_alone(self) -> None:
        if not self.sound:
            assert self.authority.action in (Action.LISTEN, Action.READ)
            assert not self.permission.allowed
            assert not self.authority.in_command

    @invariant()
    def a_boat_that_was_taken_is_left_alone(self) -> None:
        if self.away:
            # What another station put on board in AUTO is looked at: it may be ours again.
            assert self.authority.action in (
                (Action.LISTEN, Action.READ) if self.under_way else (Action.LISTEN,)
            )
            assert not self.permission.allowed
            assert not self.authority.in_command

    @invariant()
    def taken_for_good_with_never(self) -> None:
        if self.resume == "never" and self.ever_taken:
            assert self.authority.action in (Action.LISTEN, Action.READ)
            assert not self.permission.allowed
            assert not self.authority.in_command

    @invariant()
    def what_is_not_ours_is_not_overwritten(self) -> None:
        if not self.permission.allowed:
            return
        assert self.on_board not in (OnBoard.UNREAD, OnBoard.REPLACED)
        assert self.adopt or self.on_board is not OnBoard.FOREIGN
        assert self.on_board is not OnBoard.EMPTY or not self.sailed

    @invariant()
    def uploads_need_auto_or_a_survey_not_started(self) -> None:
        if self.permission.allowed:
            assert self.under_way or (not self.sailed and self.state.mode != AUTO)

    @invariant()
    def it_starts_by_itself_only_if_nobody_ever_took_it(self) -> None:
        action, state = self.authority.action, self.state
        if action not in STARTS or self.released:
            return
        assert self.mode == "full"
        assert self.may_start
        assert not self.ever_taken
        assert not self.sailed
        assert self.verified
        assert self.on_board is OnBoard.OURS
        assert state.position_ok
        assert state.ekf_ok is True
        if action is Action.ARM:
            assert state.mode == AUTO
            assert not state.armed
        else:
            assert state.mode != AUTO
            assert not state.armed or state.mode == HOLD

    @invariant()
    def it_is_told_to_hold_only_from_ashore_and_in_auto(self) -> None:
        if self.authority.action is Action.HOLD:
            assert self.mode == "full"
            assert self.told_to_hold
            assert self.under_way

    @invariant()
    def a_boat_that_holds_is_left_alone_until_it_is_released(self) -> None:
        if self.told_to_hold and self.seen_to_hold:
            assert self.holds
            assert self.authority.action is (Action.SELECT_AUTO if self.released else Action.LISTEN)
            assert not self.permission.allowed

    @invariant()
    def it_is_sent_home_from_auto_for_a_cause_and_once(self) -> None:
        if self.authority.action is not Action.GO_HOME:
            return
        assert self.mode == "full"
        assert self.under_way
        if self.before is Action.SAIL:
            remaining = self.state.battery_remaining
            low = (
                self.return_battery is not None and remaining is not None and remaining <= self.return_battery
            )
            assert low or self.authority.return_cause is not None
        assert self.before in (*UNDERWAY, Action.HOLD), "from AUTO under our mission, or told again"

    @invariant()
    def auto_gives_it_to_us(self) -> None:
        """Silence alone would satisfy all the others."""
        kept = self.resume == "never" and self.ever_taken
        if self.mode == "observe" or kept or not self.under_way or self.on_board is not OnBoard.OURS:
            return
        if self.told_to_hold:
            assert self.authority.action is Action.HOLD
            return
        assert self.authority.action in UNDERWAY
        assert self.permission.allowed or self.authority.action is Action.GO_HOME
        if self.mode == "missions":
            assert self.authority.in_command

    @invariant()
    def why_is_said(self) -> None:
        assert self.authority.reason
        assert "{" not in self.authority.reason


TestAuthority = AuthorityMachine.TestCase
TestAuthority.settings = settings(
    max_examples=int(os.environ.get("HALOCLINE_EXAMPLES", "300")),
    stateful_step_count=40,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
