"""Starting the boat, holding it and sending it home, where the configuration lets us: `authority.mode: full`."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.authority_table import Action
from autonomy.mavlink.mission import Route
from autonomy.mavlink.orders import Answer, Order
from autonomy.mavlink.rover import AUTO, HOLD, mode_name
from autonomy.notes import Note

SEEN_AFTER = 2
"""Heartbeats after which it is seen what has become of an order that was accepted; the first may be an older one."""

PAUSE_S = 5.0
"""Protocol time after an order before the next: the vehicle needs a moment to follow, or cannot yet."""

SAY_AGAIN_S = 300.0
"""What has become of an order is told again no sooner while it goes on so: a boat whose safety switch is on refuses to
be armed every five seconds, all night."""


class Orders:
    """Turns the authority's action into one order at a time, given again while the action stays."""

    def __init__(self, return_mode: int) -> None:
        self._return_mode = return_mode
        self._order: Order | None = None
        self._action: Action | None = None
        self._not_before = 0.0
        self._heartbeats = 0
        self._accepted_at: int | None = None
        self._notes: list[Note] = []
        self._said: dict[str, float] = {}

    def next_deadline(self) -> float | None:
        """When `step` must be called at the latest."""
        if self._order is not None:
            return self._order.next_deadline()
        return None if self._action is None else self._not_before

    def take_notes(self) -> list[Note]:
        """What happened since the last call, for the log."""
        notes, self._notes = self._notes, []
        return notes

    def handle(self, message: Any) -> None:
        """Take in one message of the vehicle."""
        if self._order is not None:
            self._order.handle(message)

    def take_undone(self) -> bool:
        """Whether an order to move was accepted since the last call, and undone before it was seen to be followed."""
        if self._accepted_at is None or self._heartbeats < self._accepted_at + SEEN_AFTER:
            return False
        self._accepted_at = None
        if self._action not in (Action.ARM, Action.SELECT_AUTO):
            return False
        self._notes.append(Note(f"{self._words(self._action)}: undone at once by somebody", is_warning=True))
        return True

    def step(self, now: float, action: Action, heartbeats: int, route: Route, time_scale: float) -> list[Any]:
        """Do what the action asks for, the vehicle's `heartbeats` so far being taken in; returns messages to send."""
        self._heartbeats = heartbeats
        words = self._words(action)
        if words is None:
            self._order, self._action, self._not_before, self._accepted_at = None, None, 0.0, None
            self._said.clear()
            return []
        if action is not self._action:
            self._order, self._action, self._not_before, self._accepted_at = None, action, 0.0, None
        if self._order is not None:
            sent = self._order.on_deadline(now)
            self._conclude(now, words)
            return sent
        if now < self._not_before:
            return []
        self._order = Order(*self._order_of(action), route, time_scale)
        return self._order.start(now)

    def _conclude(self, now: float, words: str) -> None:
        assert self._order is not None
        if self._order.answer is not Answer.WAITING:
            refused = self._order.answer is not Answer.ACCEPTED
            text = f"{words}: {self._order.answer.value}"
            if now >= self._said.get(text, -math.inf) + SAY_AGAIN_S:
                self._said[text] = now
                self._notes.append(Note(text, is_warning=refused))
            if not refused and self._accepted_at is None:
                self._accepted_at = self._heartbeats
            self._order, self._not_before = None, now + PAUSE_S

    def _words(self, action: Action) -> str | None:
        return {
            Action.ARM: "arming",
            Action.SELECT_AUTO: "selecting AUTO",
            Action.HOLD: "selecting HOLD",
            Action.GO_HOME: f"selecting {mode_name(self._return_mode)}",
        }.get(action)

    def _order_of(self, action: Action) -> tuple[int, tuple[float, ...]]:
        if action is Action.ARM:
            return mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,)
        mode = {Action.SELECT_AUTO: AUTO, Action.HOLD: HOLD}.get(action, self._return_mode)
        return mavlink.MAV_CMD_DO_SET_MODE, (float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(mode))
