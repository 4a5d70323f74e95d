"""The options of every verb that runs a sweep."""

import argparse


def add_sweep_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare `--jobs N` and `--cluster ADDRESS`: `arguments.jobs` and `arguments.cluster` are for `sweep.run`."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs", type=_count, default=1, metavar="N", help="processes on this machine (%(default)s)"
    )
    where.add_argument("--cluster", metavar="ADDRESS", help="a Dask scheduler instead: tcp://HOST:PORT")


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1, got {text}")
    return int(text)
