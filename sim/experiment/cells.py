"""A sweep's cell: one call of one function with plain arguments, and what came of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Value = bool | int | float | str | np.ndarray[Any, Any]
"""What a cell's function may return under a name: a number, a word, or an array of numbers or truth values."""


@dataclass(frozen=True)
class Cell:
    """One call to be made: `function(arguments)`, which returns a mapping of names to `Value`.

    `name` is for people. `function` is "module:function" and has to be importable wherever cells are computed.
    `arguments` are what JSON knows: everything that the values depend on, a `seed` too where anything is drawn.
    `inputs` are files that the function reads: a sweep begins anew when their content has changed.
    """

    name: str
    function: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Result:
    """A finished cell: its values by name, and where they come from (`sim.experiment.sweep_provenance`)."""

    cell: Cell
    values: Mapping[str, Value]
    provenance: Mapping[str, Any]


class SweepError(Exception):
    """A sweep can't be run, or some of its cells have failed: names them with their arguments."""
