"""Bytes of an instrument into whole lines, within bounds whatever comes."""

from dataclasses import dataclass

LONGEST_LINE = 1024
"""Bytes. The lines of CTDs have a tenth of that, NMEA's 82; a longer one is noise, or the wrong baud rate."""


_SEVEN_BITS = bytes(byte & 0x7F for byte in range(256))


@dataclass
class LineCounters:
    """What came in: `too_long` lines were given up, `fragments` are what a stream began or broke off with."""

    bytes_in: int = 0
    lines: int = 0
    too_long: int = 0
    fragments: int = 0


class LineSplitter:
    """Cuts bytes into lines at line feeds and carriage returns; empty lines are none.

    A stream is entered anywhere: what comes before its first end of a line may be the rest of one, and looks like a
    sound line all too easily ("33.512" without its 3). It is left out, and so is what has no end when a stream breaks
    off. A datagram holds whole lines, the last of which need not end.
    """

    def __init__(self, *, is_stream: bool, data_bits: int = 8) -> None:
        self._is_stream = is_stream
        self._seven = data_bits == 7
        self._tail = b""
        self._skipping = is_stream
        self.counters = LineCounters()

    def restart(self) -> None:
        """Another stream begins."""
        self.counters.fragments += bool(self._tail)
        self._tail = b""
        self._skipping = self._is_stream

    def add(self, data: bytes) -> list[str]:
        """Take in bytes; returns the lines that they complete, without their ends, as Latin-1."""
        self.counters.bytes_in += len(data)
        if self._seven:
            data = data.translate(_SEVEN_BITS)
        *ended, tail = (self._tail + data).replace(b"\r", b"\n").split(b"\n")
        if not self._is_stream:
            ended, tail = [*ended, tail], b""
        lines = []
        for raw in ended:
            if self._skipping:
                self._skipping = False
                self.counters.fragments += bool(raw)
            elif len(raw) > LONGEST_LINE:
                self.counters.too_long += 1
            elif raw.strip():
                lines.append(raw.decode("latin-1").strip())
        if len(tail) > LONGEST_LINE:
            self.counters.too_long += 1
            tail, self._skipping = b"", True
        self._tail = tail
        self.counters.lines += len(lines)
        return lines
