"""`autonomy shore serve`: a page with the maps of all vehicles, for browsers."""

import argparse
import asyncio
import re
import sys

from autonomy.shore import way

EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2
_ADDRESS = re.compile(r"(?:\[(?P<ip6>[0-9A-Fa-f:.]+)\]|(?P<host>[^\s:/\[\]]+)):(?P<port>\d{1,5})")
_EXTRA = ("aiohttp", "cmocean", "matplotlib")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    way.add_arguments(parser)
    parser.add_argument(
        "--http",
        type=_address,
        default=("127.0.0.1", 8080),
        metavar="HOST:PORT",
        help="where browsers find the page (default 127.0.0.1:8080)",
    )


def run(args: argparse.Namespace) -> int:
    """Serve until told to stop: 0; 1 if an address is taken; 2 for bad usage."""
    try:
        certificates = way.certificates(args)
        from autonomy.shore.server import service
    except ValueError as error:
        return _complain(EXIT_USAGE, str(error))
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in _EXTRA:
            raise
        return _complain(EXIT_USAGE, f"needs {error.name}: pip install 'halocline[shore]'")
    try:
        asyncio.run(service.serve(args.http, args.connect or (), args.listen or (), certificates))
    except OSError as error:
        return _complain(EXIT_FAILED, str(error))
    return EXIT_OK


def _address(text: str) -> tuple[str, int]:
    match = _ADDRESS.fullmatch(text)
    if match is None or int(match["port"]) > 65535:
        raise argparse.ArgumentTypeError(f"must be HOST:PORT, such as 127.0.0.1:8080 (got {text!r})")
    return match["ip6"] or match["host"], int(match["port"])


def _complain(code: int, text: str) -> int:
    print(f"autonomy shore serve: {text}", file=sys.stderr, flush=True)
    return code
