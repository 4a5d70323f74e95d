"""A kernel in a few words, for the log and for people ashore: "smooth 5.2 km + rough 900 m; time-scale 6.1 h"."""

import math

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.temporal import TemporalKernel

_SMOOTHNESS = {"squared_exponential": "smooth", "matern32": "rough"}
_MOTION = {"ornstein_uhlenbeck": "time-scale", "matern32_motion": "steady motion, time-scale"}
_SECONDS = {"d": 86_400.0, "h": 3600.0, "min": 60.0, "s": 1.0}


def describe(kernel: Kernel) -> str:
    """The components by how smooth and how long they are, the longest first, and how long the field remembers.

    A time-scale that all share stands at the end, otherwise each component says its own.
    """
    parts = sorted(kernel.components, key=lambda component: -_size(component))
    times = {component.time for component in parts}
    if len(times) > 1:
        return " + ".join(f"{_extent(part)} ({_motion(part.time) or 'still'})" for part in parts)
    motion = _motion(parts[0].time)
    return " + ".join(map(_extent, parts)) + (f"; {motion}" if motion else "")


def length(metres: float) -> str:
    """Two or three digits and a unit: 900 m, 5.2 km, 31 km."""
    rounded = float(f"{metres:.2g}")
    return f"{rounded:g} m" if rounded < 1000.0 else f"{_plain(rounded / 1000.0)} km"


def duration(seconds: float) -> str:
    """Two digits and a unit: 45 s, 20 min, 6.1 h, 3.2 d."""
    unit = next((unit for unit, size in _SECONDS.items() if seconds >= 1.5 * size), "s")
    return f"{_plain(float(f'{seconds / _SECONDS[unit]:.2g}'))} {unit}"


def _plain(number: float) -> str:
    return f"{number:.0f}" if number >= 100.0 else f"{number:g}"


def _size(component: Component) -> float:
    return math.prod(component.space.lengthscales_m)


def _extent(component: Component) -> str:
    name = component.space.name
    smoothness = _SMOOTHNESS.get(name, name.replace("_", " "))
    scales = component.space.lengthscales_m
    # One number where all axes are alike.
    told = scales[:1] if max(scales) < 1.005 * min(scales) else scales
    return f"{smoothness} {' x '.join(map(length, told))}"


def _motion(time: TemporalKernel) -> str:
    if math.isinf(time.timescale_s):
        return ""
    return f"{_MOTION.get(time.name, time.name.replace('_', ' '))} {duration(time.timescale_s)}"
