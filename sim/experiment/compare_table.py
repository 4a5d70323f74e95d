"""What the voyages of a comparison come to: figures by strategy and sea, and the tables in Markdown."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from autonomy.geometry import FloatArray
from sim.experiment.cells import Result
from sim.experiment.compare_scores import kilometres_to
from sim.experiment.compare_statistics import Ratio, ratio
from sim.experiment.compare_ways import BETTER_LANES, LANES, OURS, ROWS, TITLES

GOAL = 0.5
"""Of the field's standard deviation: the error whose distance is told."""


@dataclass(frozen=True)
class Figures:
    """What one voyage came to; errors in units of the field's standard deviation.

    Attributes:
        rmse, nlpd, coverage: of the strategy's own map, at the end; over a sea that moves, root mean square and means
            over the second half of the voyage.
        to_goal: how far was sailed until the error came down to `GOAL` for good, in √(water area); infinite: never.
            NaN over a sea that moves.
        batch_rmse: of the batch process at the end, on the same readings.
        cpu_s: CPU seconds of planning and learning.
    """

    rmse: float
    nlpd: float
    coverage: float
    to_goal: float
    batch_rmse: float
    cpu_s: float


@dataclass(frozen=True)
class Run:
    """What all strategies had in common: sea, launch, seed."""

    sea: str
    launch: int
    seed: int


@dataclass(frozen=True, eq=False)
class Comparison:
    """All voyages over seas of one kind, still or moving: figures by strategy, each by run in the same order."""

    moves: bool
    sides: tuple[float, ...]
    runs: tuple[Run, ...]
    figures: dict[str, tuple[Figures, ...]]

    @property
    def seas(self) -> tuple[str, ...]:
        """In their order."""
        return tuple(dict.fromkeys(run.sea for run in self.runs))

    def of_sea(self, strategy: str, sea: str) -> list[Figures]:
        """Of one strategy all voyages on one sea."""
        return [f for run, f in zip(self.runs, self.figures[strategy], strict=True) if run.sea == sea]

    def against(self, strategy: str, figure: Callable[[Figures], float]) -> Ratio:
        """Ours over another's, run by run."""
        pairs: dict[str, list[tuple[float, float]]] = {}
        for run, ours, theirs in zip(self.runs, self.figures[OURS], self.figures[strategy], strict=True):
            pairs.setdefault(run.sea, []).append((figure(ours), figure(theirs)))
        return ratio(pairs)


def comparisons(results: Iterable[Result]) -> list[Comparison]:
    """Still seas and moving ones, of the results of whole sweeps (every strategy on every run)."""
    voyages = list(results)
    found = []
    for moves in (False, True):
        own = [each for each in voyages if each.cell.arguments["sea"]["moves"] is moves]
        if own:
            found.append(_comparison(own, moves))
    return found


def run_of(result: Result) -> Run:
    """Of one voyage."""
    told = result.cell.arguments
    return Run(told["sea"]["name"], told["launch"], told["seed"])


def _comparison(voyages: Sequence[Result], moves: bool) -> Comparison:
    runs = tuple(dict.fromkeys(run_of(each) for each in voyages))
    by_strategy: dict[str, dict[Run, Figures]] = {}
    for each in voyages:
        by_strategy.setdefault(each.cell.arguments["strategy"], {})[run_of(each)] = figures_of(each, moves)
    figures = {name: tuple(found[run] for run in runs) for name, found in by_strategy.items()}
    lanes = list(zip(*(figures.pop(name) for name in LANES), strict=True))
    figures["lawnmower"] = tuple(_mean(each) for each in lanes)
    figures[BETTER_LANES] = tuple(min(each, key=lambda f: f.rmse) for each in lanes)
    sides = {run_of(v): _number(v, "budget_m") / _number(v, "side_m") for v in voyages}
    return Comparison(moves, tuple(sides[run] for run in runs), runs, figures)


def figures_of(result: Result, moves: bool) -> Figures:
    """Of one voyage."""
    sides = _array(result, "distance_m") / _number(result, "side_m")
    to_goal = math.nan if moves else kilometres_to(GOAL, sides, _array(result, "rmse"))
    return Figures(
        rmse=_number(result, "final_rmse"),
        nlpd=_number(result, "final_nlpd"),
        coverage=_number(result, "final_coverage"),
        to_goal=to_goal,
        batch_rmse=_number(result, "batch_final_rmse"),
        cpu_s=_number(result, "cpu_s"),
    )


def _mean(several: Sequence[Figures]) -> Figures:
    return Figures(*(float(np.mean([getattr(f, n) for f in several])) for n in Figures.__dataclass_fields__))


def table(found: Sequence[Comparison]) -> str:
    """The table: one row for each strategy, still seas and moving ones; nothing in it depends on the machine's pace."""
    lines = [
        "| | RMSE | Halocline's / its RMSE (95 %) | better on | NLPD | coverage "
        f"| way to RMSE {GOAL:g} | same, one batch GP for all |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for each in found:
        lines.append(f"| **{in_words(each)}, {_lengths(each)}** | | | | | | | |")
        lines += [_row(each, name) for name in ROWS]
    return "\n".join(lines) + "\n"


def in_words(of: Comparison) -> str:
    """How many seas and voyages."""
    seas, voyages = len(of.seas), len(of.runs)
    kind = "moving" if of.moves else "still"
    return f"{seas} {kind} sea{'s' * (seas > 1)}, {voyages} voyage{'s' * (voyages > 1)} of each strategy"


def _row(of: Comparison, name: str) -> str:
    cells = [TITLES[name], _over_seas(of, name, lambda f: f.rmse)]
    if name == OURS:
        cells += ["1", "–"]
    else:
        against = of.against(name, lambda f: f.rmse)
        cells += [_interval(against), f"{against.better} of {against.voyages}"]
    cells += [
        _mean_over_seas(of, name, lambda f: f.nlpd, ".2f"),
        _mean_over_seas(of, name, lambda f: f.coverage, ".0%").replace("%", " %"),
        _way(of, name),
        "1" if name == OURS else _interval(of.against(name, lambda f: f.batch_rmse)),
    ]
    return f"| {' | '.join(cells)} |"


def table_by_sea(found: Sequence[Comparison]) -> str:
    """RMSE of every strategy on every sea: mean, and its standard deviation over the sea's voyages."""
    lines = [
        f"| RMSE | {' | '.join(TITLES[name] for name in ROWS)} |",
        f"|---{'|---' * len(ROWS)}|",
    ]
    for each in found:
        for sea in each.seas:
            cells = [_spread([f.rmse for f in each.of_sea(name, sea)]) for name in ROWS]
            best = min(range(len(ROWS)), key=lambda k: np.mean([f.rmse for f in each.of_sea(ROWS[k], sea)]))
            cells[best] = f"**{cells[best]}**"
            lines.append(f"| {sea} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def cost_table(found: Sequence[Comparison]) -> str:
    """CPU seconds of a voyage's planning and learning, mean over seas: of this machine, and of today."""
    lines = [f"| CPU seconds | {' | '.join('moving' if e.moves else 'still' for e in found)} |"]
    lines.append(f"|---{'|---' * len(found)}|")
    for name in ROWS:
        if name == BETTER_LANES:
            continue
        cells = [_mean_over_seas(each, name, lambda f: f.cpu_s, ".1f") for each in found]
        lines.append(f"| {TITLES[name]} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def sea_means(of: Comparison, name: str, figure: Callable[[Figures], float]) -> FloatArray:
    """Of each sea the mean over its voyages."""
    return np.array([np.mean([figure(f) for f in of.of_sea(name, sea)]) for sea in of.seas])


def _over_seas(of: Comparison, name: str, figure: Callable[[Figures], float]) -> str:
    return _spread(sea_means(of, name, figure).tolist())


def _mean_over_seas(of: Comparison, name: str, figure: Callable[[Figures], float], form: str) -> str:
    return format(float(np.mean(sea_means(of, name, figure))), form)


def _spread(values: Sequence[float]) -> str:
    if len(values) < 2:
        return f"{values[0]:.3f}"
    return f"{np.mean(values):.3f} ± {np.std(values, ddof=1):.3f}"


def _interval(found: Ratio) -> str:
    if math.isnan(found.low):
        return f"{found.mean:.3f}"
    return f"{found.mean:.3f} ({found.low:.2f}–{found.high:.2f})"


def _way(of: Comparison, name: str) -> str:
    if of.moves:
        return "–"
    ways = [f.to_goal for f in of.figures[name]]
    reached = sum(math.isfinite(way) for way in ways)
    middle = float(np.median(ways))
    said = f"{middle:.1f}" if math.isfinite(middle) else f"> {np.median(of.sides):.1f}"
    return f"{said} ({reached} of {len(ways)})"


def _lengths(of: Comparison) -> str:
    low, high = min(of.sides), max(of.sides)
    return f"{low:.3g} √area" if high - low < 0.01 * high else f"{low:.3g} to {high:.3g} √area"


def _array(result: Result, name: str) -> FloatArray:
    return np.asarray(result.values[name], dtype=float)


def _number(result: Result, name: str) -> float:
    value = result.values[name]
    assert isinstance(value, int | float)
    return float(value)
