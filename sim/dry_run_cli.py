"""`sim dry-run`: the whole mission at the desk, with the boat's own configuration."""

import argparse
import json
import math
import sys
import time
from pathlib import Path

import tqdm

from autonomy.commands.configuration import add_override_argument, doubts, load_with_survey, tell
from autonomy.commands.places import launch_m, place
from autonomy.config import ConfigurationError
from autonomy.option_types import above_zero, share, whole
from sim.currents import TidalCurrent
from sim.field import FieldError
from sim.rehearsal.values import DryRunError, Wishes

EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_NO_OUTPUT = 73
"""EX_CANTCREAT of sysexits.h."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sim dry-run`."""
    parser.add_argument("config", metavar="CONFIG", help="the boat's configuration in YAML")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("dry-run"),
        metavar="FOLDER",
        help="for dry-run.png and dry-run.json (dry-run)",
    )
    parser.add_argument("--json", action="store_true", help="print what dry-run.json holds, and nothing else")
    parser.add_argument(
        "--start",
        type=place,
        metavar="LAT,LON",
        help="where the boat lies; without it at budget.home, or in the south-west of the water (--start=-33.5,18.4)",
    )
    parser.add_argument(
        "--hours",
        type=above_zero("hours"),
        metavar="H",
        help="end the run after so many; without it the budget ends it",
    )
    sea = parser.add_argument_group("sea")
    sea.add_argument(
        "--field",
        metavar="SPEC",
        help="a NetCDF file, or another field of the simulator, that holds the survey (a sea made up for it)",
    )
    sea.add_argument("--variable", metavar="NAME", help="which variable of the file")
    sea.add_argument(
        "--patch-km",
        type=above_zero("kilometres"),
        metavar="KM",
        help="length-scale of the sea that is made up (model.hyperparameters, or a quarter of the area's side)",
    )
    sea.add_argument(
        "--noise",
        type=above_zero("a standard deviation"),
        metavar="STD",
        help="of a reading, in the sensor's unit (a twentieth of the field's)",
    )
    sea.add_argument("--seed", type=whole(0), default=0, metavar="N", help="of sea, noise and battery (0)")
    sea.add_argument(
        "--current", type=_current, default=(0.0, 0.0), metavar="EAST,NORTH", help="m/s (--current=-0.2,0.1)"
    )
    sea.add_argument(
        "--tide",
        type=_tide,
        metavar="MPS,DEG",
        help="a tide of this speed that runs this way first, and back six hours later",
    )
    battery = parser.add_argument_group("battery")
    battery.add_argument(
        "--battery-wh", type=above_zero("watt-hours"), metavar="WH", help="capacity (budget.energy_wh)"
    )
    battery.add_argument(
        "--consumption",
        type=above_zero("joules per metre"),
        metavar="J_PER_M",
        help="what the boat really needs in still water (budget.consumption_j_per_m)",
    )
    battery.add_argument(
        "--battery-noise",
        type=share,
        default=0.1,
        metavar="SHARE",
        help="by which wind and waves make its power swing (0.1)",
    )
    add_override_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Sail and tell.

    Exit codes: 0 the mission would succeed (there may be warnings), 1 it would not, 2 usage or the field can't be
    used, 73 a file can't be written, 78 configuration.
    """
    try:
        loaded, survey = load_with_survey(arguments.config, arguments.overrides)
    except ConfigurationError as error:
        return tell(error)
    configuration, begun_s = loaded.configuration, time.perf_counter()
    wishes = Wishes(
        start_m=launch_m(configuration, survey, arguments.start),
        spec=arguments.field,
        variable=arguments.variable,
        patch_m=None if arguments.patch_km is None else 1e3 * arguments.patch_km,
        noise=arguments.noise,
        seed=arguments.seed,
        hours=arguments.hours,
        current_mps=arguments.current,
        tide=arguments.tide,
        battery_wh=arguments.battery_wh,
        consumption_j_per_m=arguments.consumption,
        battery_noise=arguments.battery_noise,
    )
    # Only now: it takes a while to import, and a wrong configuration is told before.
    from sim.rehearsal.doubts import doubts_of
    from sim.rehearsal.outcome import Outcome
    from sim.rehearsal.report import draw, plain, told
    from sim.rehearsal.run import sail

    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
        with tqdm.tqdm(disable=None, bar_format="{desc}", leave=False) as bar:
            sailed = sail(
                configuration,
                survey,
                wishes,
                lambda km, hours: bar.set_description_str(f"{km:.1f} km, {hours:.1f} h"),
            )
        outcome = Outcome(configuration, survey, wishes, sailed)
        content = json.dumps(plain(outcome), indent=1, allow_nan=False) + "\n"
        (arguments.out / "dry-run.json").write_text(content, encoding="utf-8")
        draw(outcome, arguments.out / "dry-run.png")
    except FieldError as error:
        return _failed(error, EXIT_USAGE)
    except DryRunError as error:
        return _failed(error, EXIT_FAILED)
    except OSError as error:
        return _failed(f"{error.filename}: {error.strerror}", EXIT_NO_OUTPUT)
    if arguments.json:
        sys.stdout.write(content)
        return 0 if outcome.succeeded else EXIT_FAILED
    sys.stdout.write("\n".join(told(outcome)) + "\n")
    sys.stdout.write(
        f"computed   in {time.perf_counter() - begun_s:.0f} s: {arguments.out / 'dry-run.png'}\n"
    )
    for text in doubts(loaded, survey):
        sys.stderr.write(f"warning: {text}\n")
    for doubt in doubts_of(outcome):
        sys.stderr.write(f"warning: {doubt.kind}: {doubt.text}\n")
    return 0 if outcome.succeeded else EXIT_FAILED


def _failed(why: object, code: int) -> int:
    sys.stderr.write(f"sim dry-run: {why}\n")
    return code


def _pair(text: str, form: str) -> tuple[float, float]:
    try:
        first, second = map(float, text.split(","))
    except ValueError:
        first = second = math.nan
    if not (math.isfinite(first) and math.isfinite(second)):
        raise argparse.ArgumentTypeError(f"must be {form} (got {text!r})")
    return first, second


def _current(text: str) -> tuple[float, float]:
    return _pair(text, "EAST,NORTH in m/s")


def _tide(text: str) -> TidalCurrent:
    speed_mps, towards_deg = _pair(text, "MPS,DEG: a speed and a direction")
    return TidalCurrent(speed_mps, towards_deg)
