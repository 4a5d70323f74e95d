"""All that came of a voyage over a known field."""

from dataclasses import dataclass
from typing import Literal

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Kernel
from autonomy.planning.plan import Plan

Occasion = Literal["under way", "before re-estimate", "after re-estimate"]


@dataclass(frozen=True, eq=False)
class Samples:
    """What taught the model, in order: `time_s` (n,) of the vessel, `points_m` (n, 2), `values` (n,)."""

    time_s: FloatArray
    points_m: FloatArray
    values: FloatArray

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True, eq=False)
class Judgement:
    """The belief held against the truth over the water, after so many samples and metres.

    `rho` is the paper's; `model` is kept if the orders say so.
    """

    occasion: Occasion
    samples: int
    distance_m: float
    time_s: float
    rmse: float
    rho: float
    basis_size: int
    model: FieldModel | None = None


@dataclass(frozen=True, eq=False)
class Replan:
    """A plan as the planner made it; `rho` is that of the decision, `model` what was planned with."""

    samples: int
    distance_m: float
    time_s: float
    rho: float
    plan: Plan
    model: FieldModel | None = None


@dataclass(frozen=True, eq=False)
class Reestimation:
    """A re-estimate: the kernel that the model was rebuilt under, from how many points; `kept`: the fit found none."""

    samples: int
    kernel: Kernel
    points: int
    kept: bool


@dataclass(frozen=True)
class Cost:
    """CPU seconds: of the core, the learner's updates among them, and of its jobs."""

    core_s: float
    jobs_s: float


@dataclass(frozen=True, eq=False)
class Voyage:
    """All that came of a voyage.

    Attributes:
        samples: what taught the model.
        track_m: shape (k, 2), where the probe was read, samples or not.
        distance_m: sailed from the launch on.
        plans: in the order in which they were made.
        reestimates: the same.
        judgements: the same; `curve` are those at equal parts of the voyage.
        model: what is believed at the end.
        field_std: standard deviation of the truth over the water at the end.
        refused: how many readings at the samples' spacing were too bad to teach.
        log: lines of the core's log.
        cost: what it took; the one thing here that another run does not give again.
    """

    samples: Samples
    track_m: FloatArray
    distance_m: float
    plans: tuple[Replan, ...]
    reestimates: tuple[Reestimation, ...]
    judgements: tuple[Judgement, ...]
    model: FieldModel
    field_std: float
    refused: int
    log: tuple[str, ...]
    cost: Cost

    @property
    def curve(self) -> tuple[Judgement, ...]:
        """The judgements at equal parts of the voyage."""
        return tuple(each for each in self.judgements if each.occasion == "under way")
