"""Sections about the model and how its hyperparameters are estimated."""

from collections.abc import Iterator
from typing import Annotated, Literal, get_args

from pydantic import Field

from autonomy.config.sections.section import Conflict, Section
from autonomy.config.types import Positive

LEAST_CHOSEN_CAPACITY = 50
"""Fewer basis vectors are never chosen where `model.capacity` leaves the choice."""

LARGEST_CAPACITY = 300
"""Above this the exact process is within some percent."""

Candidate = Literal[
    "squared_exponential",
    "squared_exponential_ard",
    "matern32",
    "long_short",
    "ou",
    "smooth_motion",
    "static_moving",
    "static_smooth_motion",
]
_MOVING: tuple[Candidate, ...] = ("ou", "smooth_motion", "static_moving", "static_smooth_motion")


class HyperparametersSection(Section):
    """Hyperparameters set by hand, in the sensor's units and metres."""

    signal_variance: Positive = Field(
        description="variance of the field", json_schema_extra={"unit": "the sensor's, squared"}
    )
    noise_variance: Positive = Field(
        description="variance of a reading's noise", json_schema_extra={"unit": "the sensor's, squared"}
    )
    lengthscales_m: Annotated[tuple[Positive, Positive], Field(strict=False)] = Field(
        description="correlation lengths to the east and to the north"
    )


class ModelSection(Section):
    """The sparse online Gaussian process."""

    capacity: Annotated[int, Field(ge=2, le=LARGEST_CAPACITY)] | None = Field(
        default=None,
        description="largest number of basis vectors kept; null: what area and length-scales ask for, 50 to 300, "
        "as far as memory_mb and update_us go",
    )
    memory_mb: float = Field(
        default=64.0,
        ge=4,
        le=4096,
        allow_inf_nan=False,
        description="memory for the model's state where capacity is null; it grows with the capacity's square",
        json_schema_extra={"unit": "MB"},
    )
    update_us: float = Field(
        default=4000.0,
        ge=500,
        le=100_000,
        allow_inf_nan=False,
        description="time for learning one reading where capacity is null, on one core of 2020; "
        "it grows with the capacity's square",
        json_schema_extra={"unit": "µs"},
    )
    novelty: float = Field(
        default=1e-3,
        ge=0,
        lt=1,
        allow_inf_nan=False,
        description="a reading joins the basis if this share of the signal variance was unexplained there",
        json_schema_extra={"unit": "of the signal variance"},
    )
    jitter: float = Field(
        default=1e-8,
        gt=0,
        le=1e-2,
        allow_inf_nan=False,
        description="added to the diagonal of the kernel matrix, for its Cholesky factor",
        json_schema_extra={"unit": "of the signal variance"},
    )
    centring_samples: int = Field(
        default=20,
        ge=0,
        le=1000,
        description="first readings, whose mean is taken off before learning; 0 takes nothing off",
    )
    hyperparameters: HyperparametersSection | None = Field(
        default=None,
        description="start values set by hand; null derives them from the survey's size and first readings",
    )
    history_cells: int = Field(
        default=2000,
        ge=100,
        le=20_000,
        description="cells of the history from which a re-estimate rebuilds the model",
    )

    def conflicts(self) -> Iterator[Conflict]:
        """Without first readings nothing says how large the field's variance is."""
        if self.centring_samples == 0 and self.hyperparameters is None:
            yield Conflict(
                ("centring_samples", "hyperparameters"),
                "0 needs model.hyperparameters: without first readings there is nothing to derive them from",
                "at least 1, or model.hyperparameters given",
            )
        if self.capacity is not None and self.history_cells < self.capacity:
            what = f"must be at least model.capacity ({self.capacity}) (got {self.history_cells})"
            yield Conflict(("history_cells", "capacity"), what, "model.history_cells >= model.capacity")


class EstimationSection(Section):
    """How the hyperparameters are re-estimated."""

    objective: Literal["loo", "marginal"] = Field(
        default="marginal", description="what is maximised: leave-one-out or marginal likelihood"
    )
    data: Literal["history", "basis"] = Field(
        default="history",
        description="what is fitted: cells of the history, or the basis vectors' own readings",
    )
    optimiser: Literal["lbfgs", "gradient_ascent"] = Field(
        default="lbfgs", description="how it is maximised, on the logarithms of the hyperparameters"
    )
    priors: bool = Field(
        default=True, description="whether weak log-normal priors scaled to the survey take part"
    )
    candidates: Annotated[tuple[Candidate, ...], Field(strict=False, min_length=1)] = Field(
        default=("squared_exponential", "long_short", *_MOVING),
        description="kernels among which the penalised objective chooses; ou and those with motion or moving in "
        "their names are for water that moves",
        json_schema_extra={"allowed": f"a list of some of {', '.join(get_args(Candidate))}"},
    )
    maximum_points: int = Field(
        default=300,
        ge=20,
        le=1000,
        description="most points used in the fit of each candidate; that of the chosen one is refined on up to "
        "twice as many",
    )
    iterations: int = Field(default=100, ge=1, le=10_000, description="most iterations of the optimiser")
    learning_rate: Positive = Field(
        default=0.01, description="step of gradient_ascent; lbfgs does not use it"
    )

    def conflicts(self) -> Iterator[Conflict]:
        """Nobody knows when a basis vector's reading was taken; a kernel is fitted once."""
        twice = next((name for name in self.candidates if self.candidates.count(name) > 1), None)
        if twice is not None:
            yield Conflict(("candidates",), f"names {twice} more than once", "each kernel once")
        moving = [name for name in self.candidates if name in _MOVING]
        if self.data == "basis" and moving:
            what = f"basis tells no times, which {moving[0]} in estimation.candidates needs"
            yield Conflict(("data", "candidates"), what, "history, or candidates that do not move")
