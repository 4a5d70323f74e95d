"""What the benchmarks share: the clock, and one line a row. They report; they never fail on a time."""

import timeit
from collections.abc import Callable
from typing import Any

import pytest

Seconds = Callable[..., float]
Report = Callable[..., None]


def _best_of(function: Callable[[], Any], repeat: int = 5, number: int = 1) -> float:
    return min(timeit.repeat(function, number=number, repeat=repeat)) / number


def _told(spent_s: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if spent_s >= size:
            return f"{spent_s / size:.3g} {unit}"
    return f"{spent_s / 1e-6:.3g} µs"


@pytest.fixture
def seconds() -> Seconds:
    """`seconds(function, repeat, number)`: the best of several runs, what it takes when nobody else wants the core."""
    return _best_of


@pytest.fixture
def report(capsys: pytest.CaptureFixture[str]) -> Report:
    """`report(what, spent_s, reference, reference_s, note)`: one line, printed whatever pytest captures."""

    def say(what: str, spent_s: float, reference: str, reference_s: float, note: str = "") -> None:
        ratio = spent_s / reference_s
        share = f"{ratio:.3g} ×" if ratio >= 0.1 else f"1/{1.0 / ratio:.0f} of"
        line = f"{what:44} {_told(spent_s):>8} = {share} {reference} ({_told(reference_s)})"
        with capsys.disabled():
            print(f"\n  {line}{'; ' if note else ''}{note}", end="", flush=True)

    return say
