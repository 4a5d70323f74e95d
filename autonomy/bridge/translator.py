"""A line of an instrument as readings, each with the time at which its water was taken in. Pure."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.bridge.gate import Gate
from autonomy.bridge.lag import Correction, Sharpen, Shift, Timed
from autonomy.bridge.patterns import LARGEST, TOO_LARGE, Fields, LineError, OtherSentenceError, number
from autonomy.bridge.sections import ValueSection

_LEAST_STEP_S = 1e-3


@dataclass(frozen=True)
class Translation:
    """What became of a line.

    Attributes:
        values: what is to be sent, by name.
        numbers: what the line says, scaled, by name; empty if it could not be read.
        unreadable: why it could not be read; empty if it could.
        withheld: why its values are not sent; empty if they are.
    """

    values: Mapping[str, Timed]
    numbers: Mapping[str, float]
    unreadable: str = ""
    withheld: str = ""


class Translator:
    """Reads lines, withholds what is not of the sea, corrects for hose and response. Times are this computer's."""

    def __init__(self, configuration: BridgeConfiguration) -> None:
        self._values = configuration.values
        self._decimal = configuration.line.decimal
        self._reader = configuration.line.reader()
        self.gate = Gate(configuration)
        self._corrections = {name: correction(value) for name, value in self._values.items()}
        self._last_s = float("-inf")
        self.read = 0
        """Lines with values, sent or withheld."""
        self.unreadable: Counter[str] = Counter()
        """Lines that could not be read, by reason."""
        self.withheld: Counter[str] = Counter()
        """Lines whose values were not sent, by reason."""

    def take(self, now: float, line: str) -> Translation:
        """Translate a line that came at `now`; of several that came at once each counts as later than the last."""
        now = max(now, self._last_s + _LEAST_STEP_S)
        try:
            fields = self._reader.read(line)
            numbers = {name: self._number(value, fields) for name, value in self._values.items()}
            withheld = self.gate.withheld(now, fields)
        except OtherSentenceError:
            return Translation({}, {})
        except LineError as error:
            self.unreadable[str(error)] += 1
            return Translation({}, {}, unreadable=str(error))
        self._last_s = now  # garbage must not make what comes after it later than it is
        self.read += 1
        if withheld is not None:
            self.withheld[withheld] += 1
            for each in self._corrections.values():
                each.restart()
            return Translation({}, numbers, withheld=withheld)
        timed = {name: self._corrections[name].add(now, value) for name, value in numbers.items()}
        # What is sharpened may come out larger than what went in.
        sound = {
            name: each for name, each in timed.items() if each is not None and abs(each.value) <= LARGEST
        }
        return Translation(sound, numbers)

    def _number(self, value: ValueSection, fields: Fields) -> float:
        text = fields.get(value.field)
        if text is None:
            raise LineError(f"has no field {value.field}")
        scaled = value.scale * number(text, self._decimal) + value.offset
        if not abs(scaled) <= LARGEST:
            raise LineError(TOO_LARGE)
        return scaled


def correction(value: ValueSection) -> Correction:
    """What undoes a value's delay and response."""
    if value.response == "sharpen":
        window_s = value.response_s if value.window_s is None else value.window_s
        return Sharpen(value.delay_s, value.response_s, window_s)
    return Shift(value.lag_s)
