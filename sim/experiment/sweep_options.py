"""The options of every verb that runs a sweep."""

import argparse

from autonomy.option_types import whole


def add_sweep_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare `--jobs N` and `--cluster ADDRESS`: `arguments.jobs` and `arguments.cluster` are for `sweep.run`."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs", type=whole(1), default=1, metavar="N", help="processes on this machine (%(default)s)"
    )
    where.add_argument("--cluster", metavar="ADDRESS", help="a Dask scheduler instead: tcp://HOST:PORT")
