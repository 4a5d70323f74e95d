"""The paper's last figure, the errors over samples, and one more: how much they fluctuate."""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from autonomy.geometry import FloatArray
from sim.experiment.cells import Result
from sim.experiment.paper_figures import SPOT, Picture
from sim.experiment.paper_numbers import LAUNCHES
from sim.experiment.paper_statistics import NEVER, Course, geometric_mean
from sim.plots import INK, SHORE


def errors(results: Sequence[Result], variance: float, squared_units: str) -> Picture:
    """Figure 7: mean square errors over samples, for each launch and threshold; geometric means over seeds.

    `variance` is that of the field over the water, in the errors' `squared_units`: " (PSU²)", or nothing.
    """
    figure = Figure(figsize=(12.5, 5.4), layout="constrained", facecolor="white")
    launches = sorted({int(each.cell.arguments["launch"]) for each in results})
    axes: Any = figure.subplots(1, len(launches), sharey=True, squeeze=False)[0]
    for axis, launch in zip(axes, launches, strict=True):
        for rho0 in sorted({float(each.cell.arguments["rho0"]) for each in results}):
            runs = [
                each
                for each in results
                if each.cell.arguments["launch"] == launch and each.cell.arguments["rho0"] == rho0
            ]
            if runs:
                axis.plot(*_mean_course(runs), label=f"{rho0:.1f}", **_line(rho0))
        axis.axhline(variance, color=SHORE, linewidth=1.0, linestyle=":")
        row, column = LAUNCHES[launch]
        axis.set_title(f"launched at ({row}, {column})", fontsize=11, color=INK)
        axis.set(yscale="log", xlabel="samples")
        axis.grid(color="#e3e3e3", linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel(f"mean square error{squared_units}")
    axes[0].annotate(
        "variance of the field", (0.99, variance), xycoords=("axes fraction", "data"), xytext=(0, 3),
        textcoords="offset points", ha="right", fontsize=9, color=SHORE,
    )  # fmt: skip
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, title="ρ₀", loc="outside right upper", frameon=False)
    seeds = len({each.cell.arguments["seed"] for each in results})
    over = f", geometric means over {seeds} seeds" if seeds > 1 else ""
    return (
        figure,
        f"Mean square error of the map over the number of samples{over}. ρ₀ = 1 never re-estimates.",
    )


def fluctuations(courses: Sequence[Course]) -> Picture:
    """How much the error fluctuates, and where it climbs, over the threshold."""
    figure = Figure(figsize=(12.0, 4.2), layout="constrained", facecolor="white")
    left, right = figure.subplots(1, 2)
    thresholds = sorted({each.rho0 for each in courses})
    for launch, marker in zip(sorted({each.launch for each in courses}), "os", strict=False):
        these = [each for each in courses if each.launch == launch]
        label = f"launched at {LAUNCHES[launch]}"
        left.scatter(
            [each.rho0 for each in these], [each.fluctuation for each in these], marker=marker, s=26,
            facecolors="none", edgecolors=SPOT, label=label,
        )  # fmt: skip
    means = [
        geometric_mean([each.fluctuation for each in courses if each.rho0 == rho0]) for rho0 in thresholds
    ]
    left.plot(thresholds, means, color=INK, linewidth=1.6, label="geometric mean")
    left.set(xlabel="ρ₀", ylabel="RMS of ln(MSE) about its falling trend", ylim=(0.0, None))
    left.legend(frameon=False, fontsize=9)
    at_fits = [
        float(np.mean([each.rise_at_fits for each in courses if each.rho0 == rho0])) for rho0 in thresholds
    ]
    total = [float(np.mean([each.rise for each in courses if each.rho0 == rho0])) for rho0 in thresholds]
    right.bar(thresholds, total, width=0.07, color="#b7c9d6", label="between re-estimates")
    right.bar(thresholds, at_fits, width=0.07, color=SPOT, label="at re-estimates")
    right.set(xlabel="ρ₀", ylabel="what ln(MSE) climbs in all")
    right.legend(frameon=False, fontsize=9)
    for axis in (left, right):
        axis.set_xticks(thresholds)
        axis.grid(color="#e3e3e3", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, (
        "Left: how far the error strays from a curve that only falls. Right: what it climbs on the way down, when "
        "re-estimates are adopted and between them (means over launches and seeds)."
    )


def _mean_course(runs: Sequence[Result]) -> tuple[FloatArray, FloatArray]:
    """Samples, and the geometric mean of the errors there; runs begin with their first model."""
    columns = [
        (np.asarray(each.values["samples"], dtype=float), np.asarray(each.values["mse"], dtype=float))
        for each in runs
    ]
    samples = columns[0][0]
    logs = [np.interp(samples, counts, np.log(error)) for counts, error in columns]
    return samples, np.exp(np.mean(logs, axis=0))


def _line(rho0: float) -> dict[str, Any]:
    if rho0 == NEVER:
        return {"color": INK, "linewidth": 1.6, "linestyle": "--"}
    return {"color": matplotlib.colormaps["turbo"](0.05 + 0.95 * rho0), "linewidth": 1.3}
