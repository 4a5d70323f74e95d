"""A plan as a picture: what is uncertain now, and what will be once it has been sailed. Needs matplotlib."""

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.figure import Figure

from autonomy.geometry import FloatArray
from autonomy.planning.expectation import readings_along, variances
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea
from autonomy.shore.picture import write_png

_CELLS = 80
_KM = 1000.0


def write_plan(path: Path, plan: Plan, request: PlanRequest, survey: SurveyArea) -> None:
    """Draw a plan as PNG; the file at `path` is replaced as a whole. Raises OSError if it can't be written."""
    write_png(path, draw_plan(plan, request, survey))


def draw_plan(plan: Plan, request: PlanRequest, survey: SurveyArea) -> Figure:
    """Standard deviation of the field, before and after the plan, side by side; axes in km of the survey's frame."""
    before, after = _deviations(plan, request, survey)
    x_min, y_min, x_max, y_max = survey.bounds
    shape = float(np.clip((y_max - y_min) / (x_max - x_min), 0.4, 1.6))
    figure = Figure(figsize=(13.0, 1.6 + 5.4 * shape), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    extent = (x_min / _KM, x_max / _KM, y_min / _KM, y_max / _KM)
    for axes, values, label in ((left, before, "before the plan"), (right, after, "after it")):
        image = axes.imshow(
            values,
            origin="lower",
            extent=extent,
            cmap="magma",
            aspect="equal",
            vmin=0.0,
            vmax=np.nanmax(before),
        )
        figure.colorbar(image, ax=axes, label=f"standard deviation {label}", shrink=0.85)
        axes.set_facecolor("lightgrey")
        axes.set_xlabel("east (km)")
        axes.set_xlim(extent[0], extent[1])
        axes.set_ylim(extent[2], extent[3])
    left.set_ylabel("north (km)")
    _draw_route(right, plan)
    figure.suptitle(
        f"{plan.planner}: {plan.length_m / _KM:.1f} km, {len(plan.spots_m)} spots".replace("$", r"\$")
    )
    legend = figure.legend(
        *right.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=True
    )
    legend.get_frame().set_facecolor("lightgrey")
    return figure


def _deviations(plan: Plan, request: PlanRequest, survey: SurveyArea) -> tuple[FloatArray, FloatArray]:
    """Maps, (rows, columns) from the south-west, NaN on land: before the plan and after it."""
    x_min, y_min, x_max, y_max = survey.bounds
    step = max(x_max - x_min, y_max - y_min) / _CELLS
    columns, rows = (max(2, round(side / step)) for side in (x_max - x_min, y_max - y_min))
    x = x_min + (np.arange(columns) + 0.5) * ((x_max - x_min) / columns)
    y = y_min + (np.arange(rows) + 0.5) * ((y_max - y_min) / rows)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    wet = shapely.contains_xy(survey.water, points[:, 0], points[:, 1])
    readings_m, each = readings_along(np.vstack([plan.start_m, plan.route_m]), request.sample_spacing_m)
    noise = request.model.kernel.noise_variance / each
    maps = np.full((2, len(points)), np.nan)
    maps[:, wet] = np.sqrt(variances(request.model, points[wet], readings_m, noise))
    before, after = maps.reshape(2, rows, columns)
    return before, after


def _draw_route(axes: Any, plan: Plan) -> None:
    route = np.vstack([plan.start_m, plan.route_m]) / _KM
    spots = plan.spots_m / _KM
    axes.plot(route[:, 0], route[:, 1], "-", color="cyan", linewidth=1.2, label="route")
    if len(spots):
        axes.plot(spots[:, 0], spots[:, 1], "D", color="white", markersize=3.5, label="spots")
    axes.plot(route[0, 0], route[0, 1], "o", color="red", markersize=6, label="start")
