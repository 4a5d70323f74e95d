"""Made-up vessels that publish as real ones do: each sails a fixed way through a wavy sea and learns as it goes."""

import math
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np

from autonomy.effects import Topic
from autonomy.geometry import LocalFrame
from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.shell.publisher import Publisher
from autonomy.wire import HealthNotice, LogNotice, ModelSnapshot, ObservationNotice, PlanNotice, SurveyNotice

WIDTH_M, HEIGHT_M = 12_000.0, 9_000.0
FRAME = LocalFrame(34.4, -120.5)
CAPACITY = 80
RHO0 = 0.6
SPACING_M = 120.0
SPEED_MPS = 1.6
STOP_S = 30.0

_CORNERS_M = np.array(
    [
        [600, 700],
        [3200, 8200],
        [4800, 1200],
        [6400, 7600],
        [8300, 900],
        [9700, 8100],
        [11300, 1500],
        [700, 4300],
    ],
    dtype=float,
)
_LAND_M = np.array(
    [[12000, 9000], [12000, 6900], [10900, 7500], [10300, 8400], [9200, 8600], [8600, 9000]], dtype=float
)


class MadeUpVessel:
    """Publishes to a router at `endpoint`; `sail` goes on, learns and publishes what came of it."""

    def __init__(
        self,
        name: str,
        endpoint: str,
        variable: str = "sea_water_practical_salinity",
        units: str = "1",
        mean: float = 33.4,
        seed: int = 0,
    ) -> None:
        self.name, self.variable, self.units, self._mean = name, variable, units, mean
        self._rng = np.random.default_rng(seed)
        self._phase = seed
        self._learner = SparseOnlineGP(
            Hyperparameters(0.09, 4e-4, (2100.0, 1700.0)), CAPACITY, prior_mean=mean
        )
        self._way_m = _along(_CORNERS_M)
        self._done = 0
        self._sequence = 0
        self._began_utc_s = time.time() - len(self._way_m) * SPACING_M / SPEED_MPS
        self._publisher = Publisher(name, [endpoint])

    def __enter__(self) -> "MadeUpVessel":
        self._publisher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._publisher.stop(STOP_S)

    def truth(self, points_m):
        """The field at places (n, 2): shape (n,)."""
        x, y = np.moveaxis(np.asarray(points_m, dtype=float), -1, 0)
        waves = 0.3 * np.sin(x / 1900.0 + self._phase) * np.cos(y / 2300.0) + 0.12 * np.sin((x + y) / 2900.0)
        return self._mean + waves

    def tell_nothing_but_presence(self) -> None:
        """A log line: it is there, and knows nothing yet."""
        self._publisher.publish(Topic.LOG, LogNotice("info", "waiting for the first reading"))

    def sail(self, readings: int) -> ModelSnapshot:
        """Take so many readings more; returns the model that was published."""
        part = self._way_m[self._done : self._done + readings]
        values = self.truth(part) + self._rng.normal(0.0, 0.02, len(part))
        observed = []
        for offset, (point, value) in enumerate(zip(part, values, strict=True), start=self._done):
            self._learner.update(point, value)
            lat_deg, lon_deg = FRAME.to_geodetic(point).tolist()
            flag = 3 if offset % 97 == 60 else 1
            checks = (1, 1, 1, 1, flag, 1, 1)
            observed.append(
                ObservationNotice(self._time_s(offset), lat_deg, lon_deg, float(value), flag, checks)
            )
        self._done += len(part)
        self._sequence += 1
        model = self._model()
        self._publisher.publish(Topic.SURVEY, self._survey())
        self._publisher.publish(Topic.MODEL, model)
        self._publisher.publish(Topic.OBSERVATIONS, tuple(observed))
        self._publisher.publish(Topic.HEALTH, self._health())
        self._publisher.publish(Topic.PLAN, self._plan())
        self._publisher.publish(
            Topic.LOG, LogNotice("info", f"plan {self._sequence}: <b>4</b> spots, path finished")
        )
        return model

    def _time_s(self, index: int) -> float:
        return index * SPACING_M / SPEED_MPS

    def _calibration(self) -> CalibrationFigures:
        return CalibrationFigures(0.943, 1.08, 1.31, self._done)

    def _model(self) -> ModelSnapshot:
        time_s = self._time_s(self._done)
        return ModelSnapshot(
            vehicle=self.name,
            sequence=self._sequence,
            software_version="0.1.0",
            variable=self.variable,
            units=self.units,
            model=self._learner.model(),
            model_time_s=time_s,
            utc_s=self._began_utc_s + time_s,
            samples=self._done,
            rho=RHO0 * (0.5 + 0.5 * math.sin(self._sequence)),
            replans=self._sequence,
            calibration=self._calibration(),
            ahead=replace(self._calibration(), coverage_95=0.81, count=60),
            origin_lat_deg=FRAME.origin_lat_deg,
            origin_lon_deg=FRAME.origin_lon_deg,
            bounds_m=(0.0, 0.0, WIDTH_M, HEIGHT_M),
            survey="Point Conception",
            capacity=CAPACITY,
            rho0=RHO0,
            configuration_hash="0123456789abcdef",
        )

    def _survey(self) -> SurveyNotice:
        south, west = FRAME.to_geodetic([0.0, 0.0]).tolist()
        north, east = FRAME.to_geodetic([WIDTH_M, HEIGHT_M]).tolist()
        area = np.array([[0, 0], [WIDTH_M, 0], [WIDTH_M, HEIGHT_M], [0, HEIGHT_M]], dtype=float)
        fence = area + np.where(area > 0, 250.0, -250.0)
        return SurveyNotice(
            name="Point Conception",
            variable=self.variable,
            long_name=self.variable.replace("sea_water_", "").replace("_", " "),
            units=self.units,
            valid_range=(None, None),
            rho0=RHO0,
            capacity=CAPACITY,
            bounds_deg=(south, west, north, east),
            area=(_ring(area),),
            land=(_ring(_LAND_M),),
            fence=(_ring(fence),),
        )

    def _plan(self) -> PlanNotice:
        corners = _CORNERS_M[(self._sequence + np.arange(5)) % len(_CORNERS_M)]
        start, *route = _ring(np.vstack([self._here_m, corners]))
        return PlanNotice(
            sequence=self._sequence,
            start_deg=start,
            route_deg=tuple(route),
            is_spot=(True, True, True, True, False),
            mutual_information=20.0 / self._sequence,
            planner="spots",
            reason="path finished",
            expected_rmse=0.05 / self._sequence,
        )

    @property
    def _here_m(self):
        return self._way_m[max(0, self._done - 1)]

    def _health(self) -> HealthNotice:
        lat_deg, lon_deg = FRAME.to_geodetic(self._here_m).tolist()
        good = (self._done, 0, 0, 0, 0)
        return HealthNotice(
            state="exploring",
            reason="in AUTO under our mission",
            mode="AUTO",
            armed=True,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            heading_deg=40.0,
            groundspeed_mps=SPEED_MPS,
            model_time_s=self._time_s(self._done),
            samples=self._done,
            basis_size=len(self._learner.model()),
            rho=0.25,
            rho0=RHO0,
            replans=self._sequence,
            kernel="smooth 2.1 km x 1.7 km",
            calibration=self._calibration(),
            ahead=self._calibration(),
            repairs=0,
            distance_m=self._done * SPACING_M,
            clock_rate=1.0,
            link_ok=True,
            worker_busy=False,
            dropped=0,
            journal="",
            quality={
                "aggregate": (self._done - 2, 0, 2, 0, 0),
                "timing": good,
                "spike": (self._done - 2, 0, 2, 0, 0),
            },
        )


def _along(corners_m):
    """Places every `SPACING_M` along a way of corners (n, 2)."""
    pieces = []
    for start, end in pairwise(corners_m):
        steps = int(np.hypot(*(end - start)) / SPACING_M)
        pieces.append(start + (end - start) * (np.arange(steps) / steps)[:, None])
    return np.vstack(pieces)


def _ring(points_m) -> tuple[tuple[float, float], ...]:
    return tuple((lat, lon) for lat, lon in FRAME.to_geodetic(points_m).tolist())
