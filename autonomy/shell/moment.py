"""A time that can be compared across boots of the machine."""

import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_LONGEST_AWAY_S = 30 * 86400.0


@dataclass(frozen=True)
class Moment:
    """A time by protocol clock and wall clock, and the boot of the machine in which the former was."""

    now: float
    utc_s: float
    boot: str

    @staticmethod
    def present() -> "Moment":
        """This moment."""
        return Moment(time.monotonic(), time.time(), _boot())

    def since(self, earlier: "Moment") -> float:
        """Seconds since an earlier moment: by the protocol clock if it ran on, else by the wall clock, at least 0."""
        same = self.boot == earlier.boot and self.boot != "" and self.now >= earlier.now
        passed_s = self.now - earlier.now if same else self.utc_s - earlier.utc_s
        return min(max(0.0, passed_s), _LONGEST_AWAY_S)


@cache
def _boot() -> str:
    """What the kernel calls this boot, empty if it does not say. It does not change, and the loop asks at each plan."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except FileNotFoundError:
        return ""
