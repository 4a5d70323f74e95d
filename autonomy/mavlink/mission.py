"""Putting a mission on board so that it can be trusted: upload, read back, compare, make it current."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_current import MakeCurrent, MakingCurrent
from autonomy.mavlink.mission_download import Download, MissionDownload
from autonomy.mavlink.mission_items import (
    Mission,
    MissionItem,
    Route,
    missions_equal,
    only_known_places,
    waypoint,
    with_home,
)
from autonomy.mavlink.mission_upload import MissionUpload, Upload

__all__ = [
    "Failed",
    "Mission",
    "MissionDownload",
    "MissionItem",
    "MissionTransfer",
    "MissionUpload",
    "Phase",
    "Route",
    "Verified",
    "missions_equal",
    "time_scale",
    "waypoint",
]

_ROUNDS = 5


def time_scale(clock_rate: float) -> float:
    """The factor by which retries are sped up for a vehicle whose clock runs `clock_rate` times as fast."""
    return 1.0 / min(10.0, max(1.0, clock_rate))


@dataclass(frozen=True)
class Verified:
    """The mission was read back from the vehicle and is what was sent (without home)."""

    mission: Mission


@dataclass(frozen=True)
class Failed:
    """The transfer ended without success.

    With `on_board_unknown` the vehicle may hold the old mission, the new one or a mixture of both: read it
    back and send again. Without it the mission on board is still the old one, or, if `on_board` is given,
    verified to be the new one, only not yet being sailed. With `permanent` the vehicle has refused it, and would
    again; with `no_space` because it has so many items.
    """

    reason: str
    on_board_unknown: bool
    on_board: Mission | None = None
    permanent: bool = False
    no_space: bool = False


class Phase(Enum):
    """What a transfer is doing."""

    IDLE = "idle"
    UPLOADING = "uploading"
    READING = "reading back"
    MAKING_CURRENT = "making it current"
    ENDED = "ended"


class MissionTransfer:
    """One mission, from a list of waypoints to "on board, verified and being sailed".

    Theory of operation. Three machines in a row; each ends in one of its own final states:

        phase            machine           good end           bad end
        UPLOADING        MissionUpload     READING            ENDED: Failed
        READING          MissionDownload   equal: next [a]    ENDED: Failed
                                           differs: UPLOADING, at most five rounds
        MAKING_CURRENT   MakeCurrent       ENDED: Verified    ENDED: Failed, with the mission on board

    [a] MAKING_CURRENT if `make_current` (the vehicle is in AUTO and armed), else ENDED: Verified.

    With `on_board`, for a mission that has just been read back equal, it begins at [a]. What is read back may hold
    items of the missions in `replaces`, too; one at any other place has been put there by another station meanwhile,
    and is not overwritten: ENDED, Failed and `contested`.

    An upload isn't atomic: once the vehicle may have heard of it, a failure leaves the mission on board
    unknown. Requests are answered in every phase, since doubled or late packets may make the vehicle ask
    again when we believe to be past that, and the answer is always the same items. After `limit_s` of
    protocol time the transfer ends in any case.

    `items` are the waypoints without home; the machine puts in item 0 where the autopilot wants one. Raises
    ValueError for an empty list. `time_scale` is the result of `time_scale(clock_rate)`; `mission_state` is
    the vehicle's last one, so that a completed mission is restarted.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        route: Route,
        *,
        autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        make_current: bool = False,
        on_board: bool = False,
        replaces: Sequence[Sequence[MissionItem]] = (),
        mission_state: int = mavlink.MISSION_STATE_UNKNOWN,
        time_scale: float = 1.0,
        limit_s: float = 60.0,
    ) -> None:
        if not items:
            raise ValueError("a mission needs at least one waypoint, got none")
        self.items = tuple(items)
        self._route = route
        self._autopilot = autopilot
        self.makes_current = make_current
        self._on_board = on_board
        self._replaces = tuple(replaces)
        self._mission_state = mission_state
        self._time_scale = time_scale
        self._limit_s = limit_s
        self._ends_at = 0.0
        self._rounds = 0
        self._touched = False
        self.contested = False
        """Whether somebody else was uploading meanwhile: what is overwritten may have been the operator's."""
        self._upload = self._new_upload()
        self._machine: MissionUpload | MissionDownload | MakeCurrent = self._upload
        self.phase = Phase.IDLE
        self.outcome: Verified | Failed | None = None

    def next_deadline(self) -> float | None:
        """Protocol time at which `on_deadline` wants to be called; None when the transfer has ended."""
        if self.phase in (Phase.IDLE, Phase.ENDED):
            return None
        deadline = self._machine.next_deadline()
        return self._ends_at if deadline is None else min(deadline, self._ends_at)

    def start(self, now: float) -> list[Any]:
        """Begin; returns what to send."""
        self._ends_at = now + self._limit_s
        return self._after_read_back(now) if self._on_board else self._upload_again(now)

    def handle(self, now: float, message: Any) -> list[Any]:
        """React to one message of the vehicle; returns what to send."""
        if self.phase in (Phase.IDLE, Phase.ENDED):
            return []
        if message.get_type() == "MISSION_CURRENT" and self._route.is_from_vehicle(message):
            self._mission_state = message.mission_state
        answers = self._machine.handle(now, message)
        self.contested = self.contested or self._upload.contested
        if self._machine is not self._upload:
            answers += self._upload.handle(now, message)
        return answers + self._proceed(now)

    def on_deadline(self, now: float) -> list[Any]:
        """Repeat what may have been lost, or give up, if it is time to."""
        if self.phase in (Phase.IDLE, Phase.ENDED):
            return []
        if now >= self._ends_at:
            phase = self.phase.value
            last_words = self._upload.cancel() if self.phase is Phase.UPLOADING else []
            self._fail(f"not finished within {self._limit_s:g} s: {phase}")
            return last_words
        answers = self._machine.on_deadline(now)
        return answers + self._proceed(now)

    def cancel(self) -> list[Any]:
        """End the transfer at once; returns what to send."""
        if self.phase in (Phase.IDLE, Phase.ENDED):
            return []
        last_words = self._upload.cancel() if self.phase is Phase.UPLOADING else []
        self._fail("cancelled")
        return last_words

    def _new_upload(self) -> MissionUpload:
        items = with_home(self.items, self._autopilot)
        return MissionUpload(items, self._route, time_scale=self._time_scale)

    def _upload_again(self, now: float) -> list[Any]:
        self._touched = self._touched or self._upload.touched
        if self._rounds >= _ROUNDS:
            return self._fail(f"the mission read back differs from the one sent, {_ROUNDS} times")
        self._rounds += 1
        self._upload = self._new_upload()
        self._machine = self._upload
        self.phase = Phase.UPLOADING
        return self._upload.start(now)

    def _proceed(self, now: float) -> list[Any]:
        """Go to the next phase when the present machine has come to its end."""
        machine = self._machine
        if isinstance(machine, MissionUpload):
            return self._after_upload(now, machine)
        if isinstance(machine, MissionDownload):
            return self._after_download(now, machine)
        if machine.state is MakingCurrent.DONE:
            return self._succeed()
        if machine.state is MakingCurrent.FAILED:
            return self._fail(machine.reason, permanent=machine.refused)
        return []

    def _after_upload(self, now: float, upload: MissionUpload) -> list[Any]:
        if upload.state is Upload.FAILED:
            return self._fail(upload.reason, permanent=upload.refused)
        if upload.state is not Upload.SENT:
            return []
        self._machine = MissionDownload(self._route, autopilot=self._autopilot, time_scale=self._time_scale)
        self.phase = Phase.READING
        return self._machine.start(now)

    def _after_download(self, now: float, download: MissionDownload) -> list[Any]:
        if download.state is Download.FAILED:
            return self._fail(download.reason)
        if download.mission is None:
            return []
        if not missions_equal(self.items, download.mission):
            if only_known_places(download.mission, (self.items, *self._replaces)):
                return self._upload_again(now)
            self.contested = True
            return self._fail("another station has put a mission on board meanwhile")
        return self._after_read_back(now)

    def _after_read_back(self, now: float) -> list[Any]:
        if not self.makes_current:
            return self._succeed()
        self._machine = MakeCurrent(
            self._route,
            autopilot=self._autopilot,
            mission_state=self._mission_state,
            time_scale=self._time_scale,
        )
        self.phase = Phase.MAKING_CURRENT
        return self._machine.start(now)

    def _succeed(self) -> list[Any]:
        self.phase = Phase.ENDED
        self.outcome = Verified(self.items)
        return []

    def _fail(self, reason: str, *, permanent: bool = False) -> list[Any]:
        verified = self.phase is Phase.MAKING_CURRENT
        touched = self._touched or self._upload.touched
        self.outcome = Failed(
            reason,
            touched and not verified,
            self.items if verified else None,
            permanent=permanent,
            no_space=self._upload.no_space,
        )
        self.phase = Phase.ENDED
        return []
