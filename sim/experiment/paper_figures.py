"""The paper's figures of maps: the field, spots, paths, models and variances."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import Prediction
from autonomy.planning.plan import Plan
from autonomy.shore.server.colours import colormaps
from sim.experiment.cells import Result
from sim.experiment.paper_numbers import LAUNCHES
from sim.plots import INK, LAND, SHORE, draw_shapes
from sim.truth_map import TruthMap

WATER = "#e9eff2"
START, SPOT, BASIS, SITE = "#d7191c", "#1f5fa8", "#ffc400", "#9aa5ab"
PANEL_IN = 3.6
_KEY_IN = 1.8

Picture = tuple[Figure, str]
"""A figure, and what it shows in words."""


@dataclass(frozen=True, eq=False)
class Chart:
    """The map that all figures share."""

    waters: TruthMap

    @cached_property
    def truth(self) -> FloatArray:
        """At the instant at which the field is held, shape (ny, nx)."""
        return self.waters.truth(0.0)

    @cached_property
    def axes_km(self) -> tuple[FloatArray, FloatArray]:
        """East and north."""
        return self.waters.x_axis_m / 1e3, self.waters.y_axis_m / 1e3

    @cached_property
    def scale(self) -> Normalize:
        """Of the field's values; the tails of half a percent at either end are cut off."""
        low, high = np.percentile(self.truth[np.isfinite(self.truth)], [0.5, 99.5])
        return Normalize(float(low), float(high))

    @property
    def label(self) -> str:
        """What is mapped, with its unit."""
        return self.waters.field.info.label

    @property
    def squared_units(self) -> str:
        """Of errors and variances."""
        units = self.waters.field.info.units
        return f" ({units}²)" if units else ""

    @property
    def shape(self) -> float:
        """Height over width."""
        x_km, y_km = self.axes_km
        return float(np.clip(np.ptp(y_km) / np.ptp(x_km), 0.3, 2.0))

    def panels(self, count: int, most: int, width_in: float = PANEL_IN) -> tuple[Figure, list[Axes]]:
        """A figure of so many maps, at `most` so many in a row."""
        columns = min(most, max(count, 1))
        rows = -(-max(count, 1) // columns)
        size = (columns * width_in + 0.9, rows * (width_in * self.shape + 0.35) + 0.9)
        figure = Figure(figsize=size, layout="compressed", facecolor="white")
        axes: Any = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axis in axes[:, 0]:
            axis.set_ylabel("north (km)", color=INK)
        for axis in axes[-1]:
            axis.set_xlabel("east (km)", color=INK)
        for axis in axes.ravel()[count:]:
            axis.set_visible(False)
        return figure, list(axes.ravel()[:count])

    def colour(self, axis: Axes, name: str, values: FloatArray, norm: Normalize, colours: Any) -> Any:
        """A map in colours, land and all; returns what a colour bar needs."""
        self._frame(axis, name, LAND)
        water = self.waters.is_water
        shown = np.where(water, values, np.nan)
        image = axis.pcolormesh(
            *self.axes_km, shown, cmap=colours, norm=norm, shading="nearest", rasterized=True
        )
        draw_shapes(axis, *self.axes_km, shown, water, None)
        return image

    def blank(self, axis: Axes, name: str) -> None:
        """Land and water alone."""
        self._frame(axis, name, LAND)
        water = np.where(self.waters.is_water, 1.0, np.nan)
        axis.pcolormesh(
            *self.axes_km, water, cmap=ListedColormap([WATER]), shading="nearest", rasterized=True
        )
        draw_shapes(axis, *self.axes_km, water, self.waters.is_water, None)

    def _frame(self, axis: Axes, name: str, background: str) -> None:
        x_km, y_km = self.axes_km
        axis.set_facecolor(background)
        axis.set_aspect("equal")
        axis.set_title(name, fontsize=10.5, color=INK)
        axis.set(xlim=(x_km[0], x_km[-1]), ylim=(y_km[0], y_km[-1]))
        axis.xaxis.set_major_locator(MaxNLocator(5))
        axis.yaxis.set_major_locator(MaxNLocator(5))
        axis.tick_params(colors=INK, labelsize=8.5)


def haline() -> ListedColormap:
    """The colour map of salinity: cmocean's."""
    return ListedColormap(np.array(colormaps()["haline"]) / 255.0)


def dates(chart: Chart, frames: Sequence[tuple[str, FloatArray]]) -> Picture:
    """Figure 1: the field on dates a week apart; frames are a name and the field (ny, nx)."""
    figure, axes = chart.panels(len(frames), 3)
    for axis, (name, values) in zip(axes, frames, strict=True):
        image = chart.colour(axis, name, values, chart.scale, haline())
    _bar(figure, image, axes, chart.label, extend="both")
    return figure, "The field on dates a week apart. The first is the truth of everything that follows."


def by_hand(chart: Chart, belief: Prediction, points_m: FloatArray, rmse: float) -> Picture:
    """Figure 2: the truth, and what few random samples make of it under hyperparameters set by hand."""
    figure, axes = chart.panels(2, 2, 4.6)
    image = chart.colour(axes[0], "(a) truth", chart.truth, chart.scale, haline())
    name = f"(b) predicted from {len(points_m)} random samples: RMSE {rmse:.3g}"
    chart.colour(axes[1], name, belief.mean, chart.scale, haline())
    _dots(axes[1], points_m, s=5, color="white", edgecolors=INK, linewidths=0.5)
    _bar(figure, image, axes, chart.label, extend="both")
    return figure, (
        f"The truth, and the prediction from {len(points_m)} random samples (dots) under hyperparameters set by hand: "
        "a length-scale of e cells reaches hardly beyond each sample, and elsewhere the map is the samples' mean."
    )


def spots(chart: Chart, plans: Sequence[tuple[str, Plan]], sites_m: FloatArray) -> Picture:
    """Figure 3: where the planner would sample before anything is known; plans by the name of their hyperparameters."""
    figure, axes = chart.panels(len(plans), 2, 4.6)
    for axis, (name, plan) in zip(axes, plans, strict=True):
        chart.blank(axis, f"{name}: {plan.mutual_information:.2f} nats")
        _dots(axis, sites_m, s=7, color=SITE, marker="s")
        _dots(axis, plan.spots_m, s=34, color=SPOT, edgecolors="white", linewidths=0.6, zorder=3)
    handles = [
        _dot(SPOT, f"sampling spots ({len(plans[0][1].spots_m)})", 7),
        _dot(SITE, "candidate sites", 4, "s"),
    ]
    _legend(figure, handles)
    return figure, (
        "Sampling spots before any reading, under hyperparameters set by hand and under the paper's learned ones. By "
        "hand all sites are independent and equally good: a tie, which goes to the lowest index, in the south."
    )


def paths(chart: Chart, detail: Result) -> Picture:
    """Figure 4: successive plans, each with its start, its spots and the basis vectors it was made with."""
    values: Any = detail.values
    count = len(values["path_samples"])
    figure, axes = chart.panels(count, 3)
    for k, axis in enumerate(axes):
        chart.blank(
            axis, f"({chr(97 + k)}) plan {values['path_number'][k]}, {_after(values['path_samples'][k])}"
        )
        start, route = values["path_start_m"][k], _known(values["path_route_m"][k])
        axis.plot(*values["track_m"][: values["path_track"][k]].T / 1e3, color=SITE, linewidth=0.7)
        axis.plot(*np.vstack([start, route]).T / 1e3, color=INK, linewidth=1.0)
        _dots(axis, _known(values["path_spots_m"][k]), s=20, color=SPOT, zorder=3)
        basis = _known(values["path_basis_m"][k])
        _dots(axis, basis, s=13, color=BASIS, edgecolors=INK, linewidths=0.4, zorder=4)
        _dots(axis, start[None], s=42, color=START, edgecolors="white", linewidths=0.8, zorder=5)
    handles = [
        _dot(START, "where the boat is", 7),
        _dot(SPOT, "sampling spots", 6),
        _dot(BASIS, "basis vectors", 5, edge=INK),
        Line2D([], [], color=INK, label="planned path"),
        Line2D([], [], color=SITE, linewidth=1.0, label="sailed so far"),
        Patch(facecolor=LAND, edgecolor=SHORE, label="land, or outside"),
    ]
    _legend(figure, handles)
    row, column = LAUNCHES[int(detail.cell.arguments["launch"])]
    rho0 = detail.cell.arguments["rho0"]
    return (
        figure,
        f"Plans of the voyage from ({row}, {column}) with ρ₀ = {rho0:g}, and the basis vectors of the moment.",
    )


def models(chart: Chart, detail: Result) -> Picture:
    """Figure 5: what was believed when those plans were made."""
    values: Any = detail.values
    count = len(values["path_samples"])
    figure, axes = chart.panels(count, 3)
    for k, axis in enumerate(axes):
        if not len(_known(values["path_basis_m"][k])):
            chart.blank(axis, f"({chr(97 + k)}) {_after(values['path_samples'][k])}: nothing is believed")
            continue
        mean = np.asarray(values["path_mean"][k], dtype=float)
        rmse = np.sqrt(np.nanmean((mean - chart.truth) ** 2))
        name = f"({chr(97 + k)}) {_after(values['path_samples'][k])}: RMSE {rmse:.3g}"
        image = chart.colour(axis, name, mean, chart.scale, haline())
    _bar(figure, image, axes, chart.label, extend="both")
    return figure, "What was believed at those moments, in the colours of the truth (figure 2a)."


def variances(chart: Chart, detail: Result) -> Picture:
    """Figure 6: how sure the belief was along the voyage."""
    values: Any = detail.values
    maps = np.where(chart.waters.is_water, np.asarray(values["variance"], dtype=float), np.nan)
    low, high = np.nanpercentile(maps, [1.0, 99.9])
    norm = LogNorm(max(float(low), 1e-12), float(high))
    figure, axes = chart.panels(len(maps), 5, 2.9)
    for k, axis in enumerate(axes):
        name = f"({chr(97 + k)}) {_after(values['variance_samples'][k])}"
        image = chart.colour(
            axis, name, np.maximum(maps[k], norm.vmin or 0.0), norm, matplotlib.colormaps["magma"]
        )
    _bar(figure, image, axes, f"variance of the prediction{chart.squared_units}", extend="both")
    return figure, (
        "Variances of the prediction along the same voyage, on a logarithmic scale. They are what the model claims "
        "under the hyperparameters of the moment: where these change, the whole map changes."
    )


def _dots(axis: Axes, points_m: FloatArray, **style: Any) -> None:
    """Places (n, 2), local metres."""
    axis.scatter(points_m[:, 0] / 1e3, points_m[:, 1] / 1e3, **style)


def _known(padded: FloatArray) -> FloatArray:
    return padded[np.isfinite(padded[:, 0])]


def _after(samples: int) -> str:
    return f"after {samples} samples" if samples else "before any sample"


def _dot(colour: str, label: str, size: float, marker: str = "o", edge: str | None = None) -> Line2D:
    return Line2D(
        [], [], linestyle="none", marker=marker, markersize=size, color=colour, label=label,
        markeredgecolor=edge or colour, markeredgewidth=0.5,
    )  # fmt: skip


def _legend(figure: Figure, handles: Iterable[Any]) -> None:
    shown = list(handles)
    columns = min(len(shown), max(1, int(figure.get_figwidth() / _KEY_IN)))
    figure.legend(handles=shown, loc="outside lower center", ncols=columns, frameon=False, fontsize=9.5)


def _bar(figure: Figure, image: Any, axes: Sequence[Axes], text: str, extend: str) -> None:
    bar = figure.colorbar(image, ax=list(axes), location="right", fraction=0.03, pad=0.01, extend=extend)
    bar.set_label(text, color=INK)
    bar.ax.tick_params(labelsize=8.5, colors=INK)
    bar.outline.set_visible(False)
    if not isinstance(image.norm, LogNorm):
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
