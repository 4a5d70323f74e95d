"""Brings plans on board: one transfer at a time, and only the newest plan waits.

New plans arriving faster than uploads finish is the classic failure of a lossy link, so a running transfer is
let end. What is on board is read before it is replaced, and again whenever it may have changed.
"""

from dataclasses import dataclass, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.aboard import Aboard
from autonomy.mavlink.authority import Authority, OnBoard, Permission
from autonomy.mavlink.mission import (
    Failed,
    Mission,
    MissionDownload,
    MissionTransfer,
    Route,
    missions_equal,
)
from autonomy.mavlink.mission_download import Download
from autonomy.mavlink.rover import AUTO
from autonomy.mavlink.vehicle import VehicleState
from autonomy.notes import Note
from autonomy.planning.plan import Plan

RETRY_S = 2.0
"""Pause after a failed transfer; the link that failed it needs a moment. Doubled with every further failure."""

LONGEST_RETRY_S = 60.0

FAILURES = 5
"""So many failed transfers of one plan in a row, and it is dropped."""

READ_AGAIN_S = 600.0
"""Protocol time after which a mission of ours that is being sailed is read again, whatever the autopilot tells."""


@dataclass(frozen=True, eq=False)
class Dispatched:
    """A plan and the mission items that carry it out, or its first stretch: item k is corner k of the plan."""

    plan: Plan
    items: Mission

    @property
    def is_whole(self) -> bool:
        """Whether the items reach to the plan's end."""
        return len(self.items) >= len(self.plan.route_m)


class MissionDispatch:
    """The one owner of mission traffic with the vehicle; tells `authority` what is on board.

    Theory of operation. At any time one machine at most talks to the vehicle. `step` starts the next one:

        nothing at all   while the operator or a failsafe has the boat: he may change the mission, so what we
                         knew of it is forgotten, and what we were doing is ended
        a download       when the mission on board is unread, and once more before a waiting plan replaces it; also
                         when somebody doubts that it is ours (`doubt`), and every ten minutes while it is sailed:
                         what we knew of it holds until it is read
        a transfer       of the waiting plan, if it is allowed; only its last step, if the plan is on board already

    After a failed transfer the plan waits again, for a pause that doubles from 2 s to 60 s. It is dropped when the
    vehicle refuses it, or after five failures in a row; `take_refusal` tells once. If it is refused because it is too
    long, its first half is sent, and nothing longer from then on.
    """

    def __init__(self, authority: Authority) -> None:
        self._authority = authority
        self.active: Dispatched | None = None
        """The newest plan that was verified on board."""
        self.reached = 0
        """Number of the last waypoint of the active plan that the vessel has reached."""
        self._waiting: Dispatched | None = None
        self._looked = False
        self._sending: Dispatched | None = None
        self._machine: MissionTransfer | MissionDownload | None = None
        self._aboard = Aboard()
        self._room: int | None = None
        self._not_before = 0.0
        self._stepped = 0.0
        self._failures = 0
        self._unread_failures = 0
        self._doubted = False
        self._read_s = 0.0
        self._refusal: str | None = None
        self._notes: list[Note] = []
        self.milestones = 0
        """How often a plan was given to bring on board, or verified to be there: worth remembering at once."""
        self._restart = False
        self._known = OnBoard.UNREAD
        self._started_early = False
        self.made_current = 0
        """How often a mission of ours was made the one that is sailed, from its first waypoint on."""

    @property
    def busy(self) -> bool:
        """Whether a plan is on its way on board or waits to be."""
        return self._sending is not None or self._waiting is not None

    @property
    def on_its_way(self) -> Plan | None:
        """The plan that waits to be brought on board, or is being; None if there is none."""
        next_one = self._waiting or self._sending
        return None if next_one is None else next_one.plan

    @property
    def talking(self) -> bool:
        """Whether a conversation about the mission is going on."""
        return self._machine is not None

    @property
    def conversation(self) -> object | None:
        """The download or transfer under way; None without one."""
        return self._machine

    def permission(self, vehicle: VehicleState) -> Permission:
        """Whether a mission may be uploaded now, and why (not)."""
        return self._authority.decide(vehicle)

    def offer(self, dispatched: Dispatched) -> None:
        """Make this the plan to bring on board next; an older waiting one is dropped."""
        self._waiting, self._looked = self._fitted(dispatched), False
        self._failures, self._restart = 0, False
        self.milestones += 1

    def make_current_again(self) -> None:
        """The vehicle does not sail the active plan, whatever it says: make it current once more."""
        if self.active is not None and not self.busy:
            self.offer(self.active)
            self._restart = True

    def drop_waiting(self) -> None:
        """A plan that waits is not wanted any more."""
        self._waiting = None

    def resume(self) -> None:
        """The service was away, and may not remember the last it did: an upload of what waits may have begun."""
        if self._waiting is not None:
            if self._aboard.mission is None and self.active is not None:
                self._aboard.interrupted(self.active.items)
            self._aboard.interrupted(self._waiting.items)
        self.forget()

    def forget(self) -> None:
        """The link was gone: what is on board must be read again; a transfer under way is void and starts anew."""
        self._not_before, self._unread_failures = 0.0, 0
        self._waiting = self._waiting or self._sending
        self._void()

    def compare(self, vehicle: VehicleState) -> None:
        """Read the mission on board again if its length is not the one we know; ever more rarely if that stays so."""
        if self._machine is None and self._aboard.differs(self._stepped, vehicle):
            self._note("the mission on board has changed: reading it")
            self._void()

    def may_be_on_board(self, vehicle: VehicleState) -> bool:
        """Whether the active plan may still be on board, as far as that is known without reading it."""
        return self.active is not None and self._aboard.may_be(self.active.items, vehicle)

    def doubt(self, reason: str) -> None:
        """The boat does not seem to sail what we know to be on board: read that again when nothing else is going on."""
        self._doubted = True
        self._note(f"{reason}: reading the mission on board")

    def take_notes(self) -> list[Note]:
        """What happened since the last call, for the log."""
        notes, self._notes = self._notes, []
        return notes

    def take_refusal(self) -> str | None:
        """Why a plan was given up since the last call; None if none was. The next one may fare no better."""
        refusal, self._refusal = self._refusal, None
        return refusal

    def next_deadline(self) -> float | None:
        """When `step` must be called at the latest; None when only an event can bring us further."""
        if self._machine is not None:
            return self._machine.next_deadline()
        unread = self._doubted or self._authority.on_board is OnBoard.UNREAD
        has_work = self._waiting is not None or unread
        return self._not_before if has_work and self._not_before > self._stepped else None

    def step(self, now: float, vehicle: VehicleState, route: Route, time_scale: float) -> list[Any]:
        """Start what can be started and let the running machine keep its deadlines; returns messages to send."""
        self._stepped = now
        if not self._authority.may_transfer:
            return self._withdraw()
        if self._machine is not None:
            self._started_early |= self._is_started_early(vehicle)
            deadline = self._machine.next_deadline()
            sent = self._machine.on_deadline(now) if deadline is not None and deadline <= now else []
            self._conclude(now)
            return sent
        if now < self._not_before:
            return []
        unread = self._authority.on_board is OnBoard.UNREAD or self._is_doubtful(now)
        if not unread and (self._waiting is None or not self.permission(vehicle).allowed):
            return []
        if unread or not self._looked:
            self._machine = MissionDownload(route, autopilot=vehicle.autopilot, time_scale=time_scale)
            return self._machine.start(now)
        return self._upload(now, vehicle, route, time_scale)

    def handle(self, now: float, message: Any) -> list[Any]:
        """Give a message to the running machine; returns messages to send."""
        if self._machine is None:
            return []
        sent = self._machine.handle(now, message)
        if isinstance(self._machine, MissionTransfer) and self._machine.contested:
            # What we would overwrite may be what the operator has just sent: look first.
            sent += self._machine.cancel()
            self.forget()
            self._note("somebody else is uploading a mission: ours waits")
            self._count_failure(now, "somebody else keeps uploading a mission")
        self._conclude(now)
        return sent

    def _is_doubtful(self, now: float) -> bool:
        """Whether what we know to be on board is to be read again."""
        sailed = self._authority.in_command and self._authority.on_board is OnBoard.OURS
        return self._doubted or (sailed and now - self._read_s >= READ_AGAIN_S)

    def _upload(self, now: float, vehicle: VehicleState, route: Route, time_scale: float) -> list[Any]:
        assert self._waiting is not None
        self._sending, self._waiting = self._waiting, None
        known = self._aboard.mission
        on_board = known is not None and missions_equal(self._sending.items, known)
        self._machine = MissionTransfer(
            self._sending.items,
            route,
            autopilot=vehicle.autopilot,
            make_current=self._authority.in_command,
            on_board=on_board,
            replaces=self._aboard.sources,
            mission_state=mavlink.MISSION_STATE_COMPLETE if self._restart else vehicle.mission_state,
            time_scale=time_scale,
        )
        self._known, self._started_early = self._authority.on_board, False
        if not on_board:
            self._authority.upload_begun()
        return self._machine.start(now)

    def _is_started_early(self, vehicle: VehicleState) -> bool:
        """Whether the operator has started a mission that was not yet on board: its rest follows, its start is past."""
        machine = self._machine
        sailing = vehicle.armed and vehicle.mode == AUTO
        return isinstance(machine, MissionTransfer) and not machine.makes_current and sailing

    def _withdraw(self) -> list[Any]:
        """Somebody else has the boat: drop the waiting plan, end what is running; returns messages to send."""
        self._waiting = None
        last_words = self._machine.cancel() if isinstance(self._machine, MissionTransfer) else []
        self._void()
        return last_words

    def _void(self) -> None:
        if self._sending is not None:
            self._aboard.interrupted(self._sending.items)
        self._sending = self._machine = None
        self._aboard.forget()
        self._doubted = False
        self._authority.mission_read(OnBoard.UNREAD)

    def _conclude(self, now: float) -> None:
        """Draw the conclusions when the running machine has come to its end."""
        machine = self._machine
        if isinstance(machine, MissionDownload):
            if machine.state is Download.DONE:
                self._machine, self._doubted, self._read_s = None, False, now
                self._classify(machine.mission or ())
            elif machine.state is Download.FAILED:
                self._machine = None
                self._note(f"the mission on board could not be read: {machine.reason}", is_warning=True)
                self._unread_failures += 1
                self._pause(now, self._unread_failures)
        elif machine is not None and machine.outcome is not None:
            assert self._sending is not None
            sent, self._machine, self._sending = self._sending, None, None
            if isinstance(machine.outcome, Failed):
                self._failed(now, sent, machine.outcome)
                return
            self._failures, self._read_s = 0, now
            self._verified(sent)
            self.made_current += machine.makes_current
            if self._started_early:
                self.make_current_again()

    def _verified(self, sent: Dispatched) -> None:
        self.active, self.reached = sent, 0
        self.milestones += 1
        self._aboard.verified(sent.items)
        self._authority.upload_verified()
        self._note(f"mission of {len(sent.items)} waypoints verified on board")

    def _failed(self, now: float, sent: Dispatched, failure: Failed) -> None:
        self._note(f"mission transfer failed: {failure.reason}", is_warning=True)
        if failure.on_board is not None:
            self._verified(sent)
        elif failure.on_board_unknown:
            self._aboard.interrupted(sent.items)
            self._aboard.forget()
            self._authority.upload_failed(on_board_unknown=True)
        else:
            self._authority.mission_read(self._known)
        if self._waiting is not None:  # a newer plan, which starts anew
            self._looked = False
            self._pause(now, 1)
            return
        # Whatever of it is on board: it is not being sailed, so it is sent again.
        self._looked = False
        if failure.no_space and len(sent.items) > 1:
            self._room = len(sent.items) // 2
            self._waiting = self._fitted(sent)
            self._note(f"the autopilot has no room for {len(sent.items)} waypoints: {self._room} are sent")
            self._pause(now, 1)
            return
        self._waiting = sent
        self._count_failure(now, failure.reason, permanent=failure.permanent)

    def _fitted(self, dispatched: Dispatched) -> Dispatched:
        """As much of it as the autopilot has room for, as far as that is known."""
        if self._room is None or len(dispatched.items) <= self._room:
            return dispatched
        return replace(dispatched, items=dispatched.items[: self._room])

    def _count_failure(self, now: float, reason: str, *, permanent: bool = False) -> None:
        """The waiting plan did not come on board: try again after a pause, or give it up."""
        self._failures += 1
        self._pause(now, self._failures)
        if not permanent and self._failures < FAILURES:
            return
        self._refusal = reason if permanent else f"{reason} ({self._failures} failures in a row)"
        self._note(f"the plan is given up: {self._refusal}", is_warning=True)
        self._waiting, self._failures = None, 0

    def _pause(self, now: float, failures: int) -> None:
        self._not_before = now + min(LONGEST_RETRY_S, RETRY_S * 2 ** (failures - 1))

    def _note(self, text: str, *, is_warning: bool = False) -> None:
        self._notes.append(Note(text, is_warning))

    def _classify(self, items: Mission) -> None:
        waiting = self._waiting
        self._unread_failures = 0
        if waiting is not None and missions_equal(waiting.items, items) and not self._authority.in_command:
            # Its upload had been complete when the link went; under way it still has to be made current.
            self._waiting = None
            self._verified(waiting)
            return
        self._looked = True
        on_board, changed = self._aboard.read(items, None if self.active is None else self.active.items)
        self._authority.mission_read(on_board)
        if on_board in (OnBoard.FOREIGN, OnBoard.REPLACED) and changed:
            self._waiting = None  # it was not made to replace this one
        if changed:
            self._note(f"{len(items)} waypoints on board: {on_board.value}")
