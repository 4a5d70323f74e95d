"""A comparison from its plan to its files: the sweep's cells, the tables, the pictures, the report."""

from dataclasses import asdict, dataclass
from pathlib import Path

from sim.experiment import compare_report, sweep
from sim.experiment.cells import Cell
from sim.experiment.compare_pictures import pictures
from sim.experiment.compare_seas import SeaChoice, open_sea
from sim.experiment.compare_table import comparisons, cost_table, table, table_by_sea
from sim.experiment.compare_ways import SAILED

_FUNCTION = "sim.experiment.compare_cells:sail"


@dataclass(frozen=True)
class Plan:
    """What is to be sailed: every strategy from `launches` places of every sea with each of `seeds`.

    The budget is `sides` × √(water area), `moving_sides` over a sea that moves, or `budget_m` everywhere if it is not
    None. `notes` are for the report.
    """

    seas: tuple[SeaChoice, ...]
    launches: int
    seeds: tuple[int, ...]
    sides: float
    moving_sides: float
    budget_m: float | None = None
    notes: tuple[str, ...] = ()

    def check(self) -> None:
        """Open every sea once. FieldError if one can't be used, before any time is spent on the others."""
        for sea in self.seas:
            open_sea(sea, *self._budget(sea)).launch(0)

    def cells(self) -> list[Cell]:
        """One for each voyage, sea by sea, so that few workers open many seas."""
        return [
            Cell(
                f"{sea.name}, launch {launch}, seed {seed}, {strategy}",
                _FUNCTION,
                {
                    "sea": asdict(sea),
                    "strategy": strategy,
                    "launch": launch,
                    "seed": seed,
                    "sides": self._budget(sea)[0],
                    "budget_m": self._budget(sea)[1],
                },
                (Path(sea.spec),) if Path(sea.spec).is_file() else (),
            )
            for sea in self.seas
            for launch in range(self.launches)
            for seed in self.seeds
            for strategy in SAILED
        ]

    def _budget(self, sea: SeaChoice) -> tuple[float | None, float | None]:
        if self.budget_m is not None:
            return None, self.budget_m
        return (self.moving_sides if sea.moves else self.sides), None


def compare(plan: Plan, folder: Path, jobs: int = 1, cluster: str | None = None) -> str:
    """Sail what of the plan is not in `folder` yet, and write report, tables and pictures there; the table.

    Raises:
        SweepError: a voyage has failed.
        OSError: something can't be written.
    """
    results = sweep.run(plan.cells(), folder / "cells", jobs, cluster)
    found = comparisons(results)
    told = table(found)
    (folder / "table.md").write_text(told, encoding="utf-8")
    (folder / "seas.md").write_text(table_by_sea(found), encoding="utf-8")
    (folder / "cost.md").write_text(cost_table(found), encoding="utf-8")
    drawn = pictures(results, found)
    for name, (data, _) in drawn.items():
        (folder / f"{name}.png").write_bytes(data)
    compare_report.write(folder / "report.html", results, found, drawn, plan.notes)
    return f"{told}\n{folder / 'report.html'}"
