"""`autonomy shore serve`: a page with the maps of all vehicles, for browsers."""

import argparse
import asyncio
import ipaddress
import re
import sys
from pathlib import Path

from autonomy.config.private import PrivateFileError
from autonomy.shore import way

EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2
LOOPBACK = ("localhost", "127.0.0.1", "::1")
_ADDRESS = re.compile(r"(?:\[(?P<ip6>[0-9A-Fa-f:.]+)\]|(?P<host>[^\s:/\[\]]+)):(?P<port>\d{1,5})")
_NAME = re.compile(r"[0-9A-Za-z.:-]{1,253}")
_EXTRA = ("aiohttp", "cmocean", "matplotlib")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    way.add_arguments(parser)
    parser.add_argument(
        "--http",
        type=_address,
        default=("127.0.0.1", 8080),
        metavar="HOST:PORT",
        help="where browsers find the page (127.0.0.1:8080)",
    )
    parser.add_argument(
        "--host",
        action="append",
        type=_name,
        default=[],
        metavar="NAME",
        help="a name by which browsers may call us, besides this machine's own: that of a proxy before us",
    )
    reading = parser.add_mutually_exclusive_group()
    reading.add_argument(
        "--token",
        type=Path,
        metavar="FILE",
        help="ask for the token in this file; only its owner may read it",
    )
    reading.add_argument(
        "--without-token",
        action="store_true",
        help="let everybody read who can reach the address, also where it is not this machine's alone",
    )
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FOLDER",
        help="keep all that comes in, and show what is there from earlier",
    )
    parser.add_argument(
        "--history", type=Path, metavar="FOLDER", help="show what this recording holds from earlier"
    )


def run(args: argparse.Namespace) -> int:
    """Serve until told to stop: 0; 1 if an address or a folder can't be had, or following failed; 2 for bad usage."""
    try:
        # Only who serves needs what these need.
        from autonomy.shore.recording import RecordingError
        from autonomy.shore.server.access import read_token
        from autonomy.shore.server.service import FollowingError, Settings, serve
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in _EXTRA:
            raise
        return _complain(EXIT_USAGE, f"needs {error.name}: pip install 'halocline[shore]'")
    host, port = args.http
    if args.token is None and not (args.without_token or _is_loopback(host)):
        return _complain(
            EXIT_USAGE,
            f"--http {host}: others can reach it; ask them for a --token, or let them read --without-token",
        )
    try:
        settings = Settings(
            host=host,
            port=port,
            names=(*LOOPBACK, *args.host) if args.host or _is_loopback(host) else None,
            connect=args.connect or (),
            listen=args.listen or (),
            certificates=way.certificates(args),
            token=None if args.token is None else read_token(args.token),
            record=args.record,
            history=args.history,
        )
    except PrivateFileError as error:
        return _complain(EXIT_USAGE, f"--token: {error}")
    except ValueError as error:
        return _complain(EXIT_USAGE, str(error))
    try:
        asyncio.run(serve(settings))
    except (OSError, RecordingError, FollowingError) as error:
        return _complain(EXIT_FAILED, str(error))
    return EXIT_OK


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _address(text: str) -> tuple[str, int]:
    match = _ADDRESS.fullmatch(text)
    if match is None or int(match["port"]) > 65535:
        raise argparse.ArgumentTypeError(f"must be HOST:PORT, such as 127.0.0.1:8080 (got {text!r})")
    return match["ip6"] or match["host"], int(match["port"])


def _name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"must be the name of a machine (got {text!r})")
    return text.lower()


def _complain(code: int, text: str) -> int:
    print(f"autonomy shore serve: {text}", file=sys.stderr, flush=True)
    return code
