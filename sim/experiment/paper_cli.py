"""`sim experiment paper`: the figures of Ma, Liu & Sukhatme 2017 on a field of your choice."""

import argparse
import sys
from pathlib import Path
from time import monotonic

from autonomy.option_types import whole
from sim.experiment.paper_numbers import ABLATIONS, SAMPLES, THRESHOLDS
from sim.experiment.sweep_options import add_sweep_arguments

_FEWEST_SAMPLES = 200
"""A model takes fifty, and thirds of a run want something in them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sim experiment paper`."""
    parser.add_argument(
        "--field",
        default="synthetic",
        metavar="SPEC",
        help="NetCDF file (ROMS output, CF), or synthetic[:SEED]: the Southern California Bight (%(default)s)",
    )
    parser.add_argument("--variable", metavar="NAME", help="which variable of the file")
    parser.add_argument(
        "--seed", type=whole(0), default=0, metavar="N", help="of noise and tours (%(default)s)"
    )
    parser.add_argument(
        "--seeds", type=whole(1), default=1, metavar="K", help="so many voyages of each setting (%(default)s)"
    )
    parser.add_argument(
        "--samples",
        type=whole(_FEWEST_SAMPLES),
        default=SAMPLES,
        metavar="N",
        help="length of a voyage (%(default)s)",
    )
    parser.add_argument(
        "--rho0",
        type=_thresholds,
        default=THRESHOLDS,
        metavar="LIST",
        help="thresholds, such as 0.2,0.6 (0.1 to 1.0 by tenths)",
    )
    parser.add_argument(
        "--ablation",
        action="append",
        default=[],
        choices=ABLATIONS,
        help="readings at the spots only; rho counts replacements only; no mean is taken off; nothing known before",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("paper-output"), metavar="FOLDER", help="(%(default)s)"
    )
    add_sweep_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the experiment; exit codes: 0 done, 1 a voyage failed, 2 the field or the folder can't be used."""
    from sim.experiment.cells import SweepError
    from sim.experiment.paper import Options, run_paper
    from sim.experiment.paper_report import falling, thirds_table, verdict
    from sim.field import FieldError

    begun_s = monotonic()
    options = Options(
        out=arguments.out,
        field=arguments.field,
        variable=arguments.variable,
        seed=arguments.seed,
        seeds=arguments.seeds,
        samples=arguments.samples,
        thresholds=arguments.rho0,
        ablations=tuple(sorted(set(arguments.ablation))),
        jobs=arguments.jobs,
        cluster=arguments.cluster,
    )
    try:
        outcome = run_paper(options)
    except SweepError as error:
        return _failed(error, 1)
    except FieldError as error:
        return _failed(error, 2)
    except OSError as error:
        return _failed(f"--out {arguments.out}: {error}", 2)
    print("\n\n".join([thirds_table(outcome.courses), falling(outcome.courses), *verdict(outcome.courses)]))
    print(f"\n{outcome.report} and its figures, after {monotonic() - begun_s:.0f} s")
    return 0


def _failed(why: object, code: int) -> int:
    print(f"sim experiment paper: {why}", file=sys.stderr)
    return code


def _thresholds(text: str) -> tuple[float, ...]:
    try:
        found = tuple(sorted({float(part) for part in text.split(",")}))
    except ValueError:
        found = ()
    if not found or not all(0.0 < each <= 1.0 for each in found):
        raise argparse.ArgumentTypeError(
            f"must be numbers above 0 and up to 1, separated by commas, got {text}"
        )
    return found
