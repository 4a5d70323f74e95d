"""Bytes of answers that have not been read yet: only so many at a time, whoever asks and does not read."""

from collections.abc import Iterator
from contextlib import contextmanager


class BusyError(Exception):
    """More is asked for than can be given at a time."""


class Allowance:
    """Room for answers on their way.

    Args:
        maximum_bytes: of all together; one alone may be larger.
    """

    def __init__(self, maximum_bytes: int) -> None:
        self._maximum_bytes = maximum_bytes
        self._taken_bytes = 0

    @contextmanager
    def taken(self, size_bytes: int) -> Iterator[None]:
        """Room for an answer while it is written. BusyError if there is none."""
        if self._taken_bytes and self._taken_bytes + size_bytes > self._maximum_bytes:
            raise BusyError
        self._taken_bytes += size_bytes
        try:
            yield
        finally:
            self._taken_bytes -= size_bytes
