"""Who has the boat: the operator, the autopilot's failsafes, or we. `TABLE` is the whole of it.

One line for every state (`Command`) and event: who has the boat after it, what we may do then, and how that is said.
`Authority` goes along the lines; what `authority.mode` and `authority.resume` change is in tables of their own below.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal

Mode = Literal["missions", "full", "observe"]
Resume = Literal["when_auto_again", "never"]


class Command(Enum):
    """Who has the boat."""

    BEFORE_START = "the operator, who has not started the survey yet"
    OURS = "we"
    DISPLACED = "whoever has put his mission in place of ours"
    SENT_HOME = "we, and it has been told to return"
    RETURNING = "the autopilot, which brings it home because we asked for it"
    STOPPING = "we, and it has been told to hold"
    HELD = "we, and it holds because it was told to"
    YIELDED = "the operator or a failsafe"
    OBSERVED = "somebody else: we only look on"


class Event(Enum):
    """What the vehicle is doing, as far as command goes; the first that applies."""

    UNSUPPORTED = "no ArduPilot Rover"
    FAILSAFE = "system status critical or worse"
    REBOOTED = "first heartbeat since its clock began anew, disarmed"
    CLEARED = "not in AUTO, and no mission is on board; and it is not as it was told to be, either"
    EMPTIED = "in HOLD, armed, as it shall be since it was told to hold, and no mission is on board"
    HOMEWARD = "in the mode that brings it home"
    HOLDING = "in HOLD, armed, as it shall be since it was told to hold"
    RELEASED = "the same, and it shall go on"
    READY = "not in AUTO, disarmed or in HOLD, sure of its position, our mission verified on board"
    ELSEWHERE = "in any other mode but AUTO"
    READY_IN_AUTO = "in AUTO, disarmed, sure of its position, our mission verified on board"
    DISARMED = "in AUTO, disarmed"
    OTHERS = "in AUTO, armed, with a mission on board that is somebody else's, or none"
    LOW = "in AUTO, armed, our mission, and it shall return: the battery has fallen to that share, or the budget"
    HALT = "in AUTO, armed, our mission or one that is uncertain, and it shall hold: asked for from ashore"
    OURS = "in AUTO, armed, our mission (or `adopt`, and it never was ours)"
    UNCERTAIN = "in AUTO, armed, the mission on board not read, or in part or damaged by an upload of ours"


class Action(Enum):
    """What we may do."""

    LISTEN = "send nothing but heartbeats and words to the operator"
    READ = "read what is on board, too"
    PREPARE = "put a mission on board, once; again only if that failed"
    SELECT_AUTO = "as PREPARE, and select AUTO"
    ARM = "as PREPARE, and arm"
    SAIL = "replace our mission, and make it current"
    GO_HOME = "select the mode that brings it home"
    HOLD = "select HOLD"


@dataclass(frozen=True)
class Rule:
    """One cell of the table: who has the boat now, what we may do, and how that is said."""

    after: Command
    action: Action
    reason: str


_B, _O, _D, _S, _R, _Y, _T, _H = (
    Command.BEFORE_START,
    Command.OURS,
    Command.DISPLACED,
    Command.SENT_HOME,
    Command.RETURNING,
    Command.YIELDED,
    Command.STOPPING,
    Command.HELD,
)
_E, _A = Event, Action
_STRANGE = "{unsupported}"
_FAILSAFE = "a failsafe has the boat (system status {status})"
_TAKEN = "the operator has the boat ({mode}{disarmed}): we wait for AUTO"
_WAIT = "waiting for the operator to arm and select AUTO{or_start} ({mode})"
_UNDER_WAY = "in AUTO under our mission"
_UNSURE = "in AUTO, but {on_board}"
_MISSION = "{on_board}"
_HOME = "on its way home ({mode})"
_SENDING = "{cause}: the boat is told to return"
_STOPPING = "paused from ashore: the boat is told to hold"
_HELD = "paused from ashore: the boat holds{stuck}"
_RELEASED = "AUTO is being selected ({mode})"
_KEPT = "the boat was taken, and stays taken (authority.resume: never)"

_TABLE: Mapping[tuple[Command, Event], Rule] = {
    # Before the survey was started: a mission waits on board, or we wait for leave to put one there.
    (_B, _E.UNSUPPORTED): Rule(_B, _A.LISTEN, _STRANGE),
    (_B, _E.FAILSAFE): Rule(_B, _A.READ, _FAILSAFE),
    (_B, _E.REBOOTED): Rule(_B, _A.PREPARE, _WAIT),
    (_B, _E.CLEARED): Rule(_B, _A.PREPARE, _WAIT),
    (_B, _E.READY): Rule(_B, _A.PREPARE, _WAIT),
    (_B, _E.HOMEWARD): Rule(_B, _A.PREPARE, _WAIT),
    (_B, _E.ELSEWHERE): Rule(_B, _A.PREPARE, _WAIT),
    (_B, _E.READY_IN_AUTO): Rule(_B, _A.READ, _WAIT),
    (_B, _E.DISARMED): Rule(_B, _A.READ, _WAIT),
    (_B, _E.OTHERS): Rule(_B, _A.READ, _MISSION),
    (_B, _E.LOW): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_B, _E.OURS): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_B, _E.UNCERTAIN): Rule(_B, _A.PREPARE, _MISSION),
    # We have the boat: anything but AUTO, armed, under our mission ends that at once.
    (_O, _E.UNSUPPORTED): Rule(_Y, _A.LISTEN, _STRANGE),
    (_O, _E.FAILSAFE): Rule(_Y, _A.LISTEN, _FAILSAFE),
    (_O, _E.REBOOTED): Rule(_B, _A.PREPARE, _WAIT),
    (_O, _E.CLEARED): Rule(_Y, _A.LISTEN, _TAKEN),
    (_O, _E.READY): Rule(_Y, _A.LISTEN, _TAKEN),
    (_O, _E.HOMEWARD): Rule(_Y, _A.LISTEN, _TAKEN),
    (_O, _E.ELSEWHERE): Rule(_Y, _A.LISTEN, _TAKEN),
    (_O, _E.READY_IN_AUTO): Rule(_Y, _A.LISTEN, _TAKEN),
    (_O, _E.DISARMED): Rule(_Y, _A.LISTEN, _TAKEN),
    (_O, _E.OTHERS): Rule(_D, _A.READ, _MISSION),
    (_O, _E.LOW): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_O, _E.OURS): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_O, _E.UNCERTAIN): Rule(_O, _A.SAIL, _UNSURE),
    # In AUTO, but the mission on board is another station's: it holds, and we go on reading what is there.
    (_D, _E.UNSUPPORTED): Rule(_Y, _A.LISTEN, _STRANGE),
    (_D, _E.FAILSAFE): Rule(_Y, _A.LISTEN, _FAILSAFE),
    (_D, _E.REBOOTED): Rule(_B, _A.PREPARE, _WAIT),
    (_D, _E.CLEARED): Rule(_B, _A.PREPARE, _WAIT),
    (_D, _E.READY): Rule(_Y, _A.LISTEN, _TAKEN),
    (_D, _E.HOMEWARD): Rule(_Y, _A.LISTEN, _TAKEN),
    (_D, _E.ELSEWHERE): Rule(_Y, _A.LISTEN, _TAKEN),
    (_D, _E.READY_IN_AUTO): Rule(_Y, _A.LISTEN, _TAKEN),
    (_D, _E.DISARMED): Rule(_Y, _A.LISTEN, _TAKEN),
    (_D, _E.OTHERS): Rule(_D, _A.READ, _MISSION),
    (_D, _E.LOW): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_D, _E.OURS): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_D, _E.UNCERTAIN): Rule(_D, _A.READ, _MISSION),
    # Yielded: silence, until AUTO is back. But AUTO is refused without a mission: who has cleared it could not give
    # the boat back.
    (_Y, _E.UNSUPPORTED): Rule(_Y, _A.LISTEN, _STRANGE),
    (_Y, _E.FAILSAFE): Rule(_Y, _A.LISTEN, _FAILSAFE),
    (_Y, _E.REBOOTED): Rule(_B, _A.PREPARE, _WAIT),
    (_Y, _E.CLEARED): Rule(_B, _A.PREPARE, _WAIT),
    (_Y, _E.READY): Rule(_Y, _A.LISTEN, _TAKEN),
    (_Y, _E.HOMEWARD): Rule(_Y, _A.LISTEN, _TAKEN),
    (_Y, _E.ELSEWHERE): Rule(_Y, _A.LISTEN, _TAKEN),
    (_Y, _E.READY_IN_AUTO): Rule(_Y, _A.LISTEN, _TAKEN),
    (_Y, _E.DISARMED): Rule(_Y, _A.LISTEN, _TAKEN),
    (_Y, _E.OTHERS): Rule(_D, _A.READ, _MISSION),
    (_Y, _E.LOW): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_Y, _E.OURS): Rule(_O, _A.SAIL, _UNDER_WAY),
    (_Y, _E.UNCERTAIN): Rule(_O, _A.SAIL, _UNSURE),
}
_ALIKE = {
    _E.HALT: _E.OURS,
    _E.HOLDING: _E.ELSEWHERE,
    _E.RELEASED: _E.ELSEWHERE,
    _E.EMPTIED: _E.CLEARED,
}
"""Where nothing is told to hold, these are no more than those."""

TABLE: Mapping[tuple[Command, Event], Rule] = {
    **_TABLE,
    **{
        (before, event): _TABLE[before, alike]
        for before in (_B, _O, _D, _Y)
        for event, alike in _ALIKE.items()
    },
}
"""`authority.mode: missions`, `authority.resume: when_auto_again`: every state and event has its line."""

_FULL: Mapping[tuple[Command, Event], Rule] = {
    (_B, _E.READY): Rule(_B, _A.SELECT_AUTO, _RELEASED),
    (_B, _E.READY_IN_AUTO): Rule(_B, _A.ARM, "the boat is being armed"),
    (_O, _E.LOW): Rule(_S, _A.GO_HOME, _SENDING),
    # Told to return, and still in AUTO: told again. Any mode but the one it was told is the operator's.
    **{(_S, event): rule for (before, event), rule in TABLE.items() if before is _O},
    **{(_S, event): Rule(_S, _A.GO_HOME, _SENDING) for event in (_E.OTHERS, _E.OURS, _E.UNCERTAIN, _E.LOW)},
    (_S, _E.HOMEWARD): Rule(_R, _A.LISTEN, _HOME),
    # On its way: whoever selects another mode has the boat, and AUTO gives it back to us.
    **{(_R, event): rule for (before, event), rule in TABLE.items() if before is _Y},
    (_R, _E.HOMEWARD): Rule(_R, _A.LISTEN, _HOME),
    (_R, _E.CLEARED): Rule(_Y, _A.LISTEN, _TAKEN),
    # Told to hold, and still in AUTO: told again. HOLD is what it was told; any other mode is the operator's.
    (_O, _E.HALT): Rule(_T, _A.HOLD, _STOPPING),
    **{(_T, event): rule for (before, event), rule in TABLE.items() if before is _O},
    (_T, _E.LOW): Rule(_S, _A.GO_HOME, _SENDING),
    (_T, _E.HALT): Rule(_T, _A.HOLD, _STOPPING),
    (_T, _E.HOLDING): Rule(_H, _A.LISTEN, _HELD),
    (_T, _E.EMPTIED): Rule(_B, _A.PREPARE, _WAIT),
    (_T, _E.RELEASED): Rule(_H, _A.SELECT_AUTO, _RELEASED),
    # It holds: whoever selects another mode, or disarms it, has the boat. AUTO, by whomever, ends it. Who clears its
    # mission has not taken it: another comes on board.
    **{(_H, event): rule for (before, event), rule in TABLE.items() if before is _Y},
    (_H, _E.CLEARED): Rule(_Y, _A.LISTEN, _TAKEN),
    (_H, _E.HOLDING): Rule(_H, _A.LISTEN, _HELD),
    (_H, _E.RELEASED): Rule(_H, _A.SELECT_AUTO, _RELEASED),
}
"""What is different with `authority.mode: full`."""

_NEVER: Mapping[tuple[Command, Event], Rule] = {
    **{(before, event): Rule(_Y, _A.LISTEN, _KEPT) for before in (_Y, _D) for event in Event},
    (_Y, _E.UNSUPPORTED): Rule(_Y, _A.LISTEN, _STRANGE),
    (_Y, _E.FAILSAFE): Rule(_Y, _A.LISTEN, _FAILSAFE),
    # It comes up disarmed: who sees that before its clock tells of the reboot can't know better.
    **{(before, _E.REBOOTED): Rule(_Y, _A.LISTEN, _KEPT) for before in (_O, _S, _R, _T, _H)},
}  # fmt: skip
"""What is different with `authority.resume: never`."""

_OBSERVE: Mapping[tuple[Command, Event], Rule] = {
    (Command.OBSERVED, event): Rule(
        Command.OBSERVED, Action.LISTEN, "looking on ({mode}{disarmed}): authority.mode is observe"
    )
    for event in Event
}
"""All there is with `authority.mode: observe`."""


def table_of(mode: Mode, resume: Resume) -> Mapping[tuple[Command, Event], Rule]:
    """The table in force under a configuration."""
    if mode == "observe":
        return _OBSERVE
    table = {**TABLE, **(_FULL if mode == "full" else {})}
    if resume == "never":
        table.update({line: rule for line, rule in _NEVER.items() if line in table})
    return table
