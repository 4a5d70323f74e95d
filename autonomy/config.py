"""The whole configuration tree, typed. `load()` names file, line, column, key and range of every mistake."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=360)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Section(BaseModel):
    """A group of keys; unknown keys are mistakes."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class VehicleSection(Section):
    """Who we are."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")] = "boat1"
    cruise_speed_mps: Positive = 1.5


class MavlinkSection(Section):
    """The link to the autopilot."""

    endpoint: Annotated[str, Field(pattern=r"^(udpin|udpout|tcp):[^:]+:\d{1,5}$|^serial:[^:]+:\d+$")] = "udpin:0.0.0.0:14551"
    component_id: Annotated[int, Field(ge=1, le=255)] = 191
    adopt: bool = False
    position_rate_hz: Positive = 4.0
    acceptance_radius_m: Positive = 5.0
    link_timeout_s: Positive = 5.0


class SensorSection(Section):
    """The probe, as it names itself on the link."""

    message_name: Annotated[str, Field(min_length=1, max_length=10)] = "SALT"
    variable: str = "sea_water_practical_salinity"
    units: str = "1"
    minimum: float = float("-inf")
    maximum: float = float("inf")


class SurveySection(Section):
    """Where to survey. Files are GeoJSON, resolved relative to the configuration file."""

    area: Annotated[list[tuple[Latitude, Longitude]], Field(min_length=3)] | Path
    keep_in: Path | None = None
    keep_out: Path | None = None
    land: Path | None = None
    standoff_m: NonNegative = 100.0
    passage_cells: Annotated[int, Field(ge=20, le=1000)] = 200


class SamplingSection(Section):
    """Which readings teach the model."""

    spacing_m: NonNegative = 0.0
    minimum_speed_mps: NonNegative = 0.2
    pairing_gap_s: Positive = 1.0


class HyperparametersSection(Section):
    """Hyperparameters set by hand, in the sensor's units and metres."""

    signal_variance: Positive
    noise_variance: Positive
    lengthscales_m: tuple[Positive, Positive]


class ModelSection(Section):
    """The sparse online Gaussian process."""

    capacity: Annotated[int, Field(ge=2, le=1000)] = 100
    novelty: Annotated[float, Field(ge=0, lt=1)] = 1e-3
    jitter: Annotated[float, Field(gt=0, le=1e-2)] = 1e-8
    centring_samples: Annotated[int, Field(ge=0, le=10_000)] = 20
    hyperparameters: HyperparametersSection | None = None
    history_cells: Annotated[int, Field(ge=100, le=100_000)] = 2000


class EstimationSection(Section):
    """How the hyperparameters are re-estimated."""

    objective: Literal["loo", "marginal"] = "loo"
    data: Literal["history", "basis"] = "history"
    optimiser: Literal["lbfgs", "gradient_ascent"] = "lbfgs"
    priors: bool = True
    isotropic: bool = True
    maximum_points: Annotated[int, Field(ge=20, le=1000)] = 300
    iterations: Annotated[int, Field(ge=1, le=10_000)] = 100
    learning_rate: Positive = 0.01


class ExplorationSection(Section):
    """Algorithm 1: when to re-estimate and re-plan."""

    rho0: Annotated[float, Field(gt=0, le=1)] = 0.6
    rho_rule: Literal["added", "replaced"] = "added"
    minimum_basis: Annotated[int, Field(ge=1, le=1000)] = 30
    maximum_interval_s: Positive | None = 3600.0
    reestimate_on_path_end: bool = True


class PlanningSection(Section):
    """The planner."""

    planner: Literal["paper"] = "paper"
    lattice: tuple[Annotated[int, Field(ge=2, le=100)], Annotated[int, Field(ge=2, le=100)]] = (12, 12)
    spots: Annotated[int, Field(ge=1, le=200)] = 20
    deadline_s: Positive = 120.0


class ShoreSection(Section):
    """zenoh: the routers ashore that the vessel dials, and how often it publishes."""

    connect: list[str] = []
    model_period_s: Positive = 2.0
    health_period_s: Positive = 1.0


class LoggingSection(Section):
    """What goes into the log."""

    level: Literal["debug", "info", "warning", "error"] = "info"


class Configuration(Section):
    """Everything a run depends on."""

    vehicle: VehicleSection = VehicleSection()
    mavlink: MavlinkSection = MavlinkSection()
    sensor: SensorSection = SensorSection()
    survey: SurveySection
    sampling: SamplingSection = SamplingSection()
    model: ModelSection = ModelSection()
    estimation: EstimationSection = EstimationSection()
    exploration: ExplorationSection = ExplorationSection()
    planning: PlanningSection = PlanningSection()
    shore: ShoreSection = ShoreSection()
    logging: LoggingSection = LoggingSection()
    seed: Annotated[int, Field(ge=0)] = 0
