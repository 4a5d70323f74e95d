"""The options that say how the vehicles are reached: the same for every verb that follows them."""

import argparse
import os
from pathlib import Path

from autonomy.config.private import PrivateFileError, read_private
from autonomy.endpoints import Certificates, check_endpoint, is_encrypted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --listen or --connect, one of which must be given, and the certificates."""
    way = parser.add_mutually_exclusive_group(required=True)
    way.add_argument(
        "--listen",
        action="append",
        type=_endpoint,
        metavar="ADDRESS",
        help="be the router the vehicles dial, at this address, e.g. tcp/0.0.0.0:7447",
    )
    way.add_argument(
        "--connect",
        action="append",
        type=_endpoint,
        metavar="ADDRESS",
        help="be a client of that router",
    )
    tls = parser.add_argument_group("certificates, for addresses that begin with tls/ or quic/ (PEM files)")
    tls.add_argument("--ca", type=Path, metavar="FILE", help="of the authority that the others' come from")
    tls.add_argument("--certificate", type=Path, metavar="FILE", help="our own; who listens needs one")
    tls.add_argument("--key", type=Path, metavar="FILE", help="its private key; only its owner may read it")


def certificates(args: argparse.Namespace) -> Certificates:
    """What the arguments name; ValueError if it can't serve."""
    if (args.certificate is None) != (args.key is None):
        raise ValueError("--certificate and --key belong together")
    if args.listen and any(map(is_encrypted, args.listen)) and (args.certificate is None or args.ca is None):
        raise ValueError("to listen with tls/ or quic/ needs --ca, --certificate and --key")
    for option, file in (("--ca", args.ca), ("--certificate", args.certificate)):
        if file is not None and not os.access(file, os.R_OK):
            raise ValueError(f"{option}: no readable file {str(file)!a}")
    if args.key is not None:
        try:
            read_private(args.key, os.environ)
        except PrivateFileError as error:
            raise ValueError(f"--key: {error}") from None
    return Certificates(args.ca, args.certificate, args.key)


def _endpoint(text: str) -> str:
    try:
        return check_endpoint(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
