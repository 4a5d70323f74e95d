"""`sim vessel`: the simulated vessel as a process of its own."""

import argparse
import asyncio
import logging
import math
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from autonomy.config import SigningSection
from autonomy.mavlink.signing import KeyFileError, Signing, read_key
from autonomy.option_types import above_zero, finite, not_negative
from sim.autopilot import Autopilot, Options
from sim.endpoints import Endpoint
from sim.field import Field, FieldError, lattice, open_field, shrunk
from sim.instrument import TextPort, line_format
from sim.sensor import Sensor
from sim.server import CannotListenError, VesselServer
from sim.vessel import (
    Battery,
    CurrentField,
    Handling,
    Position,
    SummedCurrent,
    UniformCurrent,
    UnsteadyCurrent,
    Vessel,
)

DEFAULT_ENDPOINT = Endpoint("udpout", "127.0.0.1", 14550)
_T = TypeVar("_T")


class UsageError(ValueError):
    """An argument that is well-formed but makes no sense here."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `sim vessel`."""
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        type=_argument(Endpoint.parse),
        action="append",
        help="udpin:HOST:PORT, udpout:HOST:PORT or tcp:HOST:PORT, repeatable"
        f" (default: {DEFAULT_ENDPOINT}, where ground stations listen)",
    )
    clock = parser.add_argument_group("clock")
    clock.add_argument(
        "--speedup", type=above_zero("a number"), default=1.0, metavar="N", help="simulated seconds a second"
    )
    clock.add_argument(
        "--sitl-timers",
        action="store_true",
        help="run heartbeats, streams and mission timeouts in simulated time, as a real SITL does",
    )
    boat = parser.add_argument_group("boat")
    boat.add_argument(
        "--start",
        type=_argument(_position),
        metavar="LAT,LON",
        help="default: mid-field (--start=-33.9,18.4)",
    )
    boat.add_argument("--home", type=_argument(_position), metavar="LAT,LON", help="default: the start")
    boat.add_argument(
        "--heading", type=finite("degrees"), default=0.0, metavar="DEG", help="at the start, true"
    )
    boat.add_argument(
        "--speed-mps", type=above_zero("metres per second"), default=2.0, metavar="V", help="cruise speed (2)"
    )
    boat.add_argument(
        "--turn-rate",
        type=above_zero("degrees per second"),
        default=20.0,
        metavar="DEG_S",
        help="at most (20 deg/s)",
    )
    boat.add_argument(
        "--waypoint-radius-m", type=above_zero("metres"), default=2.0, metavar="R", help="WP_RADIUS (2)"
    )
    boat.add_argument(
        "--current",
        type=_argument(_pair),
        default=(0.0, 0.0),
        metavar="EAST,NORTH",
        help="m/s, on top of the current that the field itself may have (--current=-0.2,0.1)",
    )
    boat.add_argument(
        "--current-noise",
        type=not_negative("metres per second"),
        default=0.0,
        metavar="MPS",
        help="by which it swings, over hours",
    )
    boat.add_argument(
        "--battery-wh", type=above_zero("watt-hours"), default=5000.0, metavar="WH", help="capacity (5000)"
    )
    boat.add_argument(
        "--battery-noise",
        type=not_negative("a share"),
        default=0.0,
        metavar="SHARE",
        help="by which its power swings, over minutes (0)",
    )
    sea = parser.add_argument_group("sea and instrument")
    sea.add_argument(
        "--field",
        default="synthetic-patch",
        metavar="SPEC",
        help="synthetic[:SEED], synthetic-patch[:SEED], synthetic-moving[:SEED] or a NetCDF file"
        " (default: synthetic-patch)",
    )
    sea.add_argument("--variable", metavar="NAME", help="which variable of the file")
    sea.add_argument(
        "--shrink-to-m", type=above_zero("metres"), metavar="M", help="shrink a larger field to this size"
    )
    sea.add_argument("--sensor-name", default="SALT", metavar="NAME", help="of NAMED_VALUE_FLOAT (SALT)")
    sea.add_argument(
        "--sample-interval-s", type=above_zero("seconds"), default=1.0, metavar="S", help="simulated (1)"
    )
    sea.add_argument(
        "--noise",
        type=not_negative("a standard deviation"),
        default=0.0,
        metavar="STD",
        help="standard deviation of a reading",
    )
    sea.add_argument("--seed", type=int, default=0, help="of the noise")
    sea.add_argument(
        "--instrument",
        metavar="ENDPOINT",
        type=_argument(Endpoint.parse),
        help="the instrument has a port of its own, and writes lines of text there, not MAVLink: udpout:HOST:PORT, or "
        "tcp:HOST:PORT as a serial server does; see autonomy bridge",
    )
    sea.add_argument(
        "--line",
        metavar="FORMAT",
        type=_argument(line_format),
        default="{value:.4f}",
        help="what such a line looks like ({value:.4f})",
    )
    autopilot = parser.add_argument_group("autopilot")
    autopilot.add_argument("--sysid", type=int, default=1, metavar="ID", help="MAVLink system id (1)")
    autopilot.add_argument(
        "--ready-after-s",
        type=finite("seconds"),
        default=0.0,
        metavar="S",
        help="position estimate, simulated (0)",
    )
    autopilot.add_argument("--arming-checks", action="store_true", help="refuse to arm before that")
    autopilot.add_argument(
        "--request-int", action="store_true", help="ask for mission items with MISSION_REQUEST_INT"
    )
    autopilot.add_argument(
        "--boot-clock-s",
        type=finite("seconds"),
        default=0.0,
        metavar="S",
        help="shown by its clock at power-on (0)",
    )
    autopilot.add_argument(
        "--reboot-after-s",
        type=above_zero("seconds"),
        metavar="S",
        help="start again in mid-mission, simulated (never)",
    )
    autopilot.add_argument(
        "--probe-component", type=int, metavar="ID", help="the instrument is a component of its own"
    )
    autopilot.add_argument("--without-fence", action="store_true", help="fence and rally points are not told")
    autopilot.add_argument(
        "--deaf-to-set-current",
        type=int,
        default=0,
        metavar="N",
        help="accept the first N and do nothing (0)",
    )
    autopilot.add_argument(
        "--by-the-book",
        action="store_true",
        help="uploads as in the MAVLink guide: atomic, ended by an item out of turn, sailed from the first item",
    )
    autopilot.add_argument(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="hear only what is signed with the key in this file, and sign what is said",
    )
    autopilot.add_argument(
        "--signing-form",
        choices=("passphrase", "key"),
        default="passphrase",
        help="what the file holds: a passphrase, whose SHA-256 is the key, or the key itself",
    )
    autopilot.add_argument("--verbose", action="store_true", help="log clients and socket errors")


def run(arguments: argparse.Namespace) -> int:
    """Run the vessel until SIGTERM or SIGINT; exit codes: 0 stopped, 2 usage or an endpoint is taken."""
    logging.basicConfig(
        stream=sys.stderr,
        level=logging.DEBUG if arguments.verbose else logging.WARNING,
        format="sim vessel: %(message)s",
    )
    try:
        field = open_field(arguments.field, arguments.variable)
        if arguments.shrink_to_m is not None:
            field = shrunk(field, arguments.shrink_to_m)
        autopilot = _autopilot(arguments, field)
        asyncio.run(_serve(arguments, autopilot, _signing(arguments)))
    except CannotListenError as error:
        print(f"sim vessel: cannot open {error}", file=sys.stderr)
        return 2
    except (FieldError, KeyFileError, UsageError) as error:
        print(f"sim vessel: {error}", file=sys.stderr)
        return 2
    return 0


def _signing(arguments: argparse.Namespace) -> Signing | None:
    key = read_key(SigningSection(key_file=arguments.signing_key, form=arguments.signing_form), os.environ)
    return None if key is None else Signing(key, time.time)


async def _serve(arguments: argparse.Namespace, autopilot: Autopilot, signing: Signing | None) -> None:
    server = VesselServer(
        autopilot,
        arguments.listen or [DEFAULT_ENDPOINT],
        speedup=arguments.speedup,
        sitl_timers=arguments.sitl_timers,
        signing=signing,
    )
    loop = asyncio.get_running_loop()
    for each in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(each, server.stop)
    port = None if arguments.instrument is None else TextPort(arguments.instrument, arguments.line)
    await server.start()
    try:
        if port is not None:
            await _open_port(port, autopilot, arguments.instrument)
        places = ", ".join(map(str, server.endpoints))
        print(f"sim vessel: ready on {places} at speed-up {arguments.speedup:g}", flush=True)
        await server.run()
    finally:
        server.close()
        if port is not None:
            port.close()


async def _open_port(port: TextPort, autopilot: Autopilot, endpoint: Endpoint) -> None:
    """The instrument's own port. Raises CannotListenError."""
    try:
        await port.open()
    except OSError as error:
        raise CannotListenError(f"{endpoint}: {error.strerror or error}") from error
    assert autopilot.sensor is not None
    autopilot.sensor.says = port.say


def _autopilot(arguments: argparse.Namespace, field: Field) -> Autopilot:
    start = arguments.start or _middle_of(field)
    if bool(field.is_land(*start)):
        raise UsageError(f"--start {start.lat_deg:.6f},{start.lon_deg:.6f} is on land")
    bounds = field.bounds
    if not (bounds.south <= start.lat_deg <= bounds.north and bounds.west <= start.lon_deg <= bounds.east):
        raise UsageError(
            f"--start {start.lat_deg:.6f},{start.lon_deg:.6f} lies outside the field:"
            f" latitude {bounds.south:.4f} to {bounds.north:.4f},"
            f" longitude {bounds.west:.4f} to {bounds.east:.4f}"
        )
    epoch = field.info.start_utc
    try:
        vessel = Vessel(
            start,
            heading_deg=arguments.heading % 360.0,
            handling=Handling(turn_rate_deg_s=arguments.turn_rate),
            current=SummedCurrent((field, _current(arguments))),
            land=field,
            # Whatever its cruise speed, the boat is built to cruise on 120 W.
            battery=Battery(
                arguments.battery_wh,
                propulsion_w_per_m3s3=120.0 / arguments.speed_mps**3,
                noise=arguments.battery_noise,
                rng=np.random.default_rng((arguments.seed, 1)),
            ),
        )
        sensor = Sensor(
            field,
            np.random.default_rng(arguments.seed),
            arguments.sensor_name,
            arguments.sample_interval_s,
            arguments.noise,
        )
        options = Options(
            system_id=arguments.sysid,
            speed_mps=arguments.speed_mps,
            waypoint_radius_m=arguments.waypoint_radius_m,
            start_utc_s=time.time() if epoch is None else epoch.timestamp(),
            ready_after_s=arguments.ready_after_s,
            arming_checks=arguments.arming_checks,
            request_int=arguments.request_int or arguments.by_the_book,
            boot_clock_s=arguments.boot_clock_s,
            reboots_after_s=arguments.reboot_after_s,
            ends_on_wrong_item=arguments.by_the_book,
            atomic_uploads=arguments.by_the_book,
            restarts_on_upload=arguments.by_the_book,
            deaf_to_set_current=arguments.deaf_to_set_current,
            tells_fence=not arguments.without_fence,
            probe_component=arguments.probe_component,
        )
    except ValueError as error:
        raise UsageError(str(error)) from error
    return Autopilot(vessel, sensor, options, home=arguments.home)


def _current(arguments: argparse.Namespace) -> CurrentField:
    if arguments.current_noise == 0.0:
        return UniformCurrent(*arguments.current)
    rng = np.random.default_rng((arguments.seed, 2))
    return UnsteadyCurrent.draw(arguments.current, arguments.current_noise, rng)


def _middle_of(field: Field) -> Position:
    """The place with water that is nearest to the middle of the field, on a coarse lattice."""
    bounds = field.bounds
    lat, lon = lattice(field, max(*bounds.size_m) / 40.0)
    water = np.isfinite(field.grid(lat, lon, 0.0)) & ~field.is_land(*np.meshgrid(lat, lon, indexing="ij"))
    if not water.any():
        raise UsageError("the field has no water to start in; give --start LAT,LON")
    rows, columns = np.nonzero(water)
    middle = Position(0.5 * (bounds.south + bounds.north), 0.5 * (bounds.west + bounds.east))
    places = [
        Position(float(lat[row]), float(lon[column])) for row, column in zip(rows, columns, strict=True)
    ]
    return min(places, key=middle.distance_to)


def _argument(parse: Callable[[str], _T]) -> Callable[[str], _T]:
    """A parser whose ValueErrors argparse shows in full."""

    def checked(text: str) -> _T:
        try:
            return parse(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return checked


def _pair(text: str) -> tuple[float, float]:
    parts = text.split(",")
    if len(parts) != 2:
        raise ValueError(f"two numbers with a comma between them, not {text!r}")
    first, second = map(float, parts)
    if not (math.isfinite(first) and math.isfinite(second)):
        raise ValueError(f"{text!r} is not finite")
    return first, second


def _position(text: str) -> Position:
    lat, lon = _pair(text)
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        raise ValueError(f"{text!r} is no LAT,LON in degrees")
    return Position(lat, lon)
