"""The latest map as a picture: mean, standard deviation, track, plan, basis vectors. Needs matplotlib."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from autonomy.geometry import FloatArray, LocalFrame
from autonomy.learning.description import describe
from autonomy.shore.saving import replace_file
from autonomy.shore.subscriber import VehicleView
from autonomy.shore.words import agreement
from autonomy.wire import ModelSnapshot, ObservationNotice, PlanNotice

_CELLS = 200
_KM = 1000.0


def write_map(path: Path, view: VehicleView, track: Sequence[ObservationNotice]) -> None:
    """Draw a vehicle's latest model as PNG; the file at `path` is replaced as a whole, never half written.

    Raises:
        ValueError: the vehicle hasn't published a model.
        OSError: the file cannot be written.
    """
    if view.model is None:
        raise ValueError(f"{view.vehicle} has not published a model")
    write_png(path, draw_map(view.model, view.plan, track))


def write_png(path: Path, figure: Figure) -> None:
    """Replace the file at `path` by a picture. Raises OSError."""
    drawn = io.BytesIO()
    FigureCanvasAgg(figure).print_figure(drawn, format="png")
    replace_file(path, drawn.getvalue())


def draw_map(model: ModelSnapshot, plan: PlanNotice | None, track: Sequence[ObservationNotice]) -> Figure:
    """Mean and standard deviation over the survey area, side by side; axes in km of the survey frame."""
    x_min, y_min, x_max, y_max = model.bounds_m
    x_axis, y_axis = _axes(model)
    prediction = model.model.predict_grid(x_axis, y_axis)
    deviation = np.sqrt(np.maximum(prediction.variance, 0.0))
    shape = float(np.clip((y_max - y_min) / (x_max - x_min), 0.4, 1.6))
    figure = Figure(figsize=(13.0, 1.6 + 5.4 * shape), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    # A dollar sign would begin a formula.
    unit = "" if model.units in ("", "1") else f" ({model.units})".replace("$", r"\$")
    name = model.variable.replace("_", " ").replace("$", r"\$")
    extent = (x_min / _KM, x_max / _KM, y_min / _KM, y_max / _KM)
    for axes, values, label, colours in (
        (left, prediction.mean, f"{name}{unit}", "viridis"),
        (right, deviation, f"standard deviation of the {name}{unit}", "magma"),
    ):
        image = axes.imshow(values, origin="lower", extent=extent, cmap=colours, aspect="equal")
        figure.colorbar(image, ax=axes, label=label, shrink=0.85)
        axes.set_xlabel("east (km)")
        axes.set_xlim(extent[0], extent[1])
        axes.set_ylim(extent[2], extent[3])
    left.set_ylabel("north (km)")
    _draw_way(left, model, plan, track)
    _draw_way(right, model, plan, track)
    _draw_basis(right, model)
    figure.suptitle(_title(model))
    _draw_legend(figure, right)
    return figure


def _axes(model: ModelSnapshot) -> tuple[FloatArray, FloatArray]:
    """Centres of the picture's cells; the longer side has `_CELLS` of them."""
    x_min, y_min, x_max, y_max = model.bounds_m
    step = max(x_max - x_min, y_max - y_min) / _CELLS
    nx = max(2, round((x_max - x_min) / step))
    ny = max(2, round((y_max - y_min) / step))
    dx, dy = (x_max - x_min) / nx, (y_max - y_min) / ny
    x_axis: FloatArray = x_min + dx * (np.arange(nx, dtype=np.float64) + 0.5)
    y_axis: FloatArray = y_min + dy * (np.arange(ny, dtype=np.float64) + 0.5)
    return x_axis, y_axis


def _local_km(model: ModelSnapshot, positions_deg: Sequence[tuple[float, float]]) -> FloatArray:
    frame = LocalFrame(model.origin_lat_deg, model.origin_lon_deg)
    degrees = np.asarray(positions_deg, dtype=float).reshape(-1, 2)
    local: FloatArray = frame.to_local(degrees[:, 0], degrees[:, 1]) / _KM
    return local


def _draw_way(
    axes: Any, model: ModelSnapshot, plan: PlanNotice | None, track: Sequence[ObservationNotice]
) -> None:
    if track:
        sailed = _local_km(model, [(one.lat_deg, one.lon_deg) for one in track])
        axes.plot(sailed[:, 0], sailed[:, 1], color="white", linewidth=0.8, label="track")
        axes.plot(sailed[-1, 0], sailed[-1, 1], "o", color="red", markersize=5, label="vehicle")
    if plan is not None and plan.route_deg:
        route = _local_km(model, [plan.start_deg, *plan.route_deg])
        axes.plot(route[:, 0], route[:, 1], "--", color="orange", linewidth=1.0, label="plan")
        spots = route[1:][np.asarray(plan.is_spot, dtype=bool)]
        axes.plot(spots[:, 0], spots[:, 1], "D", color="orange", markersize=3.5, label="sampling spots")


def _draw_basis(axes: Any, model: ModelSnapshot) -> None:
    basis = np.asarray(model.model.basis) / _KM
    if len(basis):
        axes.plot(basis[:, 0], basis[:, 1], "+", color="cyan", markersize=6, label="basis vectors")


def _draw_legend(figure: Figure, axes: Any) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=True)
        # White lines need a ground to be seen on.
        legend.get_frame().set_facecolor("lightgrey")


def _title(model: ModelSnapshot) -> str:
    hours, rest = divmod(int(model.model_time_s), 3600)
    # The newline keeps what is believed of the field apart from what has been done.
    return (
        f"{model.vehicle}: {model.samples} samples, {len(model.model)} basis vectors, ρ {model.rho:.2f}, "
        f"{model.replans} plans, vehicle clock {hours}:{rest // 60:02d}:{rest % 60:02d}\n"
        f"{describe(model.kernel)}  ·  {agreement(model)}"
    )
