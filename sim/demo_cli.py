"""`sim demo`: a boat that knows nothing about the sea learns it while you watch."""

import argparse
import asyncio
import math
import sys
from pathlib import Path

from sim.demo import DemoError, DemoOptions, run_demo
from sim.field import FieldError

LARGEST_SPEEDUP = 500.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sim demo`."""
    parser.add_argument(
        "--field",
        default="synthetic-patch",
        metavar="SPEC",
        help="NetCDF file (ROMS output, CF) or synthetic-patch[:SEED]; a larger sea is shrunk to 15 km",
    )
    parser.add_argument("--variable", metavar="NAME", help="which variable of the file")
    parser.add_argument(
        "--seconds", type=_positive, default=120.0, metavar="S", help="wall-clock time to sail (120)"
    )
    parser.add_argument(
        "--speedup", type=_speedup, default=LARGEST_SPEEDUP, metavar="N", help="at most 500 (500)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the probe's noise (0)")
    parser.add_argument(
        "--out", type=Path, default=Path("demo-output"), metavar="FOLDER", help="(demo-output)"
    )
    parser.add_argument(
        "--ground-station",
        default="127.0.0.1:14550",
        metavar="HOST:PORT",
        help="where the vessel also sends its MAVLink, so that QGroundControl connects unaided (127.0.0.1:14550)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the demo; exit codes: 0 done, 1 it failed or a leg crossed land, 2 the field can't be used."""
    options = DemoOptions(
        folder=arguments.out,
        spec=arguments.field,
        variable=arguments.variable,
        seconds=arguments.seconds,
        speedup=arguments.speedup,
        seed=arguments.seed,
        ground_station=arguments.ground_station,
    )
    try:
        outcome = asyncio.run(run_demo(options))
    except FieldError as error:
        print(f"sim demo: {error}", file=sys.stderr)
        return 2
    except DemoError as error:
        print(f"sim demo: {error}", file=sys.stderr)
        return 1
    print(f"{outcome}\npicture: {outcome.picture}")
    return 1 if outcome.legs_over_land else 0


def _positive(text: str) -> float:
    value = float(text)
    if not (value > 0.0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"must be positive, got {text}")
    return value


def _speedup(text: str) -> float:
    value = _positive(text)
    if value > LARGEST_SPEEDUP:
        raise argparse.ArgumentTypeError(
            f"at most {LARGEST_SPEEDUP:g}, lest protocols drown in simulated time"
        )
    return value
