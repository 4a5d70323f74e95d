"""Model time: the vehicle's own clock, unwrapped, and how fast it runs against ours."""

from collections import deque
from statistics import median

_WRAP_MS = 2**32  # time_boot_ms is an unsigned 32-bit number: 49.7 days
_REORDERING_S = 1.0  # an older stamp than this, in protocol time, isn't a straggler
_REBOOT_WITNESSES = 3
_WRAP_SLACK_S = 60.0
_YEAR_2001_USEC = 978_307_200_000_000  # a vehicle without GPS sends zero or its boot time


class ClockRate:
    """d(model time)/d(protocol time): the median of short slopes, which a stall of either side can't bend."""

    def __init__(self, window_s: float = 10.0, spacing_s: float = 0.25) -> None:
        self._window_s = window_s
        self._spacing_s = spacing_s
        self._last: tuple[float, float] | None = None
        self._slopes: deque[tuple[float, float]] = deque()
        self.value = 1.0

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

    def interrupt(self) -> None:
        """Forget the last observation (a reboot lies between it and the next), keep the rate."""
        self._last = None


class ModelClock:
    """Turns `time_boot_ms` into model time in seconds, over wraps and reboots.

    Model time equals seconds since boot until the first reboot. A stamp that is older than the newest by
    less than one second of protocol time is a straggler of a reordering link and keeps its own, older time.
    Older stamps are believed to be a reboot when three come in a row; then model time goes on from the last
    one plus the protocol time that passed, and jumps forward once SYSTEM_TIME tells how long the boot took.
    """

    def __init__(self) -> None:
        self._offset_s = 0.0
        self._newest_ms: int | None = None
        self._newest_now = 0.0
        self._suspicions = 0
        self._await_utc = False
        self._wrapped = False
        self._rate = ClockRate()
        self.reboots = 0
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
        """Model time of a stamp that arrived at `now`; None while a reboot is suspected but not certain."""
        if self._newest_ms is None:
            return self._advance(now, time_boot_ms)
        step_ms = time_boot_ms - self._newest_ms
        if step_ms < 0 and self._is_wrap(now, step_ms + _WRAP_MS):
            self._offset_s += _WRAP_MS / 1000
            self._wrapped = True
            return self._advance(now, time_boot_ms)
        if self._wrapped and step_ms > _WRAP_MS // 2:
            return time_boot_ms / 1000 + self._offset_s - _WRAP_MS / 1000  # a straggler from before the wrap
        if step_ms < -1000 * _REORDERING_S * max(1.0, self.rate):
            self._suspicions += 1
            return self._reboot(now, time_boot_ms) if self._suspicions >= _REBOOT_WITNESSES else None
        self._suspicions = 0
        return self._advance(now, time_boot_ms) if step_ms > 0 else time_boot_ms / 1000 + self._offset_s

    def observe_utc(self, now: float, time_boot_ms: int, time_unix_usec: int) -> None:
        """Take in a SYSTEM_TIME message."""
        model_time_s = self.observe(now, time_boot_ms)
        if model_time_s is None or time_unix_usec < _YEAR_2001_USEC:
            return
        utc_s = time_unix_usec / 1e6
        if self._await_utc and self.utc_offset_s is not None:
            missing_s = utc_s - self.utc_offset_s - model_time_s
            if missing_s > 0:
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
        return forward_ms <= 1000 * (2 * expected_s + _WRAP_SLACK_S * max(1.0, self.rate))

    def _reboot(self, now: float, time_boot_ms: int) -> float:
        resumed_s = self.estimate(now)
        assert resumed_s is not None
        self._offset_s = resumed_s - time_boot_ms / 1000
        self._suspicions = 0
        self._wrapped = False
        self._await_utc = True
        self._rate.interrupt()
        self.reboots += 1
        self.epoch += 1
        return self._advance(now, time_boot_ms)
