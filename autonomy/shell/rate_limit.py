"""How much may be sent on a thin link, and when: so little that nothing waits in its buffers."""

OVERHEAD_BYTES = 130
"""Of a message beside its payload: headers of TCP and IP, zenoh's frame, its encoding, the acknowledgement."""

_BURST_S = 2.0


class RateLimit:
    """A bucket that fills at so many bytes per second, and may be overdrawn by one message: then all wait.

    What is handed to zenoh cannot be called back. On a link that is slower than we send, the newest would queue behind
    what is old by then; so the waiting is done here, where the newest is still to be chosen.

    Args:
        bytes_per_s: of the link that we may use; None: there is no limit.
    """

    def __init__(self, bytes_per_s: float | None) -> None:
        self.bytes_per_s = bytes_per_s
        self._balance = 0.0
        self._at: float | None = None

    def wait_s(self, now: float) -> float:
        """How long nothing may be sent, by any clock that only goes forward; 0 if something may be now."""
        if self.bytes_per_s is None:
            return 0.0
        elapsed = 0.0 if self._at is None else now - self._at
        self._at = now
        self._balance = min(self._balance + elapsed * self.bytes_per_s, _BURST_S * self.bytes_per_s)
        return max(0.0, -self._balance / self.bytes_per_s)

    def spend(self, payload_bytes: int) -> None:
        """A message with so much in it was sent."""
        if self.bytes_per_s is not None:
            self._balance -= payload_bytes + OVERHEAD_BYTES

    def worth_s(self, payload_bytes: int) -> float:
        """For how long such a message has the link to itself; 0 without a limit."""
        return 0.0 if self.bytes_per_s is None else (payload_bytes + OVERHEAD_BYTES) / self.bytes_per_s
