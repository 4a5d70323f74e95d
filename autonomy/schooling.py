"""The learner that a configuration asks for."""

from autonomy.config import BudgetSection, Configuration
from autonomy.learning.capacity import Budget
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.learner import Learner
from autonomy.learning.transform import transform_of
from autonomy.planning.survey import SurveyArea


def make_learner(configuration: Configuration, survey: SurveyArea) -> Learner:
    """A learner that knows nothing yet, for the survey."""
    model = configuration.model
    given = model.hyperparameters
    return Learner(
        survey.span_m,
        capacity=model.capacity,
        novelty=model.novelty,
        jitter=model.jitter,
        centring_samples=model.centring_samples,
        history_cells=model.history_cells,
        hyperparameters=None
        if given is None
        else Hyperparameters(given.signal_variance, given.noise_variance, given.lengthscales_m),
        area_m2=survey.area_m2,
        budget=Budget(model.memory_mb, model.update_us),
        transform=transform_of(configuration.sensor),
        budget_m=_longest_m(configuration.budget),
    )


def _longest_m(section: BudgetSection) -> float | None:
    """How far the survey can go, as far as that is known beforehand; None: without end."""
    limits = [section.distance_m]
    if section.duration_s is not None:
        limits.append(section.duration_s * section.speed_mps)
    if section.energy_wh is not None and section.consumption_j_per_m is not None:
        limits.append(3600.0 * section.energy_wh / section.consumption_j_per_m)
    return min((limit for limit in limits if limit is not None), default=None)
