"""The paper's experiment: its voyages as a sweep, its figures, and a report that says what they show."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from autonomy import __version__
from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel, Prediction
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.planning.plan import Plan
from autonomy.planning.planners import PlanRequest, paper
from sim.experiment import paper_curves, paper_figures, sweep
from sim.experiment.cells import Cell, Result
from sim.experiment.paper_figures import Chart, Picture
from sim.experiment.paper_numbers import (
    LAUNCHES,
    LEARNED,
    MANUAL,
    MAP_COLUMNS,
    MAP_ROWS,
    NOISE_SHARE,
    RHO0,
    SAMPLES,
    THRESHOLDS,
    Ablation,
)
from sim.experiment.paper_report import report
from sim.experiment.paper_setting import hyperparameters, launch_m, paper_waters, profile, random_readings
from sim.experiment.paper_statistics import Course, course_of
from sim.experiment.sweep_provenance import commit, machine
from sim.field import Field, open_field
from sim.truth_map import TruthMap

WEEK_S = 7 * 86_400.0
_DPI = 110


@dataclass(frozen=True)
class Options:
    """What the command line says.

    Attributes:
        out: the folder of everything that is written.
        field, variable: see `sim.field.open_field`.
        seed: of the first voyages: readings' noise, tours; and of the random samples of figure 2.
        seeds: so many voyages for each launch and threshold, with successive seeds.
        samples: end of a voyage.
        ablations: what is done otherwise than in the paper's profile.
        thresholds: of rho.
        rows, columns: of the map.
        jobs, cluster: see `sim.experiment.sweep.run`.
    """

    out: Path
    field: str = "synthetic"
    variable: str | None = None
    seed: int = 0
    seeds: int = 1
    samples: int = SAMPLES
    ablations: tuple[Ablation, ...] = ()
    thresholds: tuple[float, ...] = THRESHOLDS
    rows: int = MAP_ROWS
    columns: int = MAP_COLUMNS
    jobs: int = 1
    cluster: str | None = None


@dataclass(frozen=True)
class Outcome:
    """What was written: the report's file, and the figures of all voyages in the cells' order."""

    report: Path
    courses: tuple[Course, ...]


def run_paper(options: Options) -> Outcome:
    """Sail all voyages that the folder does not hold yet, draw all figures, write `report.md` and `results.json`.

    Raises:
        FieldError: the field can't be used.
        SweepError: a voyage failed.
        OSError: the folder can't be written to.
    """
    options.out.mkdir(parents=True, exist_ok=True)
    waters = paper_waters(options.field, options.variable, options.rows, options.columns)
    for launch in LAUNCHES:
        shift_m = launch_m(waters, *launch)[1]
        print(
            f"launch {launch}: {'in open water' if shift_m == 0.0 else f'moved {shift_m / 1e3:.1f} km to water'}"
        )
    results = sweep.run(cells_of(options), options.out / "cells", options.jobs, options.cluster)
    courses = tuple(course_of(each) for each in results)
    captions = {}
    for name, (figure, said) in _pictures(options, waters, results, courses):
        _write(options.out / f"{name}.png", figure)
        captions[name] = said
    told = report(_facts(options, waters, results), courses, captions)
    (options.out / "report.md").write_text(told, encoding="utf-8")
    _write_numbers(options, courses)
    return Outcome(options.out / "report.md", courses)


def cells_of(options: Options) -> list[Cell]:
    """A voyage for each launch, threshold and seed; that of the paper's own threshold keeps what its figures need."""
    file = Path(options.field)
    return [
        Cell(
            name=f"launch {launch}, rho0 {rho0:g}, seed {seed}",
            function="sim.experiment.paper_cells:voyage_cell",
            arguments={
                "field": options.field,
                "variable": options.variable,
                "rows": options.rows,
                "columns": options.columns,
                "launch": launch,
                "rho0": rho0,
                "seed": seed,
                "samples": options.samples,
                "ablations": sorted(options.ablations),
                "detail": (launch, rho0, seed) == (0, _detailed(options), options.seed),
            },
            inputs=(file,) if file.is_file() else (),
        )
        for seed in range(options.seed, options.seed + options.seeds)
        for launch in range(len(LAUNCHES))
        for rho0 in options.thresholds
    ]


def _detailed(options: Options) -> float:
    return RHO0 if RHO0 in options.thresholds else options.thresholds[0]


def _pictures(
    options: Options, waters: TruthMap, results: Sequence[Result], courses: Sequence[Course]
) -> Iterator[tuple[str, Picture]]:
    chart = Chart(waters)
    yield (
        "figure-1-field",
        paper_figures.dates(chart, frames(open_field(options.field, options.variable), waters)),
    )
    yield "figure-2-by-hand", paper_figures.by_hand(chart, *predicted_by_hand(waters, options.seed))
    lattice = profile(waters).planning.lattice
    plans = [("(a) by hand", first_plan(waters, MANUAL)), ("(b) learned", first_plan(waters, LEARNED))]
    yield "figure-3-spots", paper_figures.spots(chart, plans, waters.survey.candidate_sites(*lattice))
    detail = next(each for each in results if each.cell.arguments["detail"])
    yield "figure-4-paths", paper_figures.paths(chart, detail)
    yield "figure-5-models", paper_figures.models(chart, detail)
    yield "figure-6-variances", paper_figures.variances(chart, detail)
    variance = float(np.nanvar(chart.truth))
    yield "figure-7-errors", paper_curves.errors(results, variance, chart.squared_units)
    yield "figure-8-fluctuation", paper_curves.fluctuations(courses)


def frames(field: Field, waters: TruthMap) -> list[tuple[str, FloatArray]]:
    """The field on dates a week apart, as many of three as it has: names, and values (ny, nx), NaN off the water."""
    lat_deg, lon_deg = np.moveaxis(waters.positions_deg, -1, 0)
    found = []
    for week in range(3):
        time_s = week * WEEK_S
        if time_s > field.times_s[1]:
            break
        start = field.info.start_utc
        name = f"day {7 * week}" if start is None else f"{start + timedelta(seconds=time_s):%d %B %Y}"
        values = np.where(waters.is_water, field.value(lat_deg, lon_deg, time_s), np.nan)
        found.append((f"({chr(97 + week)}) {name}", values))
    return found


def predicted_by_hand(waters: TruthMap, seed: int) -> tuple[Prediction, FloatArray, float]:
    """What 50 random samples make of the field under the hyperparameters set by hand.

    Returns:
        The prediction on the map, where the samples are, shape (50, 2), and the map's RMSE.
    """
    points, values = random_readings(waters, seed)
    model = profile(waters).model
    gp = SparseOnlineGP(
        hyperparameters(waters, MANUAL),
        model.capacity or len(points),
        model.novelty,
        prior_mean=float(values.mean()),
    )
    for point, value in zip(points, values, strict=True):
        gp.update(point, float(value))
    rmse, _ = waters.judge(gp.model(), 0.0)
    return gp.model().predict_grid(waters.x_axis_m, waters.y_axis_m), points, rmse


def first_plan(waters: TruthMap, logarithms: Sequence[float]) -> Plan:
    """The paper's plan from its first launch before any reading, under these hyperparameters."""
    planning = profile(waters).planning
    model = FieldModel.prior(hyperparameters(waters, logarithms))
    start_m, _ = launch_m(waters, *LAUNCHES[0])
    return paper.plan(
        PlanRequest(model, start_m, planning.spots, planning.lattice, "first plan"), waters.survey
    )


def _facts(options: Options, waters: TruthMap, results: Sequence[Result]) -> dict[str, str]:
    """What the voyages were, for the head of the report."""
    configuration = profile(waters, ablations=options.ablations)
    values = results[0].values
    spacing = np.concatenate([np.asarray(each.values["spacing_m"], dtype=float) for each in results])
    sampling = (
        f"every {configuration.sampling.spacing_m:.1f} m along the way (found: {np.median(spacing):.1f} m)"
    )
    units = waters.field.info.units
    return {
        "field": waters.field.info.description,
        "standard deviation": f"{float(np.asarray(values['field_sd'])):.4g} {units}, noise {NOISE_SHARE:.0%} of it",
        "map": f"{options.rows} x {options.columns} cells, {np.count_nonzero(waters.is_water)} of them water",
        "samples": f"{options.samples}, {'at the spots only' if 'spots-only' in options.ablations else sampling}",
        "ablations": ", ".join(options.ablations) or "none: the paper's profile",
        "seeds": ", ".join(str(options.seed + k) for k in range(options.seeds)),
        "software": _software(),
    }


def _software() -> str:
    known: Mapping[str, Any] = commit()
    revision = f", commit {known['git_commit'][:12]}" if known else ""
    return f"halocline {__version__}{revision}{' and changes' if known.get('git_dirty') else ''}"


def _write_numbers(options: Options, courses: Sequence[Course]) -> None:
    """All figures of the voyages with what they came from; the cells beside them hold every curve."""
    asked = {name: value for name, value in asdict(options).items() if name not in ("out", "jobs", "cluster")}
    told = {
        "options": asked,
        "provenance": {"halocline": __version__, **commit(), **machine()},
        "courses": [{**asdict(each), "falls": each.falls} for each in courses],
    }
    text = json.dumps(told, indent=1, allow_nan=True)
    (options.out / "results.json").write_text(text + "\n", encoding="utf-8")


def _write(path: Path, figure: Figure) -> None:
    FigureCanvasAgg(figure)
    # Maps of one shape never fill a figure of another.
    figure.savefig(path, dpi=_DPI, bbox_inches="tight", pad_inches=0.08, pil_kwargs={"optimize": True})
