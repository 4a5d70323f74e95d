"""The vehicle's clock as this computer's clock tells it: so that a reading can be stamped by it."""

from autonomy.mavlink.clock import ModelClock

_SILENCE_S = 5.0
_CRYSTAL, _TELLING_S = 0.05, 5.0
"""A clock that has run off ours by no more than this share, over so long at least, is a crystal's; else a simulation's,
whose pace is measured."""

_CRYSTALS_DRIFT, _SIMULATIONS_DRIFT = 2e-4, 0.05
"""Seconds a second by which the two clocks may drift apart; the quartzes of autopilots do by a tenth of it."""

_WRAP_MS = 2**32


class VehicleClock:
    """Learns from stamped messages what `time_boot_ms` the vehicle's clock shows at any time of ours.

    A message arrives late, never early. So the clock is known best from the one that came quickest: the estimate goes
    up to whatever stamp is ahead of it, and sinks so slowly that only a drift of the two clocks is followed. That is
    a minimum-delay filter without a window; its error is the delay of the quickest message plus 0.2 ms for each second
    since it came. Reboots, wraps and stragglers are `ModelClock`'s business: a reboot begins the estimate anew.

    Times are this computer's, in seconds, of a clock that only goes forward.
    """

    def __init__(self) -> None:
        self._clock = ModelClock()
        self._breaks = 0
        self._heard_s: float | None = None
        self._begun = (0.0, 0.0)
        self._at_s = 0.0
        self._model_s = 0.0
        self._boot_s = 0.0

    @property
    def reboots(self) -> int:
        """How often the vehicle's clock started again."""
        return self._clock.reboots

    def is_known(self, now: float) -> bool:
        """Whether the vehicle has told its time within the last seconds."""
        return self._heard_s is not None and now - self._heard_s <= _SILENCE_S

    def forget(self) -> None:
        """The link is gone: nothing is known of the vehicle's clock before it is heard again."""
        self._heard_s = None

    def observe(self, now: float, time_boot_ms: int) -> None:
        """A message of the vehicle, stamped so, has arrived."""
        model_s = self._clock.observe(now, time_boot_ms)
        if model_s is None:
            return
        anew = self._heard_s is None or self._clock.breaks != self._breaks
        if anew:
            self._begun = (now, model_s)
        sunk_s = -float("inf") if anew else self._at(now) - self._drift * (now - self._at_s)
        self._at_s, self._model_s = now, max(sunk_s, model_s)
        self._heard_s, self._breaks = now, self._clock.breaks
        if model_s == self._clock.model_time_s:  # no straggler, which may be from before a wrap
            self._boot_s = model_s - time_boot_ms / 1000

    def stamp(self, now: float, at_s: float) -> int | None:
        """What the vehicle's clock showed at `at_s`, in milliseconds; None if it is not known, or had not started."""
        if not self.is_known(now):
            return None
        stamp_ms = round(1000 * (self._at(at_s) - self._boot_s))
        return stamp_ms % _WRAP_MS if stamp_ms > 0 else None

    @property
    def _pace(self) -> float:
        passed_s, model_s = self._at_s - self._begun[0], self._model_s - self._begun[1]
        is_crystal = passed_s < _TELLING_S or abs(model_s - passed_s) <= _CRYSTAL * passed_s
        return 1.0 if is_crystal else self._clock.rate

    @property
    def _drift(self) -> float:
        return _CRYSTALS_DRIFT if self._pace == 1.0 else _SIMULATIONS_DRIFT * self._pace

    def _at(self, time_s: float) -> float:
        return self._model_s + self._pace * (time_s - self._at_s)
