"""When an instrument's values are of the sea: it is warm, and water flows past it."""

import math

from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.bridge.patterns import Fields, LineError, number

_STATE_AGE_S = 10.0

WARMING_UP = "warming up"
PUMP_OFF = "the pump is off"
PUMP_UNKNOWN = "nobody tells of the pump"
FLUSHING = "the hose is being flushed"


class Gate:
    """Says of each line whether its values are withheld, and why. Times are this computer's.

    What cannot be known counts as just begun: an instrument that is heard for the first time as just switched on, a
    pump that is found running as just started.
    """

    def __init__(self, configuration: BridgeConfiguration) -> None:
        self._instrument = configuration.instrument
        self._pump = configuration.pump
        self._decimal = configuration.line.decimal
        self._flush_s = configuration.flush_s
        self._heard_s = -math.inf
        self._warm_s = math.inf
        self._told_s = -math.inf
        self._runs = False
        self._flushed_s = math.inf

    def on_message(self, now: float, value: float) -> None:
        """The NAMED_VALUE_FLOAT of the pump has come."""
        if self._pump is not None and self._pump.minimum is not None:
            self._set_pump(now, runs=value >= self._pump.minimum)

    def withheld(self, now: float, fields: Fields) -> str | None:
        """Why the values of a line are not sent; None if they are.

        LineError if it should tell of the pump, and can't.
        """
        if now - self._heard_s > self._instrument.silence_s:
            self._warm_s = now + self._instrument.warm_up_s
        self._heard_s = now
        if self._pump is not None:
            if self._pump.field is not None:
                self._set_pump(now, runs=self._runs_by(fields))
            if now - self._told_s > _STATE_AGE_S:
                return PUMP_UNKNOWN
            if not self._runs:
                return PUMP_OFF
        if now < self._warm_s:
            return WARMING_UP
        if self._pump is not None and now < self._flushed_s:
            return FLUSHING
        return None

    def _runs_by(self, fields: Fields) -> bool:
        assert self._pump is not None
        assert self._pump.field is not None
        text = fields.get(self._pump.field)
        if text is None:
            raise LineError("does not tell of the pump")
        if self._pump.minimum is None:
            return text == self._pump.text
        return number(text, self._decimal) >= self._pump.minimum

    def _set_pump(self, now: float, *, runs: bool) -> None:
        # Silence of the pump's message is no proof that it ran meanwhile.
        if runs and not (self._runs and now - self._told_s <= _STATE_AGE_S):
            self._flushed_s = now + self._flush_s
        self._runs, self._told_s = runs, now
