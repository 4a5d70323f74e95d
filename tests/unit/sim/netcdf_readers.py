"""Readers that behave as a library does with damaged files; in a module of their own, for the guard's children."""

import os
from pathlib import Path

from sim.field import FieldError


def hangs(path: Path, variable: str | None) -> None:
    while True:
        pass


def crashes(path: Path, variable: str | None) -> None:
    os.abort()


def hoards(path: Path, variable: str | None) -> None:
    bytearray(2**33)


def refuses(path: Path, variable: str | None) -> None:
    raise FieldError(f"{path}: no {variable}")


def counts(path: Path, variable: str | None) -> None:
    with path.with_suffix(".count").open("a") as file:
        file.write("x")
