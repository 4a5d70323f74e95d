"""Asking a vehicle that has appeared for its newest values, until it answers. Knows no network or clock."""

PATIENCE_S = (1.0, 60.0)
"""Pause after the first question that brought nothing, and after the last of many."""
LONGEST_S = 90.0
"""A question that is open for longer is given up, whatever the network says."""


class Greeting:
    """Whether to ask now.

    What is asked before a router knows that the vehicle answers ends without an answer, and so does what comes when
    the vehicle has too many questions already. Plan and survey may not be told again by themselves for hours.
    """

    def __init__(self) -> None:
        self._wanted = self._open = False
        self._asked_s = self._not_before = 0.0
        self._pause_s = PATIENCE_S[0]

    def begin(self) -> None:
        """The vehicle has appeared: ask it at once."""
        self._wanted, self._open = True, False
        self._not_before, self._pause_s = 0.0, PATIENCE_S[0]

    def question(self, now: float) -> bool:
        """Whether to ask, which counts as asked; `closed` must be called when the answer is complete."""
        waits = self._open and now < self._asked_s + LONGEST_S
        if not self._wanted or waits or now < self._not_before:
            return False
        self._open, self._asked_s = True, now
        self._not_before = now + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, PATIENCE_S[1])
        return True

    def answered(self) -> None:
        """The vehicle has said something, whatever it was."""
        self._wanted = False

    def closed(self) -> None:
        """No more answers to a question will come."""
        self._open = False
