"""Who has the boat: the operator, the autopilot's failsafes, or we."""

from dataclasses import dataclass
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.telemetry import VehicleState

AUTO = 10
ROVER_MODES = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
}
_ROVERS = (mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_TYPE_SURFACE_BOAT)


def mode_name(custom_mode: int) -> str:
    """The name ArduPilot Rover gives to a mode."""
    return str(ROVER_MODES.get(custom_mode, f"mode {custom_mode}"))


class OnBoard(Enum):
    """What is known about the mission on board."""

    UNREAD = "the mission on board has not been read yet"
    EMPTY = "no mission on board"
    OURS = "our mission is on board"
    DAMAGED = "an upload of ours failed half-way"
    FOREIGN = "a mission we don't know is on board"


class Command(Enum):
    """Who has the boat."""

    BEFORE_START = "the operator, who has not started the survey yet"
    OURS = "we"
    YIELDED = "the operator or a failsafe"


class Situation(Enum):
    """What the vehicle is doing, as far as command goes."""

    UNSUPPORTED = "unsupported"
    FAILSAFE = "failsafe"
    IN_AUTO = "in AUTO, armed"
    DISARMED = "in AUTO, disarmed"
    OTHER_MODE = "in another mode"


@dataclass(frozen=True)
class Permission:
    """Whether a mission may be uploaded now, and why (not)."""

    allowed: bool
    reason: str


_B, _O, _Y = Command.BEFORE_START, Command.OURS, Command.YIELDED
_NEXT = {
    (_B, Situation.OTHER_MODE): _B,
    (_B, Situation.DISARMED): _B,
    (_B, Situation.FAILSAFE): _B,
    (_B, Situation.UNSUPPORTED): _B,
    (_B, Situation.IN_AUTO): _O,  # only with a mission that is ours, see `observe`
    (_O, Situation.OTHER_MODE): _Y,
    (_O, Situation.DISARMED): _Y,
    (_O, Situation.FAILSAFE): _Y,
    (_O, Situation.UNSUPPORTED): _Y,
    (_O, Situation.IN_AUTO): _O,
    (_Y, Situation.OTHER_MODE): _Y,
    (_Y, Situation.DISARMED): _Y,
    (_Y, Situation.FAILSAFE): _Y,
    (_Y, Situation.UNSUPPORTED): _Y,
    (_Y, Situation.IN_AUTO): _O,
}


class Authority:
    """Keeps track of who has the boat and says when a mission may be uploaded.

    Theory of operation.

        command       AUTO and armed                     anything else
        BEFORE_START  OURS, if the mission is ours [a]   BEFORE_START
        OURS          OURS                               YIELDED: the operator (or a failsafe) has the boat
        YIELDED       OURS                               YIELDED; out of AUTO without any mission: BEFORE_START [b]

    [a] Or if `adopt`, which takes a mission we don't know as permission to replace it.

    [b] AUTO is refused without a mission: an operator who has cleared it out of AUTO and wants the survey to go on
    could not give the boat back otherwise.

    A reboot of the vehicle leads back to BEFORE_START: it comes up disarmed, in a mode nobody has chosen, perhaps
    without its mission, and then no operator could select AUTO. A clock alone is a poor witness of that, and
    BEFORE_START allows an upload: so the first heartbeat after the clock started again decides. If it is armed
    (the clock was wrong, or the vehicle was armed again before we heard of it), nothing changes: whoever has the
    boat keeps it, and AUTO gives it to us as ever. A vehicle that is armed from boot on (ARMING_REQUIRE 0) and
    has lost its mission needs its operator, or a restart of the service.

    An upload is allowed
      BEFORE_START, not in AUTO: once, if the mission on board is empty or ours (or `adopt`); again only if an
                                 upload failed, since that leaves a damaged mission;
      BEFORE_START, in AUTO:     with `adopt` only (with our mission the command is OURS at once);
      OURS:                      while the mission on board is still ours, or was damaged by us (or `adopt`);
      YIELDED:                   never.
    """

    def __init__(self, adopt: bool) -> None:
        self._adopt = adopt
        self._waiting_on_board = False
        self._reboots = 0
        self._decisive_heartbeat: int | None = None
        self.command = Command.BEFORE_START
        self.on_board = OnBoard.UNREAD
        self.reason = "waiting for the vehicle"

    @property
    def survey_started(self) -> bool:
        """Whether the vehicle has been in AUTO, armed, under our mission (since its last reboot or cleared mission)."""
        return self.command is not Command.BEFORE_START

    @property
    def in_command(self) -> bool:
        """Whether we have the boat: it is in AUTO, armed, under our mission."""
        return self.command is Command.OURS

    def mission_read(self, on_board: OnBoard) -> None:
        """The mission on board was read, or is known to have changed."""
        self.on_board = on_board

    def upload_verified(self) -> None:
        """A mission of ours is on board."""
        self.on_board = OnBoard.OURS
        self._waiting_on_board = True

    def upload_failed(self, on_board_unknown: bool) -> None:
        """An upload of ours ended without success."""
        if on_board_unknown:
            self.on_board = OnBoard.DAMAGED

    def observe(self, state: VehicleState) -> None:
        """Follow the vehicle's mode, arming, status and reboots."""
        self._follow_reboots(state)
        situation = _situation(state)
        after = _NEXT[self.command, situation]
        if self.command is Command.BEFORE_START and after is Command.OURS and not self._may_take_over():
            after = Command.BEFORE_START
        cleared = state.mission_state == mavlink.MISSION_STATE_NO_MISSION
        if after is Command.YIELDED and situation is Situation.OTHER_MODE and cleared:
            after, self._waiting_on_board = Command.BEFORE_START, False
        self.command = after
        self.reason = self._explain(state, situation)

    def _follow_reboots(self, state: VehicleState) -> None:
        if state.reboots != self._reboots:
            self._reboots = state.reboots
            self._decisive_heartbeat = state.heartbeats + 1
        if self._decisive_heartbeat is None or state.heartbeats < self._decisive_heartbeat:
            return
        self._decisive_heartbeat = None
        if not state.armed:
            self._waiting_on_board = False
            self.command = Command.BEFORE_START

    def decide(self, state: VehicleState) -> Permission:
        """Whether a mission may be uploaded to the vehicle in this state."""
        self.observe(state)
        situation = _situation(state)
        if situation in (Situation.UNSUPPORTED, Situation.FAILSAFE) or self.command is Command.YIELDED:
            return Permission(False, self.reason)
        if not self._may_replace():
            return Permission(False, self._refusal())
        if self.command is Command.OURS:
            return Permission(True, self.reason)
        if situation is Situation.DISARMED:
            return Permission(False, self.reason)
        if self._waiting_on_board and self.on_board is OnBoard.OURS:
            return Permission(False, self.reason)
        return Permission(True, "before the first AUTO a mission is put on board")

    def _may_take_over(self) -> bool:
        return self._adopt or self.on_board is OnBoard.OURS

    def _may_replace(self) -> bool:
        if self.on_board is OnBoard.UNREAD:
            return False
        if self._adopt or self.on_board in (OnBoard.OURS, OnBoard.DAMAGED):
            return True
        return self.on_board is OnBoard.EMPTY and self.command is Command.BEFORE_START

    def _refusal(self) -> str:
        if self.on_board is OnBoard.FOREIGN:
            return f"{self.on_board.value}: set mavlink.adopt: true to replace it"
        return str(self.on_board.value)

    def _explain(self, state: VehicleState, situation: Situation) -> str:
        if situation is Situation.UNSUPPORTED:
            return unsupported(state)
        if situation is Situation.FAILSAFE:
            return f"a failsafe has the boat (system status {state.system_status})"
        mode = mode_name(state.mode)
        if self.command is Command.OURS:
            return "in AUTO under our mission"
        if self.command is Command.YIELDED:
            armed = "" if state.armed else ", disarmed"
            return f"the operator has the boat ({mode}{armed}): we wait for AUTO"
        if situation is Situation.IN_AUTO:
            return self._refusal()
        return f"waiting for the operator to arm and select AUTO ({mode})"


def _situation(state: VehicleState) -> Situation:
    if unsupported(state):
        return Situation.UNSUPPORTED
    if state.system_status >= mavlink.MAV_STATE_CRITICAL:
        return Situation.FAILSAFE
    if state.mode != AUTO:
        return Situation.OTHER_MODE
    return Situation.IN_AUTO if state.armed else Situation.DISARMED


def unsupported(state: VehicleState) -> str:
    """Why this vehicle's modes can't be understood; empty if they can."""
    if state.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        name = "PX4" if state.autopilot == mavlink.MAV_AUTOPILOT_PX4 else f"MAV_AUTOPILOT {state.autopilot}"
        return f"unsupported autopilot {name}: only ArduPilot Rover's modes are known"
    if state.vehicle_type not in _ROVERS:
        return f"unsupported vehicle type {state.vehicle_type}: only ArduPilot Rover's modes are known"
    return ""
