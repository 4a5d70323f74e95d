"""Model time: the vehicle's own clock, unwrapped, and how fast it runs against ours."""

import math
from collections import deque
from enum import Enum
from statistics import median

_WRAP_MS = 2**32  # time_boot_ms is an unsigned 32-bit number: 49.7 days
_REORDERING_S = 1.0  # an older stamp than this, in protocol time, isn't a straggler
_WITNESSES = 3
_UPTIME_SLACK_S = 5.0
_FORWARD_SLACK_S = 60.0
_AHEAD_S = 1.0  # whoever stamps by the vehicle's clock knows it no better, nor do we
_OLDEST_TRANSLATED_S = 90.0
_STALE_S = 5.0  # protocol time without a stamp that fits, after which the clock itself is doubted
_SLOWEST = 0.01
_FASTEST = 1000.0  # no simulation runs faster, in model seconds per second
_YEAR_2001_USEC = 978_307_200_000_000  # a vehicle without GPS sends zero or its boot time
_YEAR_2100_USEC = 4_102_444_800_000_000
_LONGEST_ABSENCE_S = 30 * 86400.0


class ClockRate:
    """d(model time)/d(protocol time): the median of short slopes, which a stall of either side can't bend."""

    def __init__(self, window_s: float = 10.0, spacing_s: float = 0.25) -> None:
        self._window_s = window_s
        self._spacing_s = spacing_s
        self._last: tuple[float, float] | None = None
        self._slopes: deque[tuple[float, float]] = deque()
        self.value = 1.0
        self.measured = False

    def observe(self, now: float, model_time_s: float) -> None:
        """Take in that the vehicle's clock showed `model_time_s` at protocol time `now`."""
        if self._last is None:
            self._last = (now, model_time_s)
            return
        elapsed_s = now - self._last[0]
        if elapsed_s < self._spacing_s:
            return
        self._slopes.append((now, (model_time_s - self._last[1]) / elapsed_s))
        self._last = (now, model_time_s)
        # Three slopes stay however old they are: rare messages still tell the rate.
        while len(self._slopes) > 3 and self._slopes[0][0] < now - self._window_s:
            self._slopes.popleft()
        if len(self._slopes) >= 3:
            self.value = median(slope for _, slope in self._slopes)
            self.measured = True

    def interrupt(self) -> None:
        """Forget the last observation (a reboot lies between it and the next), keep the rate."""
        self._last = None

    def doubt(self) -> None:
        """Forget every observation, and what they told is a guess now."""
        self._last = None
        self._slopes.clear()
        self.measured = False


class _Doubt(Enum):
    """What a stamp that does not continue the clock may be."""

    REBOOT = "so low that the vehicle may have started again since"
    LATE = "older than the newest, and too high for a reboot"
    AHEAD = "further ahead than the clock can have run"


class _Suspects:
    """Stamps in a row that do not continue the clock, but would continue each other."""

    def __init__(self) -> None:
        self._doubt: _Doubt | None = None
        self._last_now = 0.0
        self._last_ms = 0
        self._count = 0

    def clear(self) -> None:
        """A stamp came that continues the clock."""
        self._count = 0

    def add(self, now: float, time_boot_ms: int, doubt: _Doubt) -> bool:
        """Take one in; returns whether there are enough of them to be believed."""
        limit_s = _FASTEST * (now - self._last_now) + _FORWARD_SLACK_S
        step_ms = time_boot_ms - self._last_ms
        if self._count == 0 or doubt is not self._doubt or not 0 <= step_ms <= 1000 * limit_s:
            self._count = 1
        elif step_ms > 0:  # a stamp that stands still is no clock
            self._count += 1
        self._doubt, self._last_now, self._last_ms = doubt, now, time_boot_ms
        return self._count >= _WITNESSES


class ModelClock:
    """Turns `time_boot_ms` into model time in seconds, over wraps and reboots.

    Model time equals seconds since boot until the first reboot. A stamp that is older than the newest by
    less than one second of protocol time is a straggler of a reordering link and keeps its own, older time.

    Theory of operation. Any other stamp that does not continue the clock has no time (None), moves nothing,
    and is believed only when three in a row continue each other; a stamp that fits ends the row.

        REBOOT  older than the newest, and no longer up than the vehicle can have been since then: twice the
                silence, and five seconds (times the clock's rate). Counts as a reboot.
        LATE    older, but up for longer than that: no reboot can explain it, a late packet can. Believed only
                when nothing that fits has come for five seconds: then it was the newest stamp that was wrong.
        AHEAD   further ahead than twice the silence and a minute (times the clock's rate).

    Once believed, model time goes on from the newest one plus the protocol time that passed, and jumps forward,
    by at most 30 days, once SYSTEM_TIME tells how long it really was.
    """

    def __init__(self) -> None:
        self._offset_s = 0.0
        self._newest_ms: int | None = None
        self._newest_now = 0.0
        self._suspects = _Suspects()
        self._await_utc = False
        self._wrapped = False
        self._rate = ClockRate()
        self.reboots = 0
        self.booted = -math.inf
        """Protocol time of the last of them."""
        self.breaks = 0
        """How often the clock did not go on where it was: reboots, and jumps that were none."""
        self.epoch = 0
        """Grows whenever model time is re-anchored: stamps of two epochs must not be interpolated."""
        self.utc_offset_s: float | None = None
        """UTC (Unix seconds) minus model time; None until SYSTEM_TIME carried a date."""

    @property
    def rate(self) -> float:
        """Model seconds per second of protocol time; 1.0 until measured."""
        return self._rate.value

    @property
    def model_time_s(self) -> float | None:
        """The newest model time seen."""
        return None if self._newest_ms is None else self._newest_ms / 1000 + self._offset_s

    def estimate(self, now: float) -> float | None:
        """Model time at protocol time `now`, extrapolated from the newest stamp."""
        model_time_s = self.model_time_s
        return None if model_time_s is None else model_time_s + max(0.0, now - self._newest_now) * self.rate

    def observe(self, now: float, time_boot_ms: int) -> float | None:
        """Model time of a stamp that arrived at `now`; None while it is not known what to make of it."""
        if self._newest_ms is None:
            return self._advance(now, time_boot_ms)
        step_ms = time_boot_ms - self._newest_ms
        if step_ms < 0 and self._is_wrap(now, step_ms + _WRAP_MS):
            self._offset_s += _WRAP_MS / 1000
            self._wrapped = True
            return self._advance(now, time_boot_ms)
        straggling_ms = 1000 * _REORDERING_S * max(1.0, self.rate)
        if self._wrapped and _WRAP_MS - step_ms <= straggling_ms:
            return time_boot_ms / 1000 + self._offset_s - _WRAP_MS / 1000  # a straggler from before the wrap
        doubt = self._doubt(now, time_boot_ms, step_ms, straggling_ms)
        if doubt is not None:
            return self._suspect(now, time_boot_ms, doubt)
        self._suspects.clear()
        return self._advance(now, time_boot_ms) if step_ms > 0 else time_boot_ms / 1000 + self._offset_s

    def translate(self, now: float, time_boot_ms: int) -> float | None:
        """Model time of a stamp that somebody else made by this clock, up to a minute and a half ago.

        None if it can't be one: in the future, too old, or before the vehicle's start. It moves nothing.
        """
        present_s = self.estimate(now)
        if present_s is None:
            return None
        step_ms = (time_boot_ms - round(1000 * (present_s - self._offset_s)) + _WRAP_MS // 2) % _WRAP_MS
        age_s = (_WRAP_MS // 2 - step_ms) / 1000
        scale = max(1.0, self.rate)
        in_reach = -_AHEAD_S * scale <= age_s <= _OLDEST_TRANSLATED_S * scale
        return present_s - age_s if in_reach else None

    def observe_utc(self, now: float, time_boot_ms: int, time_unix_usec: int) -> None:
        """Take in a SYSTEM_TIME message; a date before 2001 or after 2100 is none."""
        model_time_s = self.observe(now, time_boot_ms)
        if model_time_s is None or not _YEAR_2001_USEC <= time_unix_usec < _YEAR_2100_USEC:
            return
        utc_s = time_unix_usec / 1e6
        if self._await_utc and self.utc_offset_s is not None:
            missing_s = utc_s - self.utc_offset_s - model_time_s
            # A longer absence is rather a wrong date: it must not make all that was learnt look old.
            if 0 < missing_s <= _LONGEST_ABSENCE_S:
                self._offset_s += missing_s
                self.epoch += 1
                self._rate.interrupt()
                model_time_s += missing_s
        self._await_utc = False
        self.utc_offset_s = utc_s - model_time_s

    def _advance(self, now: float, time_boot_ms: int) -> float:
        self._newest_ms, self._newest_now = time_boot_ms, now
        model_time_s = time_boot_ms / 1000 + self._offset_s
        self._rate.observe(now, model_time_s)
        return model_time_s

    def _is_wrap(self, now: float, forward_ms: int) -> bool:
        expected_s = (now - self._newest_now) * self.rate
        slack_s = _FORWARD_SLACK_S * max(1.0, self.rate)
        return 0.8 * expected_s - slack_s <= forward_ms / 1000 <= 1.2 * expected_s + slack_s

    def _doubt(self, now: float, time_boot_ms: int, step_ms: int, straggling_ms: float) -> _Doubt | None:
        """What speaks against a stamp's continuing the clock, if anything does."""
        silence_s = now - self._newest_now
        if step_ms < -straggling_ms:
            longest_uptime_s = (2 * silence_s + _UPTIME_SLACK_S) * max(1.0, self.rate)
            return _Doubt.REBOOT if time_boot_ms / 1000 <= longest_uptime_s else _Doubt.LATE
        fastest = max(1.0, self.rate) if self._rate.measured else _FASTEST
        ahead = step_ms / 1000 > (2 * silence_s + _FORWARD_SLACK_S) * fastest
        return _Doubt.AHEAD if ahead else None

    def _suspect(self, now: float, time_boot_ms: int, doubt: _Doubt) -> float | None:
        believed = self._suspects.add(now, time_boot_ms, doubt)
        if not believed or (doubt is _Doubt.LATE and now - self._newest_now < _STALE_S):
            return None
        if doubt is _Doubt.REBOOT:
            self.reboots += 1
            self.booted = now - time_boot_ms / 1000 / max(_SLOWEST, self.rate)
            self._rate.interrupt()
        else:
            self._rate.doubt()  # a simulation that runs at another pace now looks like this
        return self._resume(now, time_boot_ms)

    def _resume(self, now: float, time_boot_ms: int) -> float:
        resumed_s = self.estimate(now)
        assert resumed_s is not None
        self._offset_s = resumed_s - time_boot_ms / 1000
        self._suspects.clear()
        self._wrapped = False
        self._await_utc = True
        self.breaks += 1
        self.epoch += 1
        return self._advance(now, time_boot_ms)
