"""The values that a vehicle publishes; their bytes are made and read by `autonomy.wire`."""

from collections.abc import Mapping
from dataclasses import dataclass

from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Kernel
from autonomy.learning.snapshot import Precision

Ring = tuple[tuple[float, float], ...]
"""Latitude and longitude of the corners of a closed line, in degrees; the last is not the first again."""


@dataclass(frozen=True, eq=False)
class ModelSnapshot:
    """The belief about the field at one moment, with all that is needed to draw it on a chart.

    Attributes:
        vehicle: who believes it.
        sequence: counts the snapshots of one run of the vehicle's software.
        software_version: version of that software.
        variable: what is measured (CF standard name).
        units: units of the variable.
        model: the posterior; its positions are local metres of the frame below.
        model_time_s: the moment that the map is of, by the vehicle's own clock.
        utc_s: the same moment in seconds since 1970, None while the vehicle doesn't know it.
        samples: readings learnt so far.
        rho: share of the basis vectors added since the last re-estimate.
        replans: plans made so far.
        calibration: how the newest readings agreed with what the model said of each just before learning it.
        ahead: the same of readings far from what the model that predicts them knew: whether to trust the map.
        origin_lat_deg: latitude of the survey frame's origin.
        origin_lon_deg: longitude of the survey frame's origin.
        bounds_m: x minimum, y minimum, x maximum, y maximum of the survey area, local metres.
        survey: name of the survey.
        capacity: most basis vectors that the model may have.
        rho0: the share of new basis vectors at which everything is estimated and planned anew.
        configuration_hash: of the configuration that the vehicle runs with; equal ones are one.
        precision: how `model` travels: one of `snapshot.PRECISIONS`.
        stated_error: by how much the map that is made of what travelled may differ from the vehicle's, in the mean
            and in the standard deviation, as shares of the field's standard deviation; 0 for lossless.
        run: of the vehicle's software, as in `Numbered`; 0 before it is on its way.
        believed: the kernel on board, which parts of the field move and how. That of `model` stands still where it
            went over a thin link. None before it has travelled: then it is that of `model`.
    """

    vehicle: str
    sequence: int
    software_version: str
    variable: str
    units: str
    model: FieldModel
    model_time_s: float
    utc_s: float | None
    samples: int
    rho: float
    replans: int
    calibration: CalibrationFigures
    ahead: CalibrationFigures
    origin_lat_deg: float
    origin_lon_deg: float
    bounds_m: tuple[float, float, float, float]
    survey: str
    capacity: int
    rho0: float
    configuration_hash: str
    run: int = 0
    precision: Precision = "lossless"
    stated_error: tuple[float, float] = (0.0, 0.0)
    believed: Kernel | None = None

    @property
    def kernel(self) -> Kernel:
        """What the field is believed to be like on board, however the map has travelled."""
        return self.believed or self.model.kernel


@dataclass(frozen=True)
class PlanNotice:
    """A new plan.

    Attributes:
        sequence: counts the plans of one run.
        start_deg: latitude, longitude where the route begins.
        route_deg: latitude, longitude of every corner in sailing order, the start excluded.
        is_spot: which corners are sampling spots; as long as `route_deg`.
        mutual_information: of the spots, in nats; None if unknown.
        planner: name of the planner.
        reason: why there is a new plan, for a person.
        objective_before: the planner's objective, a cost, had the rest of the previous plan been sailed instead.
        objective_after: the same of this plan.
        expected_rmse: of the map once the plan has been sailed, in the units that the model is Gaussian in.
        rejected: names and objectives of candidates that lost, the best first.
        seed: of the planner's random choices.
        model_version: readings that the model knew that was planned with.
        run: of the vehicle's software, as in `Numbered`; 0 before it is on its way.
        utc_s: when it was made, seconds since 1970; None while the vehicle doesn't know it.
    """

    sequence: int
    start_deg: tuple[float, float]
    route_deg: tuple[tuple[float, float], ...]
    is_spot: tuple[bool, ...]
    mutual_information: float | None
    planner: str
    reason: str
    objective_before: float | None = None
    objective_after: float | None = None
    expected_rmse: float | None = None
    rejected: tuple[tuple[str, float], ...] = ()
    seed: int | None = None
    model_version: int | None = None
    run: int = 0
    utc_s: float | None = None


@dataclass(frozen=True)
class ObservationNotice:
    """One reading of the probe, in the variable's units, at a position and a time of the vehicle's clock.

    `value` is NaN where the probe sent no finite number. `flag` is QARTOD's: 1 good, 2 not evaluated, 3 suspect,
    4 fail, 9 missing; `checks` the flags of the single tests, in the order of `autonomy.quality.Check`.
    """

    model_time_s: float
    lat_deg: float
    lon_deg: float
    value: float
    flag: int
    checks: tuple[int, ...]


@dataclass(frozen=True)
class Numbered:
    """A piece of what a vehicle tells in order, none twice and none left out.

    Attributes:
        run: of the vehicle's software; the numbers of another run are other numbers.
        first: number of the first item; they count from 0.
        oldest: number of the oldest that the vehicle still has. Older ones cannot be asked for any more.
        end: number after the newest that has been sent. Whoever lacks one below it should ask for it.
    """

    run: int
    first: int
    oldest: int
    end: int


@dataclass(frozen=True)
class ObservationBatch(Numbered):
    """Observations in the order in which they were made; may be empty."""

    items: tuple[ObservationNotice, ...]


@dataclass(frozen=True)
class LogNotice:
    """A line of the vehicle's log; `level` is debug, info, warning or error; `utc_s` None while it isn't known."""

    level: str
    text: str
    utc_s: float | None = None


@dataclass(frozen=True)
class LogBatch(Numbered):
    """Lines of the log in order; may be empty."""

    items: tuple[LogNotice, ...]


@dataclass(frozen=True)
class SurveyNotice:
    """What is being surveyed, and where: what doesn't change while the vehicle sails, but for the fence.

    The rings of `land` and the other areas bound them by the even-odd rule: what lies in an odd number of them is
    inside. They are simplified to what a chart shows.

    Attributes:
        name: of the survey.
        variable: what is measured (CF standard name).
        long_name: the same in words.
        units: units of the variable.
        valid_range: readings outside are not learnt from; None where there is no limit.
        rho0: the share of new basis vectors at which everything is estimated and planned anew.
        capacity: most basis vectors that the model may have; None where the vehicle chooses, and says so in the model.
        bounds_deg: south, west, north, east of the survey.
        area: the water and land that are surveyed.
        land: where there is land, or too little water.
        keep_in: where the vessel must stay; empty if nothing was said.
        keep_out: where it must not go.
        fence: outlines of the zones of the autopilot's fence, as far as they have been read.
    """

    name: str
    variable: str
    long_name: str
    units: str
    valid_range: tuple[float | None, float | None]
    rho0: float
    capacity: int | None
    bounds_deg: tuple[float, float, float, float]
    area: tuple[Ring, ...] = ()
    land: tuple[Ring, ...] = ()
    keep_in: tuple[Ring, ...] = ()
    keep_out: tuple[Ring, ...] = ()
    fence: tuple[Ring, ...] = ()


@dataclass(frozen=True)
class StatusDigest:
    """All that matters, in at most 340 bytes, for a satellite modem; `autonomy.digest` reads them."""

    data: bytes


@dataclass(frozen=True)
class HealthNotice:
    """How the vehicle and its software are. None (or NaN) stands for a number that isn't known.

    `quality` counts the readings flagged 1, 2, 3, 4 and 9 by each test, by its name, and as `aggregate`;
    `state` is the exploration's state and `reason` why it is in it; `mode` the autopilot's mode by name; `kernel` what
    the field is believed to be like, in words; `calibration` and `ahead` as in `ModelSnapshot`; `repairs` how often
    the model had to be rebuilt because rounding had broken it;
    `distance_m` what has been sailed; `clock_rate` vehicle seconds per second of this process; `link_ok`
    whether the autopilot is heard; `worker_busy` whether a job runs; `dropped` messages for the shore that
    were thrown away before anybody heard them; `journal` what is wrong with the recording of the run, empty
    if nothing is; `security` what was refused on the link to the vehicle, and why; `shore` what is wrong with the way
    ashore; `run`, `observations_end` and `log_end` the run of the software and the ends of what it has told, as in
    `Numbered`; `utc_s` the moment of `model_time_s` in seconds since 1970.
    """

    state: str
    reason: str
    mode: str
    armed: bool
    lat_deg: float | None
    lon_deg: float | None
    heading_deg: float | None
    groundspeed_mps: float | None
    model_time_s: float | None
    samples: int
    basis_size: int
    rho: float | None
    rho0: float | None
    replans: int
    kernel: str
    calibration: CalibrationFigures
    ahead: CalibrationFigures
    repairs: int
    distance_m: float | None
    clock_rate: float | None
    link_ok: bool
    worker_busy: bool
    dropped: int
    journal: str
    quality: Mapping[str, tuple[int, ...]]
    security: str = ""
    shore: str = ""
    run: int = 0
    observations_end: int = 0
    log_end: int = 0
    utc_s: float | None = None


Message = (
    ModelSnapshot | PlanNotice | ObservationBatch | HealthNotice | LogBatch | SurveyNotice | StatusDigest
)
"""What travels, one a payload."""

Payload = (
    ModelSnapshot
    | PlanNotice
    | ObservationNotice
    | tuple[ObservationNotice, ...]
    | HealthNotice
    | LogNotice
    | SurveyNotice
    | StatusDigest
)
"""What the core has published; its observations and lines are numbered on their way out."""
