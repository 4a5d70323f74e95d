"""`autonomy bridge`: an instrument's lines as MAVLink readings."""

import argparse
import asyncio
import faulthandler
import logging
import os
import sys
from functools import partial
from pathlib import Path

from autonomy import __version__
from autonomy.bridge.configuration import BridgeConfiguration, load_bridge
from autonomy.commands.configuration import tell
from autonomy.commands.run import EXIT_SOFTWARE, log_to_stderr
from autonomy.config import ConfigurationError
from autonomy.option_types import above_zero, whole

EXIT_NOTHING_READ = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("config", metavar="CONFIG", help="configuration of the bridge in YAML")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--check",
        nargs="?",
        const="",
        metavar="FILE",
        help="read a few lines, from the instrument or a file, print what would be sent, and end; no vehicle is needed",
    )
    what.add_argument(
        "--replay",
        metavar="FILE",
        help="send the lines of a recording, or of any text file",
    )
    parser.add_argument(
        "--every",
        type=above_zero("seconds"),
        default=1.0,
        metavar="S",
        help="seconds from line to line of a file that does not tell when they came (%(default)g)",
    )
    parser.add_argument(
        "--lines", type=whole(1), default=10, metavar="N", help="with --check: how many lines (%(default)d)"
    )
    parser.add_argument(
        "--seconds",
        type=above_zero("seconds"),
        default=30.0,
        metavar="S",
        help="with --check: how long the instrument is waited for (%(default)g)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run until SIGTERM; exit codes: 0 stopped, 1 --check read nothing, 2 usage, 70 a bug of ours, 78 configuration."""
    try:
        configuration = load_bridge(arguments.config)
    except ConfigurationError as error:
        return tell(error)
    file = arguments.check or arguments.replay
    if file and not (Path(file).is_file() and os.access(file, os.R_OK)):
        sys.stderr.write(f"autonomy bridge: no readable file {file!a}\n")
        return 2
    log_to_stderr(configuration.logging.level)
    if arguments.check is not None:
        return _check(configuration, arguments)
    return _run(configuration, arguments)


def _check(configuration: BridgeConfiguration, arguments: argparse.Namespace) -> int:
    from autonomy.bridge.check import check_file, check_instrument
    from autonomy.bridge.recorded import RecordingError

    try:
        if arguments.check:
            read = check_file(configuration, Path(arguments.check), arguments.every, arguments.lines)
        else:
            read = asyncio.run(check_instrument(configuration, arguments.lines, arguments.seconds))
    except (OSError, RecordingError) as error:
        sys.stderr.write(f"autonomy bridge: {arguments.check}: {error}\n")
        return 2
    return 0 if read else EXIT_NOTHING_READ


def _run(configuration: BridgeConfiguration, arguments: argparse.Namespace) -> int:
    from autonomy.bridge.daemon import BridgeDaemon
    from autonomy.bridge.recorded import RecordingError, play, read_recorded
    from autonomy.bridge.start import open_raw_log, open_signing

    # The hung line is what one wants to know when the watchdog strikes with SIGABRT.
    faulthandler.enable()
    log = logging.getLogger("autonomy.bridge")
    signed_link = open_signing(configuration, os.environ)
    source = None
    if arguments.replay:
        source = partial(play, read_recorded(Path(arguments.replay), arguments.every))
    raw = None if source is not None else open_raw_log(configuration, os.environ, __version__)
    try:
        asyncio.run(BridgeDaemon(configuration, raw, signed_link, source).run())
    except RecordingError as error:
        log.error("%s: %s", arguments.replay, error)
        return 2
    except Exception:
        log.exception("the bridge ends over an error of its own")
        return EXIT_SOFTWARE
    return 0
