"""Follows who has the boat along the table of `authority_table`, and says what we may do, and why."""

from dataclasses import dataclass
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.authority_table import Action, Command, Event, Mode, Resume, table_of
from autonomy.mavlink.rover import AUTO, HOLD, RTL, mode_name, unsupported
from autonomy.mavlink.vehicle import VehicleState

JITTER_S = 0.1
"""A vehicle's clock tells when it began anew as exactly as the link is even."""


class OnBoard(Enum):
    """What is known about the mission on board."""

    UNREAD = "the mission on board has not been read yet"
    EMPTY = "no mission on board"
    OURS = "our mission is on board"
    PARTIAL = "an upload of ours is under way: the boat has part of it at most"
    DAMAGED = "an upload of ours failed half-way"
    FOREIGN = "a mission we don't know is on board"
    REPLACED = "somebody has put another mission on board in place of ours"


class Hold(Enum):
    """Whether the boat shall hold because people ashore want it to."""

    NONE = "nobody has asked for it"
    WANTED = "it shall"
    RELEASED = "it was told to, and shall go on"
    STUCK = "it shall, for it did not go on in time when it was to"


@dataclass(frozen=True)
class Permission:
    """Whether a mission may be uploaded now, and why (not)."""

    allowed: bool
    reason: str


class Authority:
    """Follows who has the boat along the table, and says what we may do and why.

    Args:
        adopt: whether a mission we don't know may be replaced before the first AUTO; it then counts as ours. One
            that came in place of ours never does.
        mode: what we may do at all.
        resume: how a boat that was taken is given back.
        return_mode: the autopilot's mode that brings the boat home.
        return_battery: share of the charge with which it returns (mode `full`); None: never.
        starts_by_itself: whether it needs no `start` from ashore (mode `full`).
        heeds_start: whether anybody ashore can give it `start`.

    A reboot leads back to BEFORE_START: the vehicle comes up disarmed, in a mode nobody has chosen, perhaps
    without its mission, and then no operator could select AUTO. A clock alone is a poor witness of that, and
    BEFORE_START allows an upload: so the first heartbeat after the clock started again decides. If it is armed
    (the clock was wrong, or the vehicle was armed again before we heard of it), nothing changes: whoever has the
    boat keeps it, and AUTO gives it to us as ever. A vehicle that is armed from boot on (ARMING_REQUIRE 0) and
    has lost its mission needs its operator, or a restart of the service.

    `full` starts the boat only as long as nobody has ever taken it from us: after that the operator starts it. Nor
    does a boat start by itself whose autopilot began anew after it had been armed, by whomever, or was about to be: a
    supply that breaks down under the motor would have it arm again and again. It waits for its operator, or for
    `start`. What stopped it was not taking it, though, in whichever order heartbeat and clock tell of it.

    It is sent home once; an operator who selects AUTO after that has decided otherwise. For the battery's sake it is
    again, once it has been seen disarmed with more of a charge: that is another voyage, perhaps days later. Who selects
    AUTO while it holds has decided otherwise, too.
    """

    def __init__(
        self,
        adopt: bool,
        mode: Mode = "missions",
        resume: Resume = "when_auto_again",
        return_mode: int = RTL,
        return_battery: float | None = None,
        *,
        starts_by_itself: bool = True,
        heeds_start: bool = True,
    ) -> None:
        self._adopt = adopt
        self._is_full = mode == "full"
        self._stays_taken = resume == "never"
        self._table = table_of(mode, resume)
        self._starts_by_itself, self._heeds_start = starts_by_itself, heeds_start
        self._start_allowed: bool | None = None
        self._hold = Hold.NONE
        self._return_mode = return_mode
        self._return_battery = return_battery
        self._waiting_on_board = False
        self._reboots = 0
        self._decisive_heartbeat: int | None = None
        self._taken_at: float | None = None
        self._ever_set_off = self._has_restarted = False
        self._ever_sent_home = self._heeded_battery = False
        self._ever_armed = False
        self.return_cause: str | None = None
        """Why the boat shall return whatever its battery says; None: it need not."""
        self.command = Command.OBSERVED if mode == "observe" else Command.BEFORE_START
        self.action = Action.LISTEN
        self.on_board = OnBoard.UNREAD
        self.reason = "waiting for the vehicle"

    @property
    def survey_started(self) -> bool:
        """Whether the vehicle has been in AUTO, armed, under our mission (since its last reboot or cleared mission).

        While we only look on: whether it has been armed.
        """
        if self.command is Command.OBSERVED:
            return self._ever_armed
        return self.command is not Command.BEFORE_START

    @property
    def waits_for_start(self) -> bool:
        """Whether it does not start by itself (mode `full`) until `allow_start`."""
        return not (self._starts_by_itself if self._start_allowed is None else self._start_allowed)

    @property
    def was_ever_taken(self) -> bool:
        """Whether somebody has ever taken the boat from us."""
        return self._taken_at is not None

    @property
    def is_held(self) -> bool:
        """Whether it holds, or has been told to, since people ashore want it."""
        return self.command in (Command.STOPPING, Command.HELD)

    @property
    def in_command(self) -> bool:
        """Whether we have the boat: it is in AUTO, armed, under our mission."""
        return self.command is Command.OURS

    @property
    def may_speak(self) -> bool:
        """Whether anything may be asked of the vehicle at all."""
        return self.action is not Action.LISTEN

    @property
    def may_transfer(self) -> bool:
        """Whether the mission on board may be read, if nothing more."""
        return self.action not in (Action.LISTEN, Action.GO_HOME, Action.HOLD)

    @property
    def waits_on_board(self) -> bool:
        """Whether a mission of ours waits on board for the operator to start it, and might be replaced."""
        preparing = not self.survey_started and self.action in (Action.PREPARE, Action.SELECT_AUTO)
        return preparing and self._waiting_on_board and self.on_board is OnBoard.OURS

    def take_restart(self) -> bool:
        """Whether since the last call the autopilot of a boat began anew that waits for its operator now."""
        has_restarted, self._has_restarted = self._has_restarted, False
        return has_restarted

    def ask_for_another(self) -> None:
        """The mission that waits on board is not fit to be started from where the boat is now: replace it, once."""
        self._waiting_on_board = False

    def allow_start(self, allowed: bool) -> None:
        """People ashore let it start by itself, or do not (mode `full`)."""
        self._start_allowed = allowed

    def hold(self, state: VehicleState) -> bool:
        """People ashore want the boat, which is ours, to hold (mode `full`); returns whether it is told to."""
        self._hold = Hold.WANTED
        self.observe(state)
        return self.is_held

    def release(self, state: VehicleState) -> None:
        """They want it to go on."""
        if self.command is Command.HELD:
            self._hold = Hold.RELEASED
            self.observe(state)

    def hold_again(self, state: VehicleState) -> None:
        """It was to go on and has not, and nobody expects it to any more."""
        if self.command is Command.HELD:
            self._hold = Hold.STUCK
            self.observe(state)

    def order_undone(self, state: VehicleState) -> None:
        """It was set in motion, and somebody has stopped it before we saw it move: he has taken the boat."""
        self._take(state)
        self._hold = Hold.NONE
        if self.command is Command.HELD or self._stays_taken:
            self.command = Command.YIELDED
        self.observe(state)

    def give_up_order(self, state: VehicleState) -> None:
        """It was told to hold or to return, and sails on in AUTO: then it is ours as before, and not told again."""
        if self.command in (Command.STOPPING, Command.SENT_HOME):
            self.command, self._hold = Command.OURS, Hold.NONE
            self.observe(state)

    def settle(self, begun: Command) -> None:
        """What was remembered may have been under another configuration; a new authority had `begun` with this."""
        if Command.OBSERVED in (begun, self.command):
            # Whether we may command at all is for this run's configuration to say.
            self.command = begun
        elif (self.command, Event.OURS) not in self._table:
            self.command = Command.YIELDED

    def is_ready(self, state: VehicleState) -> bool:
        """Whether it could be started, and nobody has ever taken it from us."""
        sure = state.position_ok and state.ekf_ok is True
        return sure and self.on_board is OnBoard.OURS and self._waiting_on_board and not self.was_ever_taken

    def mission_read(self, on_board: OnBoard) -> None:
        """The mission on board was read, or is known to have changed."""
        self.on_board = on_board

    def upload_verified(self) -> None:
        """A mission of ours is on board."""
        self.on_board = OnBoard.OURS
        self._waiting_on_board = True

    def upload_begun(self) -> None:
        """The vehicle may have heard of an upload of ours. Under way it sails on, and its end is waited for."""
        if not self.in_command:
            self.on_board = OnBoard.PARTIAL

    def upload_failed(self, on_board_unknown: bool) -> None:
        """An upload of ours ended without success."""
        if on_board_unknown:
            self.on_board = OnBoard.DAMAGED

    def observe(self, state: VehicleState) -> None:
        """Follow the vehicle's mode, arming, status and reboots."""
        self._ever_armed = self._ever_armed or state.armed
        event = self._event(state)
        if event is Event.REBOOTED:
            self._begin_anew(state)
        rule = self._table[self.command, event]
        if event in (Event.REBOOTED, Event.CLEARED, Event.EMPTIED) and rule.after is Command.BEFORE_START:
            if event is Event.REBOOTED or self.command is not Command.BEFORE_START:
                self._waiting_on_board = False
            rule = self._table[Command.BEFORE_START, self._present(state)]
        self.command, self.action = rule.after, rule.action
        if not self.is_held:
            self._hold = Hold.NONE
        if rule.after in (Command.YIELDED, Command.DISPLACED):
            self._take(state)
        starting = rule.action in (Action.SELECT_AUTO, Action.ARM)
        self._ever_set_off = self._ever_set_off or starting or self.survey_started
        if rule.after is Command.SENT_HOME:
            self._ever_sent_home = self._heeded_battery = True
        elif not state.armed and state.battery_remaining is not None and not self._is_low(state):
            self._heeded_battery = False
        self.reason = self._say(rule.reason, state)

    def decide(self, state: VehicleState) -> Permission:
        """Whether a mission may be uploaded to the vehicle in this state."""
        self.observe(state)
        sailing = self.action is Action.SAIL
        starts = (Action.PREPARE, Action.SELECT_AUTO, Action.ARM)
        if not sailing and (self.survey_started or self.action not in starts):
            return Permission(False, self.reason)
        if not self._may_replace():
            return Permission(False, self._refusal())
        if sailing:
            return Permission(True, self.reason)
        if self._waiting_on_board and self.on_board is OnBoard.OURS:
            return Permission(False, self.reason)
        return Permission(True, "before the first AUTO a mission is put on board")

    def _take(self, state: VehicleState) -> None:
        if self._taken_at is None:
            self._taken_at = state.heard

    def _begin_anew(self, state: VehicleState) -> None:
        """The autopilot did: what has been seen since then was nobody's will, nor is it to start by itself again."""
        if self._taken_at is not None and self._taken_at >= state.booted - JITTER_S:
            self._taken_at = None
        had_begun = self._ever_set_off or (self._is_full and self._ever_armed)
        if self._is_full and had_begun:
            self._start_allowed = False
        after = self._table[self.command, Event.REBOOTED].after
        self._has_restarted = had_begun and after is Command.BEFORE_START

    def _event(self, state: VehicleState) -> Event:
        if self._has_rebooted(state):
            return Event.REBOOTED
        return self._present(state)

    def _has_rebooted(self, state: VehicleState) -> bool:
        if state.reboots != self._reboots:
            self._reboots = state.reboots
            self._decisive_heartbeat = state.heartbeats + 1
        if self._decisive_heartbeat is None or state.heartbeats < self._decisive_heartbeat:
            return False
        self._decisive_heartbeat = None
        return not state.armed

    def _present(self, state: VehicleState) -> Event:
        if unsupported(state):
            return Event.UNSUPPORTED
        if state.system_status >= mavlink.MAV_STATE_CRITICAL:
            return Event.FAILSAFE
        return self._in_auto(state) if state.mode == AUTO else self._out_of_auto(state)

    def _out_of_auto(self, state: VehicleState) -> Event:
        empty = state.mission_state == mavlink.MISSION_STATE_NO_MISSION
        holds = state.mode == HOLD and state.armed
        if holds and self._hold is not Hold.NONE:
            as_told = Event.RELEASED if self._hold is Hold.RELEASED else Event.HOLDING
            return Event.EMPTIED if empty else as_told
        homeward = state.mode == self._return_mode
        if empty and not (homeward and self.command in (Command.SENT_HOME, Command.RETURNING)):
            return Event.CLEARED
        if homeward:
            return Event.HOMEWARD
        ready = self._may_start(state) and (holds or not state.armed)
        return Event.READY if ready else Event.ELSEWHERE

    def _in_auto(self, state: VehicleState) -> Event:
        if not state.armed:
            return Event.READY_IN_AUTO if self._may_start(state) else Event.DISARMED
        event = self._under_way(state)
        # A boat that goes home need not hold.
        halts = self._hold is Hold.WANTED and event in (Event.OURS, Event.UNCERTAIN)
        return Event.HALT if halts else event

    def _under_way(self, state: VehicleState) -> Event:
        if self.on_board is OnBoard.PARTIAL:
            return Event.UNCERTAIN
        if self.on_board is OnBoard.OURS or (self._adopt and self.on_board is not OnBoard.REPLACED):
            removed = self.on_board is OnBoard.EMPTY and self.survey_started
            return Event.OTHERS if removed else self._with_ours(state)
        uncertain = self.on_board in (OnBoard.UNREAD, OnBoard.DAMAGED)
        return Event.UNCERTAIN if uncertain else Event.OTHERS

    def _with_ours(self, state: VehicleState) -> Event:
        must_return = self.return_cause is not None and not self._ever_sent_home
        is_low = self._is_low(state) and not self._heeded_battery
        return Event.LOW if must_return or is_low else Event.OURS

    def _is_low(self, state: VehicleState) -> bool:
        remaining = state.battery_remaining
        return (
            self._return_battery is not None and remaining is not None and remaining <= self._return_battery
        )

    def _may_start(self, state: VehicleState) -> bool:
        return self.is_ready(state) and not self.waits_for_start

    def _may_replace(self) -> bool:
        if self.on_board in (OnBoard.UNREAD, OnBoard.REPLACED):
            return False
        if self.on_board is OnBoard.EMPTY:
            return not self.survey_started
        return self._adopt or self.on_board in (OnBoard.OURS, OnBoard.PARTIAL, OnBoard.DAMAGED)

    def _refusal(self) -> str:
        if self.on_board is OnBoard.FOREIGN:
            return f"{self.on_board.value}: set mavlink.adopt: true to replace it"
        if self.on_board is OnBoard.EMPTY and self.survey_started:
            return "somebody has removed the mission from on board"
        return str(self.on_board.value)

    def _say(self, reason: str, state: VehicleState) -> str:
        battery = state.battery_remaining
        may_be_told = self.waits_for_start and self._heeds_start and not self.was_ever_taken
        return reason.format(
            unsupported=unsupported(state),
            status=state.system_status,
            mode=mode_name(state.mode),
            disarmed="" if state.armed else ", disarmed",
            or_start=", or for `start` from ashore" if may_be_told else "",
            stuck=", for it could not be set in motion" if self._hold is Hold.STUCK else "",
            on_board=self._refusal(),
            cause=self.return_cause or f"the battery is at {battery or 0.0:.0%}",
        )
