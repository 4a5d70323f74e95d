"""What a voyage over a known field is to be: its sea, its launch, its end, and who chooses the way."""

from collections.abc import Callable
from dataclasses import dataclass

from autonomy.config import Configuration
from autonomy.geometry import FloatArray
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea
from sim.truth_map import TruthMap

Planner = Callable[[PlanRequest, SurveyArea], Plan | None]
"""What chooses the way instead of the configured planner; None ends the voyage.

One that gives a whole way at once wants the core `on_rails`.
"""


@dataclass(frozen=True, eq=False)
class Orders:
    """What is to be sailed.

    Attributes:
        waters: the truth, the survey, and the map on which beliefs are judged.
        configuration: the core's, with a `sampling.spacing_m`; whose survey section is not looked at.
        launch_m: shape (2,), local metres, navigable.
        samples: the voyage ends when so many have been learnt; None: `distance_m` ends it.
        distance_m: or when so much has been sailed; None: `samples` ends it. A budget may end it before, at home.
        noise: standard deviation of a reading.
        seed: of the readings' noise. The core's own is in the configuration.
        speed_mps: of the vessel; None: a sample every ten seconds, which is right for seas that don't move.
        planner: chooses the way; None: the configured one.
        judgements: the model is judged so often, at equal parts of the voyage.
        keep_models: whether judgements and plans keep their models.
        known_m: shape (k, 2), local metres: places whose values are known before the launch; None: of none.
        known: their values, shape (k,).
        spots_only: whether the probe is read at the spots of the plans only, once each, instead of all along the way.
    """

    waters: TruthMap
    configuration: Configuration
    launch_m: FloatArray
    samples: int | None = None
    distance_m: float | None = None
    noise: float = 0.0
    seed: int = 0
    speed_mps: float | None = None
    planner: Planner | None = None
    judgements: int = 80
    keep_models: bool = False
    known_m: FloatArray | None = None
    known: FloatArray | None = None
    spots_only: bool = False

    def __post_init__(self) -> None:
        if self.samples is None and self.distance_m is None:
            raise ValueError("a voyage needs an end: samples, distance_m or both")
        if not self.configuration.sampling.spacing_m > 0.0:
            raise ValueError("a voyage needs sampling.spacing_m above 0")
        if (self.known_m is None) != (self.known is None):
            raise ValueError("what is known needs known_m, the places, and known, the values")


def on_rails(configuration: Configuration) -> Configuration:
    """The configuration with which the core re-estimates nothing and plans anew only where a path has ended."""
    exploration = configuration.exploration.model_copy(
        update={
            "rho0": 1.0,
            "rho_rule": "added",
            "maximum_interval_s": None,
            "outgrown_ratio": None,
            "reestimate_on_path_end": False,
        }
    )
    return configuration.model_copy(update={"exploration": exploration})
