"""How many basis vectors a field wants, and how many a machine can carry.

A basis has to resolve the shortest length-scale of its kernel. A smooth kernel wants three basis vectors per
patch of lx·ly: with two it replaces some for ever, and after 20 000 readings its error was up to twice as large.
A Matérn-3/2 kernel, whose samples are rough at every scale, gains up to seven. More bring nothing.

The state of the filter has D = m · states coordinates. It holds `_STATE_COPIES` matrices of 8·D² bytes (S
and what a replacement works in) and, for each group of components that move alike, `_FACTOR_COPIES` of
8·m² (L, its inverse while it is needed, and what a replacement works in). A reading that replaces a basis
vector costs a few passes over S: see `replacement_us`.
"""

import math
from dataclasses import dataclass

from autonomy.config import LARGEST_CAPACITY, LEAST_CHOSEN_CAPACITY
from autonomy.learning.kernel import Kernel

FEWEST = LEAST_CHOSEN_CAPACITY
"""Fewer are never chosen: a survey shorter than its length-scales still has a trend and a boundary."""

MOST = LARGEST_CAPACITY
"""More are never chosen: the exact process is within some percent."""

_FIXED_US, _US_PER_ENTRY = 80.0, 0.01
_PER_PATCH = {"squared_exponential": 3.0, "matern32": 7.0}
# However long the length-scale of a rough kernel, its basis has to follow the track: with 50 vectors under a long
# Matérn-3/2 the RMSE of two real surveys was 2.0 and 2.2 times that of the exact process of the same kernel.
_AT_LEAST = {"squared_exponential": FEWEST, "matern32": 200}
_STATE_COPIES, _FACTOR_COPIES = 4, 5


@dataclass(frozen=True)
class Budget:
    """What the model may use: `memory_mb` for its state, `update_us` for the slowest kind of reading."""

    memory_mb: float = 64.0
    update_us: float = 4000.0

    def __post_init__(self) -> None:
        for name in ("memory_mb", "update_us"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite, not {value!r}")


def choose_capacity(kernel: Kernel, area_m2: float, budget: Budget, most: int = MOST) -> int:
    """Basis vectors for `area_m2` of water: what `kernel` wants, as far as `budget` allows.

    Never below `FEWEST`, whatever the budget, and never above `most`. ValueError for an area that is not
    positive and finite.
    """
    if not (math.isfinite(area_m2) and area_m2 > 0):
        raise ValueError(f"area_m2 must be positive and finite, not {area_m2!r}")
    wanted = max(
        max(
            _AT_LEAST[component.space.name],
            _PER_PATCH[component.space.name] * area_m2 / math.prod(component.space.lengthscales_m),
        )
        for component in kernel.components
    )
    allowed = min(affordable(kernel, budget), most)
    return max(FEWEST, math.ceil(min(wanted, allowed)))


def affordable(kernel: Kernel, budget: Budget) -> int:
    """The largest capacity whose state fits the memory and whose updates fit the time."""
    by_memory = math.sqrt(budget.memory_mb * 1e6 / state_bytes(kernel, 1))
    by_time = math.sqrt(max(budget.update_us - _FIXED_US, 0.0) / _US_PER_ENTRY) / kernel.states
    return math.floor(min(by_memory, by_time))


def replacement_us(size: int) -> float:
    """What a reading that replaces a basis vector may cost a model of `size` coordinates D, in microseconds.

    An upper estimate, for one core of 2020: compiled, 0.7 to 4 ms at D = 600, of which this says 3.7.
    """
    return _FIXED_US + _US_PER_ENTRY * size**2


def state_bytes(kernel: Kernel, capacity: int) -> float:
    """What a full model of this `capacity` holds in memory, by the model above."""
    return 8.0 * capacity**2 * (_STATE_COPIES * kernel.states**2 + _FACTOR_COPIES * len(kernel.groups))
