"""The configuration tree: every section, key, default, range and meaning."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from autonomy.config.types import (
    AREA_FORMS,
    ENDPOINT_FORMS,
    LIMIT_FORMS,
    LOCATOR_FORMS,
    Area,
    Bound,
    Corner,
    Endpoint,
    FilePath,
    Finite,
    FolderPath,
    LatticeSide,
    Limit,
    Locator,
    NonNegative,
    Positive,
    SecretPath,
)
from autonomy.endpoints import is_encrypted

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


@dataclass(frozen=True)
class Conflict:
    """Values each allowed but not together; `keys` are dotted, relative to the section that says so."""

    keys: tuple[str, ...]
    what: str
    allowed: str


class Section(BaseModel):
    """A group of keys; unknown keys are mistakes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    def conflicts(self) -> Iterator[Conflict]:
        """What cannot be true together."""
        yield from ()

    @model_validator(mode="after")
    def _without_conflicts(self) -> Self:
        found = tuple(self.conflicts())
        if found:
            text = "; ".join(f"{conflict.keys[0]}: {conflict.what}" for conflict in found)
            raise PydanticCustomError("conflict", "{text}", {"text": text, "conflicts": found})
        return self


class VehicleSection(Section):
    """Who we are."""

    name: str = Field(
        default="boat1",
        pattern=r"^[A-Za-z0-9_-]{1,32}$",
        description="name of the vehicle; people ashore follow usv/NAME/… on zenoh",
        json_schema_extra={"allowed": "1 to 32 letters, digits, - and _"},
    )
    turn_rate_deg_s: float = Field(
        default=20.0,
        ge=1,
        le=360,
        allow_inf_nan=False,
        description="how quickly the vessel turns at its usual speed",
        json_schema_extra={"unit": "degrees per second"},
    )


class SigningSection(Section):
    """MAVLink 2 signing: with a key, nothing is accepted on the link that is not signed with it."""

    key_file: SecretPath | None = Field(
        default=None,
        description="file with the key that all on the link share; only its owner may read it; null: nothing is "
        "signed, and all is accepted",
    )
    form: Literal["passphrase", "key"] = Field(
        default="passphrase",
        description="what the file holds: a passphrase as it is typed into ground stations, whose SHA-256 is the key, "
        "or the key itself, 32 bytes or 64 hexadecimal digits",
    )
    link_id: int = Field(default=0, ge=0, le=255, description="link id in the packets that are sent")


class MavlinkSection(Section):
    """The link to the autopilot."""

    endpoint: Endpoint = Field(
        default="udpin:0.0.0.0:14551",
        description="where the autopilot is: udpin listens, udpout and tcp call, serial opens a device",
        json_schema_extra={"allowed": ENDPOINT_FORMS},
    )
    component_id: int = Field(
        default=191, ge=2, le=255, description="our MAVLink component; 191 is MAV_COMP_ID_ONBOARD_COMPUTER"
    )
    system_id: int | None = Field(
        default=None,
        ge=1,
        le=254,
        description="MAVLink system of the vehicle that is ours; null takes the first that is heard",
    )
    adopt: bool = Field(
        default=False,
        description="whether a mission on board that is not ours may be overwritten before the first AUTO",
    )
    position_rate_hz: Positive = Field(
        default=4.0, description="rate at which positions are asked of the autopilot"
    )
    acceptance_radius_m: Positive | None = Field(
        default=None,
        description="distance at which a waypoint counts as reached; sent with each waypoint; null: what the turn "
        "there asks for at the vessel's speed and vehicle.turn_rate_deg_s, from 2 m to half of what is kept from "
        "land and fence",
    )
    mission_items: int = Field(
        default=100,
        ge=5,
        le=10_000,
        description="waypoints sent at once; a longer route goes on board in stretches, without a stop between them",
    )
    link_timeout_s: Positive = Field(
        default=5.0, description="silence of the autopilot after which the link counts as lost"
    )
    signing: SigningSection = SigningSection()


class AuthoritySection(Section):
    """Who has the boat, and what we may do with it."""

    mode: Literal["missions", "full", "observe"] = Field(
        default="missions",
        description="missions: upload missions and make them current, in AUTO; full: also select AUTO, arm, and send "
        "the boat home; observe: send nothing but heartbeats and words to the operator, only learn and publish",
    )
    resume: Literal["when_auto_again", "never"] = Field(
        default="when_auto_again",
        description="how a boat that was taken from us (mode, failsafe, disarmed, another mission) is given back: by "
        "selecting AUTO, or not before the service is set up anew",
    )
    return_mode: Literal["rtl", "smart_rtl"] = Field(
        default="rtl", description="the autopilot's mode that brings the boat home (mode full)"
    )
    return_battery: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] | None = Field(
        default=0.25,
        description="charge with which the boat is sent home, once (mode full); null: never",
        json_schema_extra={"unit": "of the full charge"},
    )
    fence_margin_m: NonNegative = Field(
        default=20.0, description="distance kept from the autopilot's fence, inside it"
    )


class SensorSection(Section):
    """The probe, as it names itself on the link."""

    message_name: str = Field(
        default="SALT",
        pattern=r"^[!-~]{1,10}$",
        description="name in the probe's NAMED_VALUE_FLOAT messages",
        json_schema_extra={"allowed": "1 to 10 printable ASCII characters without spaces"},
    )
    variable: str = Field(
        default="sea_water_practical_salinity",
        min_length=1,
        description="what is measured, as a CF standard name; goes into what is published",
    )
    units: str = Field(
        default="1", min_length=1, description="unit of the readings, as CF writes it; goes with them"
    )
    minimum: Bound = Field(
        default=float("-inf"),
        description="readings below this are not learnt from",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or -.inf for no limit"},
    )
    maximum: Bound = Field(
        default=float("inf"),
        description="readings above this are not learnt from",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or .inf for no limit"},
    )
    transform: Literal["none", "log", "logit"] = Field(
        default="none",
        description="how readings are made Gaussian before learning: log for what spans decades, logit for what "
        "lies between two ends; maps and intervals stay in the sensor's unit",
    )
    transform_offset: float = Field(
        default=0.0,
        allow_inf_nan=False,
        description="added to readings before log, so that zeros have one",
        json_schema_extra={"unit": "the sensor's"},
    )
    transform_bounds: Annotated[tuple[Finite, Finite], Field(strict=False)] | None = Field(
        default=None,
        description="the two ends that readings under logit lie between",
        json_schema_extra={"unit": "the sensor's"},
    )

    def conflicts(self) -> Iterator[Conflict]:
        """An empty range would refuse every reading; a transform needs its own numbers and no others."""
        if not self.minimum < self.maximum:
            what = f"must be below sensor.maximum ({self.maximum:g}) (got {self.minimum:g})"
            yield Conflict(("minimum", "maximum"), what, "sensor.minimum < sensor.maximum")
        if self.transform_offset != 0.0 and self.transform != "log":
            what = f"is for sensor.transform log, not {self.transform}"
            yield Conflict(("transform_offset", "transform"), what, "0, or sensor.transform: log")
        bounds = self.transform_bounds
        if (bounds is not None) != (self.transform == "logit"):
            what = "is for sensor.transform logit, which needs it"
            yield Conflict(
                ("transform_bounds", "transform"), what, "two numbers with logit, null with the others"
            )
        elif bounds is not None and not bounds[0] < bounds[1]:
            what = f"must be a lower and an upper end (got {bounds[0]:g} and {bounds[1]:g})"
            yield Conflict(("transform_bounds",), what, "[lower, upper], e.g. [0, 40]")


class SurveySection(Section):
    """Where to survey. Files are GeoJSON, QGroundControl .plan, KML or KMZ, relative to the configuration file."""

    area: Area = Field(
        description="the survey area",
        json_schema_extra={"unit": "degrees", "allowed": AREA_FORMS},
    )
    keep_in: FilePath | None = Field(default=None, description="polygons that the vessel must not leave")
    keep_out: FilePath | None = Field(default=None, description="polygons that the vessel must not enter")
    land: FilePath | None = Field(
        default=None, description="polygons of land; without them all of the area is water"
    )
    depth: FilePath | None = Field(
        default=None,
        description="grid of depths: an ESRI ASCII grid (.asc) in degrees, which covers the area",
    )
    depth_positive: Literal["up", "down"] = Field(
        default="up", description="up: the grid has heights, negative below the water; down: it has depths"
    )
    minimum_depth_m: NonNegative = Field(
        default=2.0,
        description="where the grid has less water, or no value, is land; no tide is added or taken away",
    )
    standoff_m: NonNegative = Field(
        default=100.0, description="distance kept from land, shallows and keep-out"
    )
    passage_cells: int = Field(
        default=200,
        ge=20,
        le=400,
        description="cells along the longer side of the grid on which ways round land are sought",
    )


class SamplingSection(Section):
    """Which readings teach the model."""

    spacing_m: NonNegative = Field(
        default=0.0,
        description="readings closer than this to the last one learnt are skipped; 0 takes all of them",
    )
    minimum_speed_mps: NonNegative = Field(
        default=0.2,
        description="readings at a lower speed over ground are skipped: lying still teaches nothing new",
    )
    pairing_gap_s: Positive = Field(
        default=1.0, description="a reading further than this in time from a position fix is dropped"
    )


class QualitySection(Section):
    """Tests of every reading (QARTOD): flags that go with it, and which flags teach the model."""

    learn_from: Literal["good", "good_and_suspect"] = Field(
        default="good", description="flags of the readings that teach; failed and missing ones never do"
    )
    gap_s: Positive | None = Field(
        default=None,
        description="pause after which readings are missing, and a reading held back for the next one is let go; "
        "null: five times the usual interval, and at least 2 s",
    )
    suspect_minimum: Bound = Field(
        default=float("-inf"),
        description="readings below this are suspect; those below sensor.minimum fail",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or -.inf for no limit"},
    )
    suspect_maximum: Bound = Field(
        default=float("inf"),
        description="readings above this are suspect; those above sensor.maximum fail",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or .inf for no limit"},
    )
    location_margin_m: NonNegative | None = Field(
        default=None,
        description="readings further than this outside the survey area fail; null: the longer side of the area",
    )
    maximum_speed_mps: Positive | None = Field(
        default=None,
        description="places that take a higher speed to get to fail; null: eight times the usual speed, "
        "and at least 15 m/s",
    )
    spike_suspect: Limit | None = Field(
        default=None,
        description="height over both neighbours above which a reading is suspect; null: five standard deviations "
        "of the noise, estimated from the usual step between readings",
        json_schema_extra={"unit": "the sensor's", "allowed": LIMIT_FORMS},
    )
    spike_fail: Limit | None = Field(
        default=None,
        description="height over both neighbours above which a reading fails; null: ten standard deviations",
        json_schema_extra={"unit": "the sensor's", "allowed": LIMIT_FORMS},
    )
    rate_suspect_per_s: Limit | None = Field(
        default=None,
        description="change since the last good reading, per second, above which a reading is suspect; null: ten "
        "standard deviations of the noise or one of the last ten minutes' readings, whichever is more",
        json_schema_extra={"unit": "the sensor's, per second", "allowed": LIMIT_FORMS},
    )
    rate_fail_per_s: Limit | None = Field(
        default=None,
        description="change since the last good reading, per second, above which a reading fails; null: twice as much",
        json_schema_extra={"unit": "the sensor's, per second", "allowed": LIMIT_FORMS},
    )
    flat_tolerance: NonNegative = Field(
        default=0.0,
        description="readings that differ by no more than this count as the same",
        json_schema_extra={"unit": "the sensor's"},
    )
    flat_suspect_s: Limit | None = Field(
        default=None,
        description="time for which a reading may stay the same before it is suspect; null: four times as many "
        "repeats as the third longest of the last sixty runs of equal readings had and at least four, or not at all "
        "where most readings repeat the one before",
        json_schema_extra={"allowed": LIMIT_FORMS},
    )
    flat_fail_s: Limit | None = Field(
        default=None,
        description="time for which a reading may stay the same before it fails; null: twice as many repeats",
        json_schema_extra={"allowed": LIMIT_FORMS},
    )

    def conflicts(self) -> Iterator[Conflict]:
        """What fails is suspect too."""
        if not self.suspect_minimum < self.suspect_maximum:
            what = f"must be below quality.suspect_maximum ({self.suspect_maximum:g}) (got {self.suspect_minimum:g})"
            yield Conflict(
                ("suspect_minimum", "suspect_maximum"),
                what,
                "quality.suspect_minimum < quality.suspect_maximum",
            )
        for suspect, fail in (
            ("spike_suspect", "spike_fail"),
            ("rate_suspect_per_s", "rate_fail_per_s"),
            ("flat_suspect_s", "flat_fail_s"),
        ):
            low, high = getattr(self, suspect), getattr(self, fail)
            if low is not None and high is not None and low > high:
                what = f"must be at most quality.{fail} ({high:g}) (got {low:g})"
                yield Conflict((suspect, fail), what, f"quality.{suspect} <= quality.{fail}")


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


class ExplorationSection(Section):
    """Algorithm 1: when to re-estimate and re-plan."""

    rho0: float = Field(
        default=0.6,
        gt=0,
        le=1,
        allow_inf_nan=False,
        description="rho above which the model is re-estimated and a new path planned; 1 is never exceeded",
    )
    rho_rule: Literal["added", "replaced"] = Field(
        default="added",
        description="share of basis vectors added since the last re-estimate, or replacements over capacity",
    )
    minimum_basis: int = Field(
        default=20,
        ge=1,
        le=1000,
        description="rho counts only from this many basis vectors on, and from 20 cells of the history unless "
        "this is less; the interval from as many of either",
    )
    maximum_interval_s: Positive | None = Field(
        default=3600.0, description="longest model time between re-estimates; null for no limit"
    )
    outgrown_ratio: Positive | None = Field(
        default=4.0,
        description="re-estimate when the readings vary this many times more than the model's signal variance says "
        "and their history has doubled since the last re-estimate; null: never",
    )
    stall_s: Positive | None = Field(
        default=60.0,
        description="model time without getting anywhere, in AUTO under our mission, after which the boat counts as "
        "stalled and the water behind the stall is given up for a while; null: never",
    )
    stall_m: Positive = Field(default=8.0, description="moving less than this is not getting anywhere")
    give_up_s: Positive = Field(
        default=1800.0,
        description="model time for which water behind a stall is given up; doubled when the boat stalls there again",
    )
    replan_share: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] | None = Field(
        default=None,
        description="share of the longest path so far after which, sailed, a new one is planned without a re-estimate; "
        "null: a seventh with the planner route, which learns where the field is rough, and never with the others",
    )
    reestimate_on_path_end: bool = Field(
        default=True,
        description="whether the end of a path brings a re-estimate, or only a new path",
    )


class PlanningSection(Section):
    """The planner."""

    planner: Literal["auto", "paper", "spots", "route", "patrol", "lawnmower"] = Field(
        default="auto",
        description="how the next path is found: route within a budget, and else spots, or patrol where the field "
        "moves; spots and a tour as in the paper; better spots, those not yet visited kept; a whole route for what "
        "may be sailed; rounds for ever over a field that moves; lanes back and forth",
    )
    lattice: Annotated[tuple[LatticeSide, LatticeSide], Field(strict=False)] = Field(
        default=(12, 12),
        description="candidate sites across the area, to the east and to the north; those on land drop out",
    )
    spots: int = Field(default=20, ge=1, le=200, description="sampling spots on one path")
    hold_s: float = Field(
        default=0.0,
        ge=0,
        le=3600,
        allow_inf_nan=False,
        description="how long the boat stays at each sampling spot; autopilots may take whole seconds only",
    )
    minimum_gain: float = Field(
        default=0.02,
        ge=0,
        lt=1,
        allow_inf_nan=False,
        description="by how much a new plan must be better than what is left of the present one to change course, "
        "with planners that can tell",
        json_schema_extra={"unit": "of the planner's objective"},
    )
    iterations: Annotated[int, Field(ge=1, le=1_000_000)] | None = Field(
        default=None,
        description="how long a planner that searches may search; null: as long as it finds right",
    )
    deadline_s: Positive = Field(
        default=120.0,
        description="time after which a re-estimate or a plan is given up and the worker replaced",
    )

    def conflicts(self) -> Iterator[Conflict]:
        """Mutual information is about the spots and the rest, so there must be a rest."""
        sites = self.lattice[0] * self.lattice[1]
        if self.spots >= sites:
            what = f"must be below the {sites} sites of planning.lattice (got {self.spots})"
            yield Conflict(("spots", "lattice"), what, "planning.spots < product of planning.lattice")


class BudgetSection(Section):
    """How far, how long and on what charge the boat may sail, the way home included; see docs/budget.md."""

    distance_m: Positive | None = Field(
        default=None, description="most that may be sailed over ground; null for no limit"
    )
    duration_s: Positive | None = Field(
        default=None,
        description="longest model time from the start until the boat is home; null for no limit",
    )
    energy_wh: Positive | None = Field(
        default=None,
        description="energy of the full battery, of which what it holds at the start may be drawn; null for no limit",
        json_schema_extra={"unit": "Wh"},
    )
    consumption_j_per_m: Positive | None = Field(
        default=None,
        description="energy per metre over ground, a guess until enough has been measured; needed with "
        "energy_wh (1 Wh/km is 3.6 J/m)",
        json_schema_extra={"unit": "J/m"},
    )
    speed_mps: Positive = Field(
        default=1.5, description="speed over ground, a guess until it has been measured"
    )
    reserve: float = Field(
        default=0.1,
        ge=0,
        lt=1,
        allow_inf_nan=False,
        description="what is left of each limit when the boat is home, a reserve that no plan spends",
        json_schema_extra={"unit": "of the limit"},
    )
    home_margin: float = Field(
        default=1.2,
        ge=1,
        le=3,
        allow_inf_nan=False,
        description="no leg is begun unless the way home from its end could be paid this many times after it; with "
        "half of this margin the boat turns back (stage low), without any it is critical",
    )
    low_battery: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] | None = Field(
        default=None,
        description="charge at which the boat turns back wherever it is; null: none",
        json_schema_extra={"unit": "of the full charge"},
    )
    critical_battery: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] | None = Field(
        default=None,
        description="charge that is critical: the boat is to come home as fast as it can; null: none",
        json_schema_extra={"unit": "of the full charge"},
    )
    home: Corner | None = Field(
        default=None,
        description="where the survey ends; null: the autopilot's home position, or where the survey began",
        json_schema_extra={"unit": "degrees", "allowed": "[latitude, longitude], or null"},
    )

    @property
    def is_limited(self) -> bool:
        """Whether anything here can ever bring the boat home."""
        limits = (self.distance_m, self.duration_s, self.energy_wh, self.low_battery, self.critical_battery)
        return any(limit is not None for limit in limits)

    def conflicts(self) -> Iterator[Conflict]:
        """Energy must be known by the metre; what is critical is also low."""
        if self.energy_wh is not None and self.consumption_j_per_m is None:
            what = (
                "needs budget.consumption_j_per_m: nothing tells how far it goes until that has been measured"
            )
            yield Conflict(
                ("energy_wh", "consumption_j_per_m"), what, "a guess at budget.consumption_j_per_m"
            )
        low, critical = self.low_battery, self.critical_battery
        if low is not None and critical is not None and critical > low:
            what = f"must be at most budget.low_battery ({low:g}) (got {critical:g})"
            yield Conflict(
                ("critical_battery", "low_battery"), what, "budget.critical_battery <= budget.low_battery"
            )


_PEM = "the name of a file in PEM form, or null"


class TlsSection(Section):
    """Certificates for the routers that are dialled by tls/… or quic/…; other locators have no use for them."""

    root_ca: FilePath | None = Field(
        default=None,
        description="certificate of the authority that the routers' certificates come from; null: those that browsers "
        "trust",
        json_schema_extra={"allowed": _PEM},
    )
    certificate: FilePath | None = Field(
        default=None,
        description="certificate that the vessel shows to the routers; its common name is what their access control "
        "goes by",
        json_schema_extra={"allowed": _PEM},
    )
    private_key: SecretPath | None = Field(
        default=None,
        description="private key of that certificate; only its owner may read it",
        json_schema_extra={"allowed": _PEM},
    )
    verify_name: bool = Field(
        default=True, description="whether a router's certificate must be for the host that is dialled"
    )

    def conflicts(self) -> Iterator[Conflict]:
        """A certificate is of no use without its key, nor a key without its certificate."""
        if (self.certificate is None) != (self.private_key is None):
            missing, given = ("certificate", "private_key")
            if self.private_key is None:
                missing, given = given, missing
            what = f"is missing while shore.tls.{given} is given"
            yield Conflict((missing, given), what, "both certificate and private_key, or neither")


class ShoreSection(Section):
    """zenoh: the routers ashore that the vessel dials, and how often it publishes."""

    connect: Annotated[list[Locator], Field(strict=False)] = Field(
        default=[],
        description="routers ashore that the vessel dials, for ever; none: nothing is published",
        json_schema_extra={"allowed": f"a list of {LOCATOR_FORMS}"},
    )
    model_period_s: Positive = Field(
        default=2.0, description="shortest time between two snapshots of the model"
    )
    health_period_s: Positive = Field(default=1.0, description="time between two reports of health")
    backlog: int = Field(
        default=604_800,
        ge=1,
        le=10_000_000,
        description="observations kept while nobody ashore listens, in 40 bytes each; then the oldest are dropped",
    )
    tls: TlsSection = TlsSection()

    def conflicts(self) -> Iterator[Conflict]:
        """Certificates protect nothing on a way that does not use them."""
        if self.tls.certificate is not None and not any(map(is_encrypted, self.connect)):
            what = "is of no use: no locator in shore.connect begins with tls/ or quic/"
            yield Conflict(
                ("tls.certificate", "connect"), what, "locators such as tls/shore.example.org:7447"
            )


class JournalSection(Section):
    """The recording of a run: everything that happened, for restarts and replay, and the MAVLink stream."""

    enabled: bool = Field(default=True, description="whether runs are recorded")
    directory: FolderPath | None = Field(
        default=None,
        description="where to; null: journal in systemd's state directory, or else in "
        "~/.local/state/halocline/NAME, with vehicle.name for NAME",
        json_schema_extra={"allowed": "the name of a folder, made if need be, or null"},
    )
    file_mb: float = Field(
        default=32.0,
        ge=0.1,
        le=1000,
        allow_inf_nan=False,
        description="size at which a new file is begun",
        json_schema_extra={"unit": "MB"},
    )
    file_age_s: Positive = Field(default=86400.0, description="age at which a new file is begun")
    total_mb: float = Field(
        default=4000.0,
        ge=1,
        le=1_000_000,
        allow_inf_nan=False,
        description="size of all files together above which the oldest are removed",
        json_schema_extra={"unit": "MB"},
    )
    sync_s: float = Field(
        default=1.0,
        ge=0,
        le=1,
        allow_inf_nan=False,
        description="longest time until what has happened is safe from a power cut",
    )

    def conflicts(self) -> Iterator[Conflict]:
        """The newest file must not push itself out."""
        if self.total_mb < 2 * self.file_mb:
            what = f"must be at least twice journal.file_mb ({self.file_mb:g}) (got {self.total_mb:g})"
            yield Conflict(("total_mb", "file_mb"), what, "journal.total_mb >= 2 * journal.file_mb")


class CheckpointSection(Section):
    """What is kept of the core's knowledge, so that a restarted service goes on where it was."""

    enabled: bool = Field(default=True, description="whether a restarted service knows what it knew before")
    directory: FolderPath | None = Field(
        default=None,
        description="where checkpoints are kept; null: checkpoint in systemd's state directory, or else in "
        "~/.local/state/halocline/NAME, with vehicle.name for NAME",
        json_schema_extra={"allowed": "the name of a folder, made if need be, or null"},
    )
    period_s: float = Field(
        default=60.0,
        ge=1,
        le=3600,
        allow_inf_nan=False,
        description="time between two checkpoints; what happened since the last one is replayed from the journal",
    )


class LoggingSection(Section):
    """What goes into the log."""

    level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", description="lines below this severity are left out"
    )


class Configuration(Section):
    """Everything a run depends on."""

    vehicle: VehicleSection = VehicleSection()
    mavlink: MavlinkSection = MavlinkSection()
    authority: AuthoritySection = AuthoritySection()
    sensor: SensorSection = SensorSection()
    survey: SurveySection
    sampling: SamplingSection = SamplingSection()
    quality: QualitySection = QualitySection()
    model: ModelSection = ModelSection()
    estimation: EstimationSection = EstimationSection()
    exploration: ExplorationSection = ExplorationSection()
    planning: PlanningSection = PlanningSection()
    budget: BudgetSection = BudgetSection()
    shore: ShoreSection = ShoreSection()
    journal: JournalSection = JournalSection()
    checkpoint: CheckpointSection = CheckpointSection()
    logging: LoggingSection = LoggingSection()
    seed: int = Field(
        default=0, ge=0, description="seed of every random choice; runs with equal inputs are equal"
    )

    def conflicts(self) -> Iterator[Conflict]:
        """A basis that can't grow to its minimum would never re-estimate; a boat that holds has not stalled."""
        stall_s, hold_s = self.exploration.stall_s, self.planning.hold_s
        if stall_s is not None and hold_s >= stall_s:
            what = f"must be below exploration.stall_s ({stall_s:g}) (got {hold_s:g})"
            keys = ("planning.hold_s", "exploration.stall_s")
            yield Conflict(keys, what, "planning.hold_s < exploration.stall_s")
        if hold_s > 0.0 and (self.budget.duration_s is not None or self.budget.energy_wh is not None):
            limit = "duration_s" if self.budget.duration_s is not None else "energy_wh"
            what = f"must be 0 with budget.{limit}: what holding costs is not counted (got {hold_s:g})"
            yield Conflict(
                ("planning.hold_s", f"budget.{limit}"), what, "planning.hold_s: 0, or no such limit"
            )
        minimum, capacity = self.exploration.minimum_basis, self.model.capacity
        keys = ("exploration.minimum_basis", "model.capacity")
        if capacity is not None and capacity < minimum:
            what = f"must be at most model.capacity ({capacity}) (got {minimum})"
            yield Conflict(keys, what, "exploration.minimum_basis <= model.capacity")
        if capacity is None and minimum > LEAST_CHOSEN_CAPACITY:
            what = f"must be at most {LEAST_CHOSEN_CAPACITY} while model.capacity is null (got {minimum})"
            yield Conflict(
                keys, what, f"at most {LEAST_CHOSEN_CAPACITY}, or a model.capacity of at least as much"
            )
