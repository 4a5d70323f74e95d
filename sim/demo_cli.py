"""`sim demo`: a boat that knows nothing about the sea learns it while you watch."""

import argparse
import asyncio
import signal
import sys
from pathlib import Path

from autonomy.option_types import above_zero, whole
from sim.demo import DemoError, DemoOptions, Outcome, run_demo
from sim.endpoints import Endpoint
from sim.field import FieldError

LARGEST_SPEEDUP = 500.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sim demo`."""
    parser.add_argument(
        "--field",
        default="synthetic-patch",
        metavar="SPEC",
        help="NetCDF file (ROMS output, CF), synthetic-patch[:SEED] or synthetic-moving[:SEED];"
        " a larger sea is shrunk to 15 km",
    )
    parser.add_argument("--variable", metavar="NAME", help="which variable of the file")
    parser.add_argument(
        "--seconds",
        type=above_zero("seconds"),
        default=120.0,
        metavar="S",
        help="wall-clock time to sail (120)",
    )
    parser.add_argument(
        "--speedup", type=_speedup, default=LARGEST_SPEEDUP, metavar="N", help="at most 500 (500)"
    )
    parser.add_argument("--seed", type=whole(0), default=0, help="of the probe's noise (0)")
    parser.add_argument(
        "--out", type=Path, default=Path("demo-output"), metavar="FOLDER", help="(demo-output)"
    )
    parser.add_argument(
        "--ground-station",
        type=_ground_station,
        default="127.0.0.1:14550",
        metavar="HOST:PORT",
        help="where the vessel also sends its MAVLink, so that QGroundControl connects unaided; none for nowhere"
        " (127.0.0.1:14550)",
    )


class _StoppedError(Exception):
    """A signal has ended the demo."""

    def __init__(self, number: signal.Signals) -> None:
        super().__init__(f"stopped by {number.name}")
        self.exit_code = 128 + number


def run(arguments: argparse.Namespace) -> int:
    """Run the demo.

    Exit codes: 0 done, 1 it failed or a leg crossed land, 2 the field or the folder can't be used, 128 and the
    signal's number when a signal ended it (and, first, its processes).
    """
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
        options.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return _failed(f"--out {options.folder}: {error.strerror}", 2)
    try:
        outcome = asyncio.run(_until_signalled(options))
    except FieldError as error:
        return _failed(error, 2)
    except DemoError as error:
        return _failed(error, 1)
    except _StoppedError as stopped:
        return _failed(stopped, stopped.exit_code)
    print(f"{outcome}\npicture: {outcome.picture}")
    return 1 if outcome.legs_over_land else 0


def _failed(why: object, exit_code: int) -> int:
    print(f"sim demo: {why}", file=sys.stderr)
    return exit_code


async def _until_signalled(options: DemoOptions) -> Outcome:
    """The demo; a signal cancels it, and it ends its processes on the way out."""
    demo = asyncio.ensure_future(run_demo(options))
    caught: list[signal.Signals] = []

    def stop(number: signal.Signals) -> None:
        caught.append(number)
        demo.cancel()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, stop, number)
    try:
        return await demo
    except asyncio.CancelledError:
        raise _StoppedError(caught[0]) from None


def _ground_station(text: str) -> str | None:
    if text == "none":
        return None
    try:
        Endpoint.parse(f"udpout:{text}")
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be HOST:PORT or none, got {text}") from None
    return text


def _speedup(text: str) -> float:
    value = above_zero("a number")(text)
    if value > LARGEST_SPEEDUP:
        raise argparse.ArgumentTypeError(
            f"at most {LARGEST_SPEEDUP:g}, lest protocols drown in simulated time"
        )
    return value
