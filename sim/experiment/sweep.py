"""Sweeps: many cells on this machine's cores or on a Dask cluster, the finished ones kept."""

from collections.abc import Sequence
from pathlib import Path

from sim.experiment.cells import Cell, Result


def run(
    cells: Sequence[Cell],
    folder: Path,
    jobs: int = 1,
    cluster: str | None = None,
    progress: bool = True,
) -> list[Result]:
    """Compute the cells that `folder` does not hold yet; the results of all, in the cells' order.

    `jobs` processes on this machine, or the workers of the Dask scheduler `cluster` ("tcp://host:8786"). The values
    are the same either way. A cell that fails does not keep the others from being computed. Raises `SweepError`
    in the end if any has failed, or at once if the sweep can't begin.
    """
    raise NotImplementedError
