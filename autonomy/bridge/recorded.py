"""Lines that were recorded: by the bridge itself, or by any program that writes down what comes from a port."""

import asyncio
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from autonomy.bridge.lines import LONGEST_LINE

_LONGEST_PAUSE_S = 60.0
_LONGEST_ENTRY = 65_536


@dataclass(frozen=True)
class Recorded:
    """A line, and how long after the one before it came."""

    pause_s: float
    line: str


class RecordingError(ValueError):
    """A file that no lines can be had from; says why."""


def read_recorded(path: Path, every_s: float = 1.0) -> Iterator[Recorded]:
    """The lines of a recording of the bridge's with their pauses, or of any text file, one every `every_s`.

    Raises:
        OSError: it can't be read.
        RecordingError: a line of a recording is none.
    """
    before: float | None = None
    with path.open("rb") as stream:
        for number, raw in enumerate(iter(partial(stream.readline, _LONGEST_ENTRY), b""), start=1):
            text = raw.decode("utf-8", errors="replace").strip()
            if number == 1 and text.startswith('{"bridge":'):
                before = -1.0
            elif before is not None:
                host_s, line = _entry(text, number)
                yield Recorded(
                    0.0 if before < 0.0 else min(max(0.0, host_s - before), _LONGEST_PAUSE_S), line
                )
                before = host_s
            elif raw.strip():
                yield Recorded(every_s, raw.decode("latin-1").strip()[: LONGEST_LINE + 1])


async def play(lines: Sequence[Recorded] | Iterator[Recorded], on_line: Callable[[str], None]) -> None:
    """Hand over lines at their own pace."""
    loop = asyncio.get_running_loop()
    due = loop.time()
    for each in lines:
        due += each.pause_s
        await asyncio.sleep(due - loop.time())
        on_line(each.line)


def _entry(text: str, number: int) -> tuple[float, str]:
    try:
        entry = json.loads(text)
    except (ValueError, RecursionError):
        raise RecordingError(f"line {number} is no JSON: a recording that was cut off?") from None
    match entry:
        case {"host_s": int() | float() as host_s, "line": str() as line}:
            return float(host_s), line
    raise RecordingError(f"line {number} is no line of a recording")
