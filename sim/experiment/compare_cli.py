"""`sim experiment compare`: our default beside the paper's profile and what people sail today."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from autonomy.option_types import above_zero, whole
from sim.experiment.sweep_options import add_sweep_arguments

if TYPE_CHECKING:
    from sim.experiment.compare import Plan
    from sim.experiment.compare_seas import SeaChoice

_SIDES, _MOVING_SIDES = 6.0, 12.0
_QUICK_SIDES = 3.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sim experiment compare`."""
    parser.description = (
        f"{parser.description}: equal distance and equal sampling along the track, on several seas that stand still "
        "or move. Writes report.html, table.md and pictures."
    )
    seas = parser.add_argument_group("seas")
    seas.add_argument(
        "--fields",
        choices=("all", "real", "synthetic"),
        default="all",
        help="three synthetic ones, and those of the data folder if there is one (%(default)s)",
    )
    seas.add_argument(
        "--data",
        type=Path,
        metavar="DIR",
        help="folder with the real fields (default: HALOCLINE_DATA)",
    )
    seas.add_argument(
        "--field",
        metavar="SPEC",
        help="your own instead: a NetCDF file (ROMS output, CF), or synthetic-patch:7",
    )
    seas.add_argument("--variable", metavar="NAME", help="which variable of the file")
    seas.add_argument(
        "--moving", action="store_true", help="sail --field while its record passes (it stands still)"
    )
    voyages = parser.add_argument_group("voyages")
    voyages.add_argument(
        "--launches", type=whole(1), default=2, metavar="N", help="on each sea (%(default)s)"
    )
    voyages.add_argument(
        "--seeds",
        type=whole(1),
        default=1,
        metavar="N",
        help="of noise and strategies, for each launch (%(default)s)",
    )
    voyages.add_argument(
        "--seed", type=whole(0), default=0, metavar="S", help="the first of them (%(default)s)"
    )
    voyages.add_argument(
        "-L",
        "--sides",
        type=above_zero("a number"),
        metavar="L",
        help=f"budget in multiples of the square root of the water's area ({_SIDES:g})",
    )
    voyages.add_argument(
        "--moving-sides",
        type=above_zero("a number"),
        metavar="L",
        help=f"the same over a sea that moves ({_MOVING_SIDES:g})",
    )
    voyages.add_argument(
        "--budget-km",
        type=above_zero("kilometres"),
        metavar="KM",
        help="budget of every voyage in kilometres instead",
    )
    voyages.add_argument(
        "--quick",
        action="store_true",
        help="two synthetic seas, one launch, short voyages: one or two minutes",
    )
    add_sweep_arguments(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("compare-output"), metavar="DIR", help="(%(default)s)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Sail, compare and report.

    Exit codes: 0 done, 1 the writing failed, 2 usage or a field can't be used; and those of every sweep.
    """
    from sim.experiment.compare import compare
    from sim.field import FieldError

    try:
        plan = _plan(arguments)
        plan.check()
        print(compare(plan, arguments.out, arguments.jobs, arguments.cluster))
    except (FieldError, _UsageError) as error:
        return _failed(error, 2)
    except OSError as error:
        return _failed(error, 1)
    return 0


class _UsageError(ValueError):
    """Arguments that make no sense together."""


def _plan(arguments: argparse.Namespace) -> "Plan":
    from sim.experiment.compare import Plan

    sides, moving_sides, budget_km = arguments.sides, arguments.moving_sides, arguments.budget_km
    if budget_km is not None and not (sides is None and moving_sides is None):
        raise _UsageError("--budget-km, or -L and --moving-sides: give one or the other")
    short = arguments.quick
    seas, notes = _seas(arguments)
    return Plan(
        seas=seas,
        launches=1 if short else arguments.launches,
        seeds=tuple(range(arguments.seed, arguments.seed + arguments.seeds)),
        sides=sides or (_QUICK_SIDES if short else _SIDES),
        moving_sides=moving_sides or (2.0 * _QUICK_SIDES if short else _MOVING_SIDES),
        budget_m=None if budget_km is None else 1000.0 * budget_km,
        notes=notes,
    )


def _seas(arguments: argparse.Namespace) -> "tuple[tuple[SeaChoice, ...], tuple[str, ...]]":
    """What is to be sailed on, and what has to be said about it."""
    from sim.experiment.compare_seas import SYNTHETIC, SeaChoice, real_seas

    field, variable = arguments.field, arguments.variable
    if field is not None:
        name = Path(field).stem + (f", {variable}" if variable else "")
        return (SeaChoice(name, field, variable, arguments.moving),), ()
    if variable is not None or arguments.moving:
        raise _UsageError("--variable and --moving belong to --field")
    if arguments.quick:
        return (SYNTHETIC[0], SYNTHETIC[2]), ("A quick look: two synthetic seas, one launch, short voyages.",)
    synthetic = SYNTHETIC if arguments.fields != "real" else ()
    if arguments.fields == "synthetic":
        return synthetic, ()
    data = arguments.data or os.environ.get("HALOCLINE_DATA")
    if data:
        return (*synthetic, *real_seas(Path(data))), ()
    if arguments.fields == "real":
        raise _UsageError("--fields real: give --data DIR, or set HALOCLINE_DATA")
    return synthetic, (
        "No data folder was given (--data DIR, or HALOCLINE_DATA): only synthetic seas were sailed.",
    )


def _failed(why: object, exit_code: int) -> int:
    print(f"sim experiment compare: {why}", file=sys.stderr)
    return exit_code
