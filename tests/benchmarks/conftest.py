"""What the benchmarks share: one clock, one table at the end, and the same in JSON. They report; no time fails them.

The clock is this process's CPU time, so that others on the machine count little. Every row is a ratio: the reference
is measured in the same run, in turns with the work, and the best of several rounds counts for both.
"""

import json
import timeit
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from time import process_time
from typing import Any

import numpy as np
import pytest

from sim.experiment.sweep_provenance import commit, machine

Work = Callable[[], Any]
Seconds = Callable[..., float]
Report = Callable[..., None]
Against = Callable[..., float]
Growth = Callable[..., None]

_ROUND_S = 5e-3


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    group: str
    name: str
    seconds: float
    reference: str
    reference_seconds: float
    note: str

    @property
    def ratio(self) -> float:
        return self.seconds / self.reference_seconds


@dataclass(frozen=True)
class Exponent:
    """How work grows: its seconds go with `parameter` to the power of `exponent`, fitted over `sizes`."""

    name: str
    parameter: str
    sizes: tuple[float, ...]
    seconds: tuple[float, ...]
    exponent: float
    reference: str
    reference_exponent: float


ROWS = pytest.StashKey[list[Row]]()
EXPONENTS = pytest.StashKey[list[Exponent]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ROWS], config.stash[EXPONENTS] = [], []


def _best_of(function: Work, repeat: int = 5, number: int = 1) -> float:
    return min(timeit.repeat(function, timer=process_time, number=number, repeat=repeat)) / number


def _number(function: Work) -> int:
    """How many calls make a round long enough for the clock."""
    return max(1, int(_ROUND_S / max(_best_of(function, 1), 1e-7)))


def _in_turns(works: Sequence[Work], rounds: int) -> list[float]:
    """The best of each, so measured that all see the machine alike."""
    numbers = [_number(work) for work in works]
    best = [np.inf] * len(works)
    for _ in range(rounds):
        for i, (work, number) in enumerate(zip(works, numbers, strict=True)):
            best[i] = min(best[i], _best_of(work, 1, number))
    return best


@pytest.fixture
def seconds() -> Seconds:
    """`seconds(function, repeat, number)`: CPU seconds of one call, the best of several."""
    return _best_of


@pytest.fixture
def report(request: pytest.FixtureRequest) -> Report:
    """`report(name, spent_s, reference, reference_s, note)`: a row of the table, under the module's title."""
    title = request.module.__doc__.partition(":")[0].strip(" .")
    rows = request.config.stash[ROWS]

    def say(name: str, spent_s: float, reference: str, reference_s: float, note: str = "") -> None:
        rows.append(Row(title, name, spent_s, reference, reference_s, note))

    return say


@pytest.fixture
def against(benchmark: Any, report: Report) -> Against:
    """`against(name, work, reference, reference_work, rounds, note)`: the test's one row; seconds of the work.

    Both are called in turns by pytest-benchmark, whose own figures are in the JSON too.
    """

    def measure(
        name: str, work: Work, reference: str, reference_work: Work, rounds: int = 7, note: str = ""
    ) -> float:
        number, reference_number = _number(work), _number(reference_work)
        reference_s: list[float] = []
        benchmark.pedantic(
            lambda: [work() for _ in range(number)],
            setup=lambda: reference_s.append(_best_of(reference_work, 1, reference_number)),
            rounds=rounds,
        )
        spent_s: float = benchmark.stats.stats.min / number
        benchmark.extra_info.update(
            calls_in_a_round=number, reference=reference, reference_s=min(reference_s)
        )
        report(name, spent_s, reference, min(reference_s), note)
        return spent_s

    return measure


@pytest.fixture
def exponent(request: pytest.FixtureRequest) -> Growth:
    """`exponent(name, parameter, sizes, spent_s, reference, reference_s)`: fitted over sizes measured otherwise."""

    def fitted(
        name: str,
        parameter: str,
        sizes: Sequence[float],
        spent_s: Sequence[float],
        reference: str,
        reference_s: Sequence[float],
    ) -> None:
        both = np.log([spent_s, reference_s]).T
        slope, reference_slope = (float(one) for one in np.polyfit(np.log(sizes), both, 1)[0])
        found = Exponent(name, parameter, tuple(sizes), tuple(spent_s), slope, reference, reference_slope)
        request.config.stash[EXPONENTS].append(found)

    return fitted


@pytest.fixture
def growth(exponent: Growth) -> Growth:
    """`growth(name, parameter, sizes, work_of, reference, reference_of, rounds)`: exponents fitted over the sizes.

    `work_of(size)` and `reference_of(size)` make what is to be called.
    """

    def measure(
        name: str,
        parameter: str,
        sizes: Sequence[float],
        work_of: Callable[[Any], Work],
        reference: str,
        reference_of: Callable[[Any], Work],
        rounds: int = 3,
    ) -> None:
        spent = [_in_turns((work_of(size), reference_of(size)), rounds) for size in sizes]
        ours, plain = zip(*spent, strict=True)
        exponent(name, parameter, sizes, ours, reference, plain)

    return measure


def _told(spent_s: float) -> str:
    if spent_s >= 1000.0:
        return f"{spent_s:.0f} s"
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if spent_s >= size:
            return f"{spent_s / size:.3g} {unit}"
    return f"{spent_s / 1e-6:.3g} µs"


def _ratio(ratio: float) -> str:
    return f"1/{_ratio(1.0 / ratio)}" if ratio < 0.01 else f"{float(f'{ratio:.3g}'):g}"


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> Iterator[str]:
    """Markdown that is a table in a terminal too."""
    widths = [max(map(len, column)) for column in zip(head, *lines, strict=True)]
    for line in (head, ["-" * width for width in widths], *lines):
        yield "| " + " | ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)) + " |"


def _where() -> str:
    found, here = commit(), machine()
    changed = " with changes" if found.get("git_dirty") else ""
    return (
        f"commit {str(found.get('git_commit', 'unknown'))[:10]}{changed}; {here['cpu']}; {here['packages']}"
    )


def _lines(rows: Sequence[Row], exponents: Sequence[Exponent]) -> Iterator[str]:
    yield f"CPU time, the best of several rounds, BLAS on one thread; {_where()}"
    for title, group in groupby(rows, key=lambda row: row.group):
        cells = [
            (
                row.name + (f" ({row.note})" if row.note else ""),
                _told(row.seconds),
                f"{row.reference}, {_told(row.reference_seconds)}",
                _ratio(row.ratio),
            )
            for row in group
        ]
        yield from ("", f"{title}:", "", *_table(("what", "time", "reference", "ratio"), cells))
    cells = [
        (
            one.name,
            one.parameter,
            ", ".join(f"{size:g}" for size in one.sizes),
            f"{one.exponent:.2f}",
            f"{one.reference}: {one.reference_exponent:.2f}",
        )
        for one in exponents
    ]
    if cells:
        head = ("what", "grows with", "over", "exponent", "reference")
        yield from ("", "Growth, the exponent fitted over the sizes:", "", *_table(head, cells))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """The whole table, when all is measured."""
    rows, exponents = config.stash[ROWS], config.stash[EXPONENTS]
    if rows or exponents:
        terminalreporter.write_line("")
        for line in _lines(rows, exponents):
            terminalreporter.write_line(line)


def pytest_benchmark_update_json(config: pytest.Config, benchmarks: Any, output_json: dict[str, Any]) -> None:
    """The table beside pytest-benchmark's own figures in the file that `--benchmark-json` names."""
    output_json["halocline"] = machine() | commit()
    output_json["rows"] = [asdict(row) | {"ratio": row.ratio} for row in config.stash[ROWS]]
    output_json["growth"] = json.loads(json.dumps([asdict(one) for one in config.stash[EXPONENTS]]))
