"""Brings plans on board: one transfer at a time, and only the newest plan waits.

New plans arriving faster than uploads finish is the classic failure of a lossy link, so a running transfer is
let end. What is on board is read before it is replaced, and again whenever it may have changed.
"""

from dataclasses import dataclass
from typing import Any

from autonomy.mavlink.authority import Authority, OnBoard
from autonomy.mavlink.mission import (
    Failed,
    MissionDownload,
    MissionItem,
    MissionTransfer,
    Route,
    missions_equal,
)
from autonomy.mavlink.mission_download import Download
from autonomy.mavlink.telemetry import VehicleState
from autonomy.planning.plan import Plan

RETRY_S = 2.0
"""Pause after a failed transfer; the link that failed it needs a moment."""


@dataclass(frozen=True, eq=False)
class Dispatched:
    """A plan and the mission items that carry it out."""

    plan: Plan
    items: tuple[MissionItem, ...]


class MissionDispatch:
    """The one owner of mission traffic with the vehicle; tells `authority` what is on board."""

    def __init__(self, authority: Authority) -> None:
        self._authority = authority
        self.active: Dispatched | None = None
        self._waiting: Dispatched | None = None
        self._sending: Dispatched | None = None
        self._machine: MissionTransfer | MissionDownload | None = None
        self._left_mixture = False
        self._not_before = 0.0
        self._notes: list[str] = []

    @property
    def busy(self) -> bool:
        """Whether a plan is on its way on board or waits to be."""
        return self._sending is not None or self._waiting is not None

    def offer(self, dispatched: Dispatched) -> None:
        """Make this the plan to bring on board next; an older waiting one is dropped."""
        self._waiting = dispatched

    def withdraw(self) -> list[Any]:
        """Somebody else has the boat: drop the waiting plan, end a running upload; returns messages to send."""
        self._waiting = None
        if not isinstance(self._machine, MissionTransfer):
            return []
        messages = self._machine.cancel()
        self._void()
        return messages

    def forget(self) -> None:
        """The link was gone: what is on board must be read again; a transfer under way is void and starts anew."""
        self._waiting = self._waiting or self._sending
        self._void()

    def doubt(self) -> None:
        """Somebody else may have changed the mission on board: read it again."""
        if self._machine is None and self._authority.on_board is not OnBoard.UNREAD:
            self._notes.append("the mission on board has changed: reading it")
            self._authority.mission_read(OnBoard.UNREAD)

    def take_notes(self) -> list[str]:
        """What happened since the last call, for the log."""
        notes, self._notes = self._notes, []
        return notes

    def next_deadline(self) -> float | None:
        """When `step` must be called at the latest."""
        if self._machine is not None:
            return self._machine.next_deadline()
        has_work = self._waiting is not None or self._authority.on_board is OnBoard.UNREAD
        return self._not_before if has_work else None

    def step(self, now: float, vehicle: VehicleState, route: Route, time_scale: float) -> list[Any]:
        """Start what can be started and let the running machine keep its deadlines; returns messages to send."""
        if self._machine is not None:
            deadline = self._machine.next_deadline()
            sent = self._machine.on_deadline(now) if deadline is not None and deadline <= now else []
            self._conclude(now)
            return sent
        if now < self._not_before:
            return []
        if self._authority.on_board is OnBoard.UNREAD:
            self._machine = MissionDownload(route, autopilot=vehicle.autopilot, time_scale=time_scale)
            return self._machine.start(now)
        if self._waiting is None or not self._authority.decide(vehicle).allowed:
            return []
        self._sending, self._waiting = self._waiting, None
        self._machine = MissionTransfer(
            self._sending.items,
            route,
            autopilot=vehicle.autopilot,
            make_current=self._authority.in_command,
            mission_state=vehicle.mission_state,
            time_scale=time_scale,
        )
        return self._machine.start(now)

    def handle(self, now: float, message: Any) -> list[Any]:
        """Give a message to the running machine; returns messages to send."""
        if self._machine is None:
            return []
        sent = self._machine.handle(now, message)
        if isinstance(self._machine, MissionTransfer) and self._machine.contested:
            # What we would overwrite may be what the operator has just sent: look first.
            sent += self._machine.cancel()
            self._notes.append("somebody else is uploading a mission: ours waits")
            self._waiting = self._waiting or self._sending
            self._void()
            self._left_mixture, self._not_before = False, now + RETRY_S
        self._conclude(now)
        return sent

    def _void(self) -> None:
        self._left_mixture = self._left_mixture or self._sending is not None
        self._sending, self._machine = None, None
        self._authority.mission_read(OnBoard.UNREAD)

    def _conclude(self, now: float) -> None:
        """Draw the conclusions when the running machine has come to its end."""
        machine = self._machine
        if isinstance(machine, MissionDownload):
            if machine.state is Download.DONE:
                self._machine = None
                self._classify(machine.mission or ())
            elif machine.state is Download.FAILED:
                self._machine = None
                self._pause(now, f"the mission on board could not be read: {machine.reason}")
        elif machine is not None and machine.outcome is not None:
            if isinstance(machine.outcome, Failed):
                self._failed(now, machine.outcome)
            else:
                self._verified()
                self._notes.append(f"mission of {len(machine.items)} waypoints verified on board")
            self._machine, self._sending = None, None

    def _verified(self) -> None:
        self.active, self._left_mixture = self._sending, False
        self._authority.upload_verified()

    def _failed(self, now: float, failure: Failed) -> None:
        self._pause(now, f"mission transfer failed: {failure.reason}")
        if failure.on_board is not None:
            self._verified()
        else:
            self._left_mixture = self._left_mixture or failure.on_board_unknown
            self._authority.upload_failed(failure.on_board_unknown)
        # Whatever of it is on board: it is not being sailed, so it is sent again, unless a newer one waits.
        self._waiting = self._waiting or self._sending

    def _pause(self, now: float, note: str) -> None:
        self._not_before = now + RETRY_S
        self._notes.append(note)

    def _classify(self, items: tuple[MissionItem, ...]) -> None:
        if not items:
            on_board = OnBoard.EMPTY
        elif self.active is not None and missions_equal(self.active.items, items):
            on_board = OnBoard.OURS
        else:
            # A transfer of ours that ended half-way leaves a mixture of old and new items: ours to mend.
            on_board = OnBoard.DAMAGED if self._left_mixture else OnBoard.FOREIGN
        self._authority.mission_read(on_board)
        self._notes.append(f"{len(items)} waypoints on board: {on_board.value}")
