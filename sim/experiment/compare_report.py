"""The report of a comparison: what was sailed and how, the tables, the pictures, where the figures come from."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sim.experiment.cells import Result
from sim.experiment.compare_cells import SETTLED
from sim.experiment.compare_maps import MOST_POINTS
from sim.experiment.compare_pictures import Picture
from sim.experiment.compare_seas import NOISE_SHARE, READINGS_PER_SIDE, SPEED_MPS
from sim.experiment.compare_table import GOAL, Comparison, cost_table, run_of, table, table_by_sea
from sim.experiment.compare_voyages import COVER_SIDES
from sim.experiment.report import Image, Points, Section, Table, Text, write_report
from sim.experiment.strategies import LATTICE, SPOTS

_RULES = (
    f"**Equal for all**: launch, water, budget of distance, speed ({SPEED_MPS:g} m/s), a reading every "
    f"√(water area)/{READINGS_PER_SIDE} along the track, noise of {NOISE_SHARE:.0%} of the field's standard deviation. "
    "On seas that stand still everybody has to be home again within the budget; on seas that move the voyage ends "
    "anywhere. Everybody knows the water, home and budget beforehand, and nothing of the field.",
    "**Halocline** is the configuration that ships, but for the budget's reserve and home margin (none here, so that "
    "all sail equally far). Its decisions, and those of **the paper's profile**, are made by the very core that runs "
    "on a boat, which speaks MAVLink with the simulated vessel. Their map is the one on board at that moment.",
    "**The others** are waypoints for the same vessel. Their map is a batch process ashore: the exact Gaussian process "
    "of all readings, Matérn-3/2, isotropic, over moving seas also forgetting where the readings ask for it, its "
    f"hyperparameters fitted by marginal likelihood (on up to {MOST_POINTS} of the readings) with the same weak priors "
    "as on board. Halocline knows less and more than that: it keeps a few hundred basis vectors, not all readings, and "
    "it chooses among several kernels. The last column takes this out: there the batch process maps "
    "Halocline's readings too, so that only the tracks differ.",
    "**Lawnmower**: parallel lanes, clipped to the water, with the spacing at which one cover, detours and the way "
    "home use up the budget; over moving seas a sparser cover "
    f"({COVER_SIDES:g} × √(water area) long), sailed to and fro. Both directions are sailed: a survey "
    "team has to choose one beforehand, so their mean is told, and the one that did better in hindsight.",
    "**Greedy entropy** goes to the site where a reading is the least certain, the nearest of equals, and fits its map "
    f"anew at each; **greedy MI + tour** chooses {SPOTS} spots by mutual information, sails a short tour of them, fits "
    f"anew and chooses others; both among {LATTICE[0]} × {LATTICE[1]} candidate sites, reading all along "
    "the way. **Random waypoints** are drawn evenly over the water.",
)

_READING = (
    "Errors are in units of the field's standard deviation over the water (predicting its mean scores 1): at the end "
    f"of the voyage, over moving seas root mean square over its last {1 - SETTLED:.0%}. NLPD and the coverage of "
    "95 % intervals are those of readings, expected over all the water. The way to an error is where the map's error "
    f"came down to {GOAL:g} and stayed there, in √(water area), the median of all voyages.",
    "Ratios are paired: the same sea, launch and seed. Geometric mean over each sea's voyages, then over seas; the "
    "interval is Student's over **seas**, so it speaks of another sea of this kind. More launches or seeds do not make "
    "it narrower than the seas differ. ± is the standard deviation over seas (by sea: over its voyages).",
)


def write(
    file: Path,
    results: Sequence[Result],
    found: Sequence[Comparison],
    drawn: Mapping[str, Picture],
    notes: Sequence[str],
) -> None:
    """Write the report. OSError if it can't be written."""
    maps = [Image(*drawn[name]) for name in drawn if name.startswith("map-")]
    sections = [
        Section(
            "What came of it",
            [Text(tuple(notes)), Table(table(found)), Image(*drawn["ratios"]), Text(_READING)],
        ),
        Section("Sea by sea", [Table(table_by_sea(found)), Image(*drawn["courses"])]),
        Section("Who sails, and what is equal", [Points(_RULES)]),
        Section("Maps and tracks", maps),
        Section(
            "CPU time (of this machine, and another each time)",
            [
                Text(
                    ("Planning and learning of one voyage, mean over seas. Nothing else here depends on it.",)
                ),
                Table(cost_table(found)),
            ],
        ),
        Section("Where it comes from", [Points(tuple(_origin(results)))]),
    ]
    write_report(file, "Halocline against what people use today", sections)


def _origin(results: Sequence[Result]) -> list[str]:
    seas: dict[str, Result] = {}
    for each in results:
        seas.setdefault(run_of(each).sea, each)
    lines = [f"**{name}**: {_sea_in_words(each)}" for name, each in seas.items()]
    launches = sorted({run_of(each).launch for each in results})
    seeds = sorted({run_of(each).seed for each in results})
    lines.append(f"launches {launches}, seeds {seeds}: {len(results)} voyages in all")
    told = results[0].provenance
    lines += [f"{key}: `{told[key]}`" for key in sorted(told) if key in _TOLD]
    return lines


_TOLD = ("git_commit", "git_dirty", "halocline", "packages", "python", "system")


def _sea_in_words(result: Result) -> str:
    sea = result.cell.arguments["sea"]
    side_km, budget_km = (float(np.asarray(result.values[f"{n}_m"])) / 1000.0 for n in ("side", "budget"))
    words = f"`{Path(sea['spec']).name}`"
    if sea["variable"]:
        words += f", `{sea['variable']}`"
    words += f"; √(water area) {side_km:.1f} km, budget {budget_km:.0f} km"
    hastened = float(np.asarray(result.values["hastened"]))
    if hastened != 1.0:
        words += f"; its record passes {hastened:.0f} times as fast as it was"
    shrunk = float(np.asarray(result.values["shrunk"]))
    if shrunk != 1.0:
        words += f"; drawn together {shrunk:.3g} times"
    return words
