"""Pictures of a comparison: ratios with their intervals, errors along the way, and maps with tracks."""

import io
import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from autonomy.geometry import FloatArray
from sim.experiment.cells import Result
from sim.experiment.compare_table import Comparison, in_words, run_of
from sim.experiment.compare_ways import BETTER_LANES, COLOURS, LANES, OURS, ROWS, TITLES
from sim.plots import INK, LAND, VALUES_MAP

_DPI = 90
_GRID = "#dddddd"
_ROW_IN = 0.5
_BELOW = 0.28
"""Of a row: how far the points of single seas are below their mean, lest its interval hides them."""

Picture = tuple[bytes, str]
"""A PNG, and what it shows in words."""


def pictures(results: Sequence[Result], found: Sequence[Comparison]) -> dict[str, Picture]:
    """All of them, by file name."""
    drawn = {"ratios": ratios(found), "courses": courses(results, found)}
    for each in found:
        for sea in each.seas:
            drawn[f"map-{_slug(sea)}"] = maps(results, sea)
    return drawn


def ratios(found: Sequence[Comparison]) -> Picture:
    """Ours over each other's RMSE: a point for each sea, the mean over seas, its interval."""
    rows = [name for name in ROWS if name != OURS]
    figure = _figure(5.4 * len(found) + 1.6, _ROW_IN * len(rows) + 1.5)
    panels: Any = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for axis, each in zip(panels, found, strict=True):
        _ratios_of(axis, each, rows)
    panels[0].set_yticks(range(len(rows)), [_plain(name) for name in rows])
    panels[0].invert_yaxis()
    said = (
        "Error of Halocline's map over that of each other strategy, a small dot for each sea, a large one for their "
        "geometric mean with its 95 % confidence interval over seas; left of 1 Halocline is better."
    )
    return _png(figure), said


def _ratios_of(axis: Axes, each: Comparison, rows: Sequence[str]) -> None:
    for k, name in enumerate(rows):
        whole = each.against(name, lambda f: f.rmse)
        seas = [
            np.exp(
                np.mean(
                    [
                        math.log(ours.rmse / theirs.rmse)
                        for ours, theirs in zip(each.of_sea(OURS, sea), each.of_sea(name, sea), strict=True)
                    ]
                )
            )
            for sea in each.seas
        ]
        axis.scatter(
            seas, np.full(len(seas), k + _BELOW), s=16, color=COLOURS[name], alpha=0.55, linewidths=0
        )
        if not math.isnan(whole.low):
            axis.plot(
                [whole.low, whole.high], [k, k], color=COLOURS[name], linewidth=2.4, solid_capstyle="butt"
            )
        axis.scatter(
            [whole.mean], [k], s=62, color=COLOURS[name], edgecolors="white", linewidths=1.0, zorder=3
        )
    axis.axvline(1.0, color=INK, linewidth=1.0)
    axis.set_xscale("log")
    low, high = axis.get_xlim()
    # An interval over two or three seas may span decades: it goes on beyond the picture.
    axis.set_xlim(max(low, 0.2), min(high, 5.0))
    ticks = [t for t in (0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.6, 2.0, 3.0, 5.0) if low <= t <= high]
    axis.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axis.minorticks_off()
    axis.set_xlabel("Halocline's RMSE / its RMSE")
    axis.set_title(in_words(each), fontsize=11)
    _tidy(axis, "x")


def courses(results: Sequence[Result], found: Sequence[Comparison]) -> Picture:
    """RMSE along the way, one panel for each sea; the mean over its voyages, lawnmowers of both directions together."""
    seas = [sea for each in found for sea in each.seas]
    columns = min(4, len(seas))
    rows = -(-len(seas) // columns)
    figure = _figure(3.7 * columns, 2.6 * rows + 0.9)
    panels: Any = figure.subplots(rows, columns, squeeze=False)
    for axis in panels.flat[len(seas) :]:
        axis.axis("off")
    for axis, sea in zip(panels.flat, seas, strict=False):
        for name in (*[row for row in ROWS if row not in (OURS, BETTER_LANES)], OURS):
            own = [
                r for r in results if run_of(r).sea == sea and r.cell.arguments["strategy"] in _sailed(name)
            ]
            sides, error = _mean_course(own)
            axis.plot(
                sides,
                error,
                color=COLOURS[name],
                linewidth=2.2 if name == OURS else 1.3,
                label=_plain(name),
            )
        axis.set_title(sea, fontsize=10)
        axis.set_ylim(0.0, 1.6)
        axis.set_xlim(0.0, None)
        _tidy(axis, "both")
    for axis in panels[-1]:
        axis.set_xlabel("sailed (√area)")
    for axis in panels[:, 0]:
        axis.set_ylabel("RMSE / field's std")
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=min(len(labels), 2 * columns),
        frameon=False,
        fontsize=9,
    )
    said = (
        "Error of each strategy's own map along the way, as a share of the field's standard deviation, mean over "
        "the voyages of each sea."
    )
    return _png(figure), said


def _sailed(name: str) -> tuple[str, ...]:
    return LANES if name == "lawnmower" else (name,)


def _mean_course(voyages: Sequence[Result]) -> tuple[FloatArray, FloatArray]:
    """Mean error at equal shares of the way, from where all voyages have a map."""
    courses_m = [np.asarray(each.values["distance_m"]) for each in voyages]
    errors = [np.asarray(each.values["rmse"]) for each in voyages]
    first = max(float(c[0]) for c in courses_m)
    last = min(float(c[-1]) for c in courses_m)
    along_m = np.linspace(first, last, 100)
    mean = np.mean([np.interp(along_m, c, e) for c, e in zip(courses_m, errors, strict=True)], axis=0)
    return along_m / float(np.asarray(voyages[0].values["side_m"])), mean


def maps(results: Sequence[Result], sea: str) -> Picture:
    """Of a sea's first launch and seed: the truth, and the maps and tracks of ours and of the better lawnmower."""
    own = {r.cell.arguments["strategy"]: r for r in results if run_of(r) == run_of(_first(results, sea))}
    better = min(LANES, key=lambda name: float(np.asarray(own[name].values["final_rmse"])))
    ours, lanes = own[OURS], own[better]
    x_km, y_km = (np.asarray(ours.values[f"{axis}_axis_m"]) / 1000.0 for axis in "xy")
    height = 4.0 * float(np.clip(np.ptp(y_km) / np.ptp(x_km), 0.4, 1.6))
    figure = _figure(13.0, height + 1.4)
    panels: Any = figure.subplots(1, 3, sharex=True, sharey=True)
    truth = np.asarray(ours.values["truth"])
    low, high = np.nanpercentile(truth, [0.5, 99.5])
    shown = [
        ("truth", truth, None),
        (f"Halocline: RMSE {_final(ours):.2f}", np.asarray(ours.values["mean"]), ours),
        (f"lawnmower, better direction: RMSE {_final(lanes):.2f}", np.asarray(lanes.values["mean"]), lanes),
    ]
    for axis, (title, values, sailed) in zip(panels, shown, strict=True):
        axis.set_facecolor(LAND)
        axis.pcolormesh(
            x_km, y_km, values, cmap=VALUES_MAP, vmin=low, vmax=high, shading="nearest", rasterized=True
        )
        if sailed is not None:
            axis.plot(*(np.asarray(sailed.values["track_m"]).T / 1000.0), color="white", linewidth=1.0)
            axis.plot(*(np.asarray(sailed.values["launch_m"]) / 1000.0), "o", color="white", markersize=5)
        axis.set_aspect("equal")
        axis.set_title(title, fontsize=11)
        axis.set_xlabel("east (km)")
    panels[0].set_ylabel("north (km)")
    figure.suptitle(f"{sea}, launch 0", fontsize=12)
    said = f"{sea}: the truth, and the maps and tracks of Halocline and of the better lawnmower from the first launch."
    return _png(figure), said


def _first(results: Sequence[Result], sea: str) -> Result:
    return next(each for each in results if run_of(each).sea == sea)


def _final(result: Result) -> float:
    return float(np.asarray(result.values["final_rmse"]))


def _figure(width_in: float, height_in: float) -> Figure:
    figure = Figure(figsize=(width_in, height_in), dpi=_DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _png(figure: Figure) -> bytes:
    held = io.BytesIO()
    # Without the library's version in it, equal figures are equal files.
    figure.savefig(held, format="png", dpi=_DPI, metadata={"Software": None})
    return held.getvalue()


def _tidy(axis: Axes, grid: Any) -> None:
    axis.grid(color=_GRID, linewidth=0.6, axis=grid)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(colors=INK, labelsize=9)


def _plain(name: str) -> str:
    return TITLES[name].replace("*", "")


def _slug(text: str) -> str:
    return re.sub(r"\W+", "-", text.lower()).strip("-")
