"""At the dock: a few lines, and what would be sent of them."""

import asyncio
import sys
from collections.abc import Hashable, Iterator
from pathlib import Path

from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.bridge.lines import LineSplitter
from autonomy.bridge.recorded import read_recorded
from autonomy.bridge.sections import ValueSection
from autonomy.bridge.translator import Translator
from autonomy.shell.transports import open_transport


class Checker:
    """Translates lines and says what it makes of them."""

    def __init__(self, configuration: BridgeConfiguration) -> None:
        self._translator = Translator(configuration)
        self._values = configuration.values
        self.lines = 0

    @property
    def read(self) -> int:
        """Lines that could be read."""
        return self._translator.read

    def take(self, now: float, line: str) -> Iterator[str]:
        """Take in a line that came at `now`; the line, and under it what would be sent."""
        self.lines += 1
        made = self._translator.take(now, line)
        yield line if line.isprintable() else ascii(line)
        if made.unreadable:
            yield f"  can't be read: {made.unreadable}"
        elif not made.numbers:
            yield "  another sentence"
        for name, number in made.numbers.items():
            yield f"  {name} = {number:.9g}{_corrections(self._values[name])}"
        if made.withheld:
            yield f"  withheld: {made.withheld}"


def _corrections(value: ValueSection) -> str:
    """What is done to it besides, in words."""
    if value.response == "sharpen":
        return f", to be sharpened; of water taken in {value.delay_s:g} s before"
    return f", of water taken in {value.lag_s:g} s before" if value.lag_s else ""


def check_file(configuration: BridgeConfiguration, path: Path, every_s: float, most: int) -> int:
    """Print what becomes of the first lines of a file; how many could be read."""
    checker, now = Checker(configuration), 0.0
    for each in read_recorded(path, every_s):
        if checker.lines >= most:
            break
        now += each.pause_s
        _print(checker.take(now, each.line))
    _sum_up(checker)
    return checker.read


async def check_instrument(configuration: BridgeConfiguration, most: int, seconds: float) -> int:
    """Print what becomes of the next lines of the instrument, for so long at most; how many could be read."""
    loop = asyncio.get_running_loop()
    checker, instrument = Checker(configuration), configuration.instrument
    enough = asyncio.Event()

    def received(data: bytes, peer: Hashable) -> None:
        for line in splitter.add(data):
            if checker.lines < most:
                _print(checker.take(loop.time(), line))
        if checker.lines >= most:
            enough.set()

    def became(reason: str) -> None:
        sys.stderr.write(f"{reason}\n")

    sys.stderr.write(f"listening to {instrument.endpoint} for {seconds:g} s\n")
    is_stream = not instrument.endpoint.startswith("udp")
    splitter = LineSplitter(is_stream=is_stream, data_bits=instrument.data_bits)
    port = open_transport(instrument.endpoint, received, on_up=splitter.restart, on_down=became)
    try:
        async with asyncio.timeout(seconds):
            await enough.wait()
    except TimeoutError:
        pass
    finally:
        await port.close()
    counters = splitter.counters
    if not checker.lines:
        said = (
            f"{counters.bytes_in} bytes, no whole line: another baud rate?"
            if counters.bytes_in
            else "nothing came"
        )
        sys.stderr.write(f"{said}\n")
    _sum_up(checker)
    return checker.read


def _print(lines: Iterator[str]) -> None:
    for line in lines:
        sys.stdout.write(f"{line}\n")


def _sum_up(checker: Checker) -> None:
    sys.stdout.write(f"\n{checker.read} of {checker.lines} lines can be read\n")
