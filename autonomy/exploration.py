"""Algorithm 1 of Ma, Liu & Sukhatme 2017, live: when to re-estimate the hyperparameters and when to re-plan.

The paper runs its algorithm as a loop over path points. Here the same decisions are taken whenever something
has changed: `Exploration.decide` looks at the figures of the moment and says whether it is time.
"""

import math
from dataclasses import dataclass
from enum import Enum

from autonomy.config import ExplorationSection
from autonomy.learning.likelihood import MINIMUM_POINTS

_REPLAN_SHARES = {"route": 1.0 / 7.0}
"""By planner, where nothing is configured: planning anew is measured to pay for `route`, and to cost the others."""


class Trigger(Enum):
    """Why a new plan is wanted; the value is how it is said to a person."""

    FIRST_PLAN = "first plan"
    DAMAGED = "mission on board damaged"
    NOVELTY = "rho exceeded rho0"
    PATH_FINISHED = "path finished"
    OUTGROWN = "the readings have outgrown the model"
    MAXIMUM_INTERVAL = "maximum interval passed"
    FENCE = "the autopilot's fence has changed"
    STALLED = "stalled"
    SAILED = "much sailed since the last plan"
    RESUMED = "the service was away"
    LAND = "land lay before the boat"
    ROOM = "more is left than the way home takes"
    ASHORE = "asked for from ashore"


@dataclass(frozen=True)
class Figures:
    """What the decision looks at.

    Attributes:
        model_time_s: the vehicle's clock.
        basis_size: number of basis vectors.
        capacity: how many there may be.
        fresh: how many of them were added since the mark set by the last plan.
        replaced: how many replacements there were since then.
        path_finished: the mission on board, ours, has been sailed to its end.
        cells: number of cells of the history, of places and times.
        places: number of places of the history, a thirtieth of the survey wide.
        spread: variance of all readings as a multiple of the model's signal variance.
        sailed_share: what was sailed since the last plan was begun, of the longest plan so far.
        planner: which one made the plan being sailed; empty if there is none.
    """

    model_time_s: float
    basis_size: int
    capacity: int
    fresh: int
    replaced: int
    path_finished: bool
    cells: int
    places: int
    spread: float
    sailed_share: float = 0.0
    planner: str = ""


@dataclass(frozen=True)
class Decision:
    """It is time: re-estimate or not, then plan anew, unless no plan could be sailed."""

    trigger: Trigger
    reestimate: bool
    reason: str
    plans: bool = True


class Exploration:
    """The stopping rule of one path: rho, the finished path and the maximum interval."""

    def __init__(self, section: ExplorationSection) -> None:
        self._section = section
        self._last_reestimate_s: float | None = None
        self._last_cells = 0

    def rho(self, figures: Figures) -> float:
        """The paper's rho, in [0, 1].

        `added`: share of the present basis vectors that are new since the last re-estimate (section III-D of the
        paper, in words). `replaced`: the pseudo-code read literally, where only a replacement increases rho.
        """
        if self._section.rho_rule == "replaced":
            return min(1.0, figures.replaced / figures.capacity)
        return figures.fresh / figures.basis_size if figures.basis_size else 0.0

    def decide(self, figures: Figures) -> Decision | None:
        """Whether it is time for a new plan, the strongest reason first; None while the path goes on."""
        section = self._section
        rho = self.rho(figures)
        # With too few cells for a fit nothing would be estimated, and rho would count from nothing again. And a fit to
        # as many cells of a short stretch, which a slow boat soon has, is too sure of what lies beyond it: the cells
        # have to be of so many places. Who wants it sooner (the paper) has it.
        fittable = figures.places >= MINIMUM_POINTS or section.minimum_basis < MINIMUM_POINTS
        grown = figures.basis_size >= section.minimum_basis
        if grown and fittable and rho > section.rho0:
            return Decision(Trigger.NOVELTY, True, f"rho {rho:.2f} > {section.rho0:.2f}")
        if figures.path_finished:
            estimates = section.reestimate_on_path_end and fittable
            return Decision(Trigger.PATH_FINISHED, estimates, Trigger.PATH_FINISHED.value)
        if self._is_outgrown(figures):
            reason = f"the readings vary {figures.spread:.0f} times more than the model allows"
            return Decision(Trigger.OUTGROWN, True, reason)
        if figures.sailed_share > self._replan_share(figures.planner):
            return Decision(
                Trigger.SAILED, False, f"{figures.sailed_share:.0%} of a path sailed".replace("%", " %")
            )
        waited_s = figures.model_time_s - self._since(figures)
        # A smooth field fills the basis slowly, however much has been sailed: its cells tell that there is news.
        # With too few of them for a fit, one would be missed, and the next come an interval later.
        due = fittable and (grown or figures.cells >= section.minimum_basis)
        if section.maximum_interval_s is not None and due and waited_s > section.maximum_interval_s:
            return Decision(Trigger.MAXIMUM_INTERVAL, True, f"{waited_s:.0f} s since the last re-estimate")
        return None

    def reestimated(self, model_time_s: float, cells: int) -> None:
        """A re-estimate was adopted at this model time, when the history had so many cells."""
        self._last_reestimate_s, self._last_cells = model_time_s, cells

    def _is_outgrown(self, figures: Figures) -> bool:
        """Whether the model's scale, guessed from the first readings, is contradicted by those that came since.

        The first readings of a slow boat lie within some metres and hardly vary; a model scaled to them would claim a
        certainty that it has not got. The number of cells must have doubled, so that this stays rare.
        """
        ratio = self._section.outgrown_ratio
        if ratio is None or figures.cells < max(MINIMUM_POINTS, 2 * self._last_cells):
            return False
        return figures.spread > ratio

    def _replan_share(self, planner: str) -> float:
        configured = self._section.replan_share
        return _REPLAN_SHARES.get(planner, math.inf) if configured is None else configured

    def _since(self, figures: Figures) -> float:
        if self._last_reestimate_s is None:
            # The clock starts with the first figures: an interval counts from when there was something to learn.
            self._last_reestimate_s = figures.model_time_s
        return self._last_reestimate_s
