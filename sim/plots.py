"""Pictures of a survey: what was true, what was believed, how sure the belief was, and how it grew."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from sim.field_grid import FloatArray

LAND = "#b9b4aa"
SHORE = "#6e685e"
TRACK = "#ffffff"
BASIS = "#111111"
SPOT = "#ff5a36"
INK = "#222222"
VALUES_MAP = "viridis"
DEVIATION_MAP = "magma"
WIDTH_IN, DPI = 16.0, 100
MAP_WIDTH_IN, BAR_IN, COURSE_IN, TITLE_IN = 4.9, 1.5, 2.6, 0.5
GOAL = 0.35  # of the field's standard deviation


@dataclass(frozen=True)
class _Overlay:
    track_km: FloatArray
    basis_km: FloatArray
    spots_km: FloatArray


def demo_figure(
    path: str | Path,
    x_axis_m: ArrayLike,
    y_axis_m: ArrayLike,
    truth: ArrayLike,
    mean: ArrayLike,
    standard_deviation: ArrayLike,
    track_m: ArrayLike,
    basis_m: ArrayLike,
    spots_m: ArrayLike,
    samples: ArrayLike,
    rmse: ArrayLike,
    field_std: float,
    label: str,
    units: str,
    title: str,
) -> None:
    """Write one PNG, 1600 pixels wide: truth, nowcast and standard deviation above, RMSE over samples below.

    Args:
        path: the PNG to write.
        x_axis_m: east, ascending, shape (nx,), local metres.
        y_axis_m: north, ascending, shape (ny,).
        truth: shape (ny, nx), NaN on land.
        mean: the belief, shape (ny, nx); shown where the truth is water.
        standard_deviation: of the belief, shape (ny, nx).
        track_m: places sailed through, shape (k, 2).
        basis_m: basis vectors, shape (m, 2).
        spots_m: sampling spots of all plans, shape (n, 2).
        samples: number of samples at each evaluation, shape (s,).
        rmse: root mean square error of the belief at each evaluation, shape (s,), in the field's unit.
        field_std: standard deviation of the truth over the water.
        label: what is mapped, such as "sea surface salinity".
        units: its unit, may be empty.
        title: one line with the summary's figures.
    """
    x_km, y_km = np.asarray(x_axis_m, dtype=float) / 1000.0, np.asarray(y_axis_m, dtype=float) / 1000.0
    truth = np.asarray(truth, dtype=float)
    water = np.isfinite(truth)
    overlay = _Overlay(_km(track_m), _km(basis_m), _km(spots_m))
    # As high as the shape of the sea asks for; a sea that is a mere strip keeps some room.
    map_in = MAP_WIDTH_IN * float(np.clip(np.ptp(y_km) / np.ptp(x_km), 0.3, 2.0)) + BAR_IN
    figure = Figure(figsize=(WIDTH_IN, TITLE_IN + map_in + COURSE_IN), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    figure.set_layout_engine(ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08))
    figure.suptitle(title, fontsize=15, color=INK)
    rows = figure.add_gridspec(2, 1, height_ratios=[map_in, COURSE_IN])
    axes: Any = rows[0].subgridspec(1, 3).subplots(sharex=True, sharey=True)
    quantity = f"{label} ({units})" if units else label
    low, high = (float(v) for v in np.percentile(truth[water], [0.5, 99.5]))
    contours = np.linspace(low, high, 9)[1:-1] if high > low else None
    believed = np.where(water, np.asarray(mean, dtype=float), np.nan)
    for axis, name, values in ((axes[0], "truth", truth), (axes[1], "nowcast", believed)):
        image = _map(axis, name, x_km, y_km, values, VALUES_MAP, low, high)
        draw_shapes(axis, x_km, y_km, values, water, contours)
        _draw(axis, overlay)
    _bar(figure, image, list(axes[:2]), quantity)
    deviation = np.where(water, np.asarray(standard_deviation, dtype=float), np.nan)
    image = _map(
        axes[2], "standard deviation", x_km, y_km, deviation, DEVIATION_MAP, 0.0, float(np.nanmax(deviation))
    )
    draw_shapes(axes[2], x_km, y_km, deviation, water, None)
    _draw(axes[2], overlay)
    _bar(figure, image, [axes[2]], f"standard deviation{f' ({units})' if units else ''}")
    axes[0].set_ylabel("north (km)")
    lower = rows[1].subgridspec(1, 2, width_ratios=[4.4, 1.0])
    _course(figure.add_subplot(lower[0]), samples, rmse, field_std, units)
    _key(figure.add_subplot(lower[1]), overlay)
    figure.savefig(path, dpi=DPI)


def _km(points_m: ArrayLike) -> FloatArray:
    return np.asarray(points_m, dtype=float).reshape(-1, 2) / 1000.0


def _map(
    axis: Axes,
    name: str,
    x_km: FloatArray,
    y_km: FloatArray,
    values: FloatArray,
    colours: str,
    low: float,
    high: float,
) -> Any:
    axis.set_facecolor(LAND)
    image = axis.pcolormesh(
        x_km,
        y_km,
        values,
        cmap=colours,
        vmin=low,
        vmax=high if high > low else low + 1.0,
        shading="nearest",
        rasterized=True,
    )
    axis.set_aspect("equal")
    axis.set_title(name, fontsize=13, color=INK)
    axis.set_xlabel("east (km)")
    axis.tick_params(colors=INK, labelsize=10)
    return image


def draw_shapes(
    axis: Axes, x_km: FloatArray, y_km: FloatArray, values: FloatArray, water: Any, levels: FloatArray | None
) -> None:
    """Faint contours, and the shore."""
    if levels is not None:
        axis.contour(x_km, y_km, values, levels=levels, colors="white", linewidths=0.5, alpha=0.35)
    if not water.all():
        axis.contour(x_km, y_km, water.astype(float), levels=[0.5], colors=SHORE, linewidths=1.0)


def _draw(axis: Axes, overlay: _Overlay) -> None:
    x_limits, y_limits = axis.get_xlim(), axis.get_ylim()
    axis.plot(*overlay.track_km.T, color=TRACK, linewidth=0.9, alpha=0.75, solid_joinstyle="round")
    axis.scatter(
        overlay.spots_km[:, 0],
        overlay.spots_km[:, 1],
        s=17,
        marker="D",
        facecolors="none",
        edgecolors=SPOT,
        linewidths=1.0,
    )
    axis.scatter(
        overlay.basis_km[:, 0],
        overlay.basis_km[:, 1],
        s=9,
        color=BASIS,
        edgecolors="white",
        linewidths=0.4,
        zorder=3,
    )
    axis.set_xlim(x_limits)
    axis.set_ylim(y_limits)


def _bar(figure: Figure, image: Any, axes: list[Axes], text: str) -> None:
    """One bar below the axes it belongs to; pointed where the values' tails are cut off."""
    shared = len(axes) > 1
    bar = figure.colorbar(
        image,
        ax=axes,
        location="bottom",
        fraction=0.05,
        pad=0.02,
        aspect=60 if shared else 30,
        shrink=0.85,
        extend="both" if shared else "neither",
    )
    bar.set_label(text, fontsize=11, color=INK)
    bar.ax.tick_params(labelsize=10, colors=INK)
    bar.ax.ticklabel_format(useOffset=False)
    bar.outline.set_visible(False)


def _course(axis: Axes, samples: ArrayLike, rmse: ArrayLike, field_std: float, units: str) -> None:
    """RMSE over samples, with the field's standard deviation and the goal as lines."""
    count, error = np.asarray(samples, dtype=float), np.asarray(rmse, dtype=float)
    goal = GOAL * field_std
    axis.plot(count, error, color="#21618c", linewidth=2.0)
    axis.fill_between(count, error, color="#21618c", alpha=0.12)
    axis.axhline(goal, color=SPOT, linewidth=1.3, linestyle="--")
    top = max(1.08 * float(np.max(error, initial=0.0)), 1.15 * field_std)
    last = float(np.max(count, initial=1.0))
    axis.annotate(
        f"{GOAL:.0%} of the field's standard deviation",
        (0.0, goal),
        xytext=(6, -14),
        textcoords="offset points",
        color=SPOT,
        fontsize=10.5,
        ha="left",
    )
    axis.set(xlim=(0.0, last), ylim=(0.0, top), xlabel="samples")
    axis.set_ylabel(f"RMSE{f' ({units})' if units else ''}")
    share = axis.secondary_yaxis(
        "right", functions=(_scaled_by(100.0 / field_std), _scaled_by(field_std / 100.0))
    )
    share.set_ylabel("% of the field's std")
    axis.grid(color="#dddddd", linewidth=0.6)
    axis.spines["top"].set_visible(False)
    axis.tick_params(colors=INK, labelsize=10)


def _scaled_by(factor: float) -> Callable[[ArrayLike], FloatArray]:
    return lambda values: np.asarray(values, dtype=float) * factor


def _key(axis: Axes, overlay: _Overlay) -> None:
    axis.axis("off")
    handles = [
        Line2D([], [], color=TRACK, linewidth=2.0, label="track"),
        Line2D(
            [],
            [],
            linestyle="none",
            marker="D",
            markerfacecolor="none",
            markeredgecolor=SPOT,
            label=f"sampling spots ({len(overlay.spots_km)})",
        ),
        Line2D(
            [],
            [],
            linestyle="none",
            marker="o",
            color=BASIS,
            markeredgecolor="white",
            markersize=6,
            label=f"basis vectors ({len(overlay.basis_km)})",
        ),
        Patch(facecolor=LAND, edgecolor=SHORE, label="land, or outside"),
    ]
    axis.legend(
        handles=handles,
        loc="center",
        fontsize=11.5,
        facecolor="#44535c",
        edgecolor="none",
        framealpha=0.9,
        labelcolor="white",
        borderpad=1.0,
        labelspacing=0.9,
    )
