"""Kernels in words."""

import math

import pytest

from autonomy.learning.description import describe, duration, length
from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static, TemporalKernel


def rough(scale: float, time: TemporalKernel | None = None) -> Component:
    return Component(1.0, Matern32((scale, scale)), time or Static())


def smooth(x: float, y: float, time: TemporalKernel | None = None) -> Component:
    return Component(1.0, SquaredExponential((x, y)), time or Static())


HOURS = OrnsteinUhlenbeck(6.1 * 3600)


@pytest.mark.parametrize(
    ("components", "words"),
    [
        ((smooth(3100, 3100),), "smooth 3.1 km"),
        ((smooth(3100, 900),), "smooth 3.1 km x 900 m"),
        ((rough(900), smooth(5200, 5200)), "smooth 5.2 km + rough 900 m"),
        ((rough(900, HOURS), smooth(5200, 5200, HOURS)), "smooth 5.2 km + rough 900 m; time-scale 6.1 h"),
        ((rough(5200), rough(1800, HOURS)), "rough 5.2 km (still) + rough 1.8 km (time-scale 6.1 h)"),
        ((rough(800, MaternMotion(1200)),), "rough 800 m; steady motion, time-scale 20 min"),
    ],
)
def test_a_kernel_in_words(components: tuple[Component, ...], words: str) -> None:
    assert describe(Kernel(components, 0.1)) == words


def test_the_papers_kernel_in_words() -> None:
    assert describe(Hyperparameters(1.0, 0.1, (1500.0, 1500.0), math.inf).kernel) == "smooth 1.5 km"


@pytest.mark.parametrize(
    ("metres", "words"),
    [(0.25, "0.25 m"), (12.34, "12 m"), (994, "990 m"), (996, "1 km"), (5230, "5.2 km"), (1.26e6, "1300 km")],
)
def test_lengths(metres: float, words: str) -> None:
    assert length(metres) == words


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.5, "0.5 s"), (45, "45 s"), (1200, "20 min"), (21_960, "6.1 h"), (276_480, "3.2 d"), (1e8, "1200 d")],
)
def test_durations(seconds: float, words: str) -> None:
    assert duration(seconds) == words
