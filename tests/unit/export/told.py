"""A survey as a vehicle would have told it, and its recording."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from autonomy.effects import Topic
from autonomy.geometry import LocalFrame
from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.shore.recording import Recorder
from autonomy.wire import (
    HealthNotice,
    LogBatch,
    LogNotice,
    Message,
    ModelSnapshot,
    ObservationBatch,
    ObservationNotice,
    PlanNotice,
    SurveyNotice,
    encode,
    key,
    schema,
)

UTC_S = 1_750_000_000.0
"""2025-06-15T15:06:40Z: UTC when the vehicle's clock shows 0."""

RUN = 123456789
FRAME = LocalFrame(34.4, -120.5)
BOUNDS_M = (0.0, 0.0, 12_000.0, 9_000.0)
ISLAND_M = ((5000.0, 3000.0), (7000.0, 3000.0), (7000.0, 5000.0), (5000.0, 5000.0))
FIGURES = CalibrationFigures(0.942, 1.08, 1.31, 400)
LATE_S = 3.0
"""What all that is told takes to arrive."""


def degrees(points_m: Any) -> tuple[tuple[float, float], ...]:
    return tuple((lat, lon) for lat, lon in FRAME.to_geodetic(points_m).tolist())


def track(count: int) -> np.ndarray:
    along = np.linspace(0.0, 20.0, count)
    return np.stack([6000.0 + 5500.0 * np.cos(along), 4500.0 + 4000.0 * np.sin(1.7 * along)], axis=-1)


def truth(points: np.ndarray) -> np.ndarray:
    x, y = np.moveaxis(points, -1, 0)
    return 33.0 + 0.7 * np.sin(x / 1900.0) * np.cos(y / 2300.0)


def survey() -> SurveyNotice:
    x_min, y_min, x_max, y_max = BOUNDS_M
    area = degrees([(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)])
    lat, lon = np.transpose(area)
    return SurveyNotice(
        name="off Point Conception",
        variable="sea_water_practical_salinity",
        long_name="sea water practical salinity",
        units="1",
        valid_range=(0.0, 42.0),
        rho0=0.6,
        capacity=40,
        bounds_deg=(lat.min(), lon.min(), lat.max(), lon.max()),
        area=(area,),
        land=(degrees(ISLAND_M),),
    )


def model(sequence: int, gp: SparseOnlineGP, at: float, *, knows_utc: bool = True) -> ModelSnapshot:
    return ModelSnapshot(
        vehicle="boat1",
        sequence=sequence,
        software_version="0.1.0",
        variable="sea_water_practical_salinity",
        units="1",
        model=gp.model(),
        model_time_s=at,
        utc_s=UTC_S + at if knows_utc else None,
        samples=sequence * 40,
        rho=0.25,
        replans=3,
        calibration=FIGURES,
        ahead=FIGURES,
        origin_lat_deg=FRAME.origin_lat_deg,
        origin_lon_deg=FRAME.origin_lon_deg,
        bounds_m=BOUNDS_M,
        survey="off Point Conception",
        capacity=40,
        rho0=0.6,
        configuration_hash="0123456789abcdef",
        run=RUN,
    )


def health(at: float | None, place_m: Any, run: int = RUN) -> HealthNotice:
    ((lat, lon),) = degrees([place_m])
    return HealthNotice(
        state="EXPLORING",
        reason="under way",
        mode="AUTO",
        armed=True,
        lat_deg=lat,
        lon_deg=lon,
        heading_deg=90.0,
        groundspeed_mps=1.5,
        model_time_s=at,
        samples=400,
        basis_size=40,
        rho=0.25,
        rho0=0.6,
        replans=3,
        kernel="smooth 1.5 km",
        calibration=FIGURES,
        ahead=FIGURES,
        repairs=0,
        distance_m=4321.0,
        clock_rate=1.0,
        link_ok=True,
        worker_busy=False,
        dropped=0,
        journal="",
        quality={"aggregate": (400, 0, 2, 1, 0)},
        run=run,
    )


def plan(sequence: int, run: int = RUN) -> PlanNotice:
    corners = degrees([(2000.0, 1000.0), (9000.0, 2000.0), (8000.0, 7000.0 + 100.0 * sequence)])
    return PlanNotice(
        sequence,
        degrees([(0.0, 0.0)])[0],
        corners,
        (True, False, True),
        4.5,
        "paper",
        "path finished",
        run=run,
    )


def readings(points: np.ndarray, times: np.ndarray) -> list[ObservationNotice]:
    """One suspect, and one that is missing, among the good ones."""
    found = [
        ObservationNotice(float(at), lat, lon, float(value), 1, (1,) * 7)
        for at, (lat, lon), value in zip(times, degrees(points), truth(points), strict=True)
    ]
    found[7] = replace(found[7], flag=3, checks=(1, 1, 1, 1, 3, 1, 2))
    found[9] = replace(found[9], value=math.nan, flag=9, checks=(1, 9, 2, 2, 2, 2, 2))
    return found


class Told:
    """What a vehicle tells in `count` batches of 40 readings, a minute each; `messages` are (received UTC, value)."""

    def __init__(self, count: int = 12, *, knows_utc: bool = True) -> None:
        points, times = track(40 * count), np.arange(40 * count) * 1.5 + 10.0
        self.readings = readings(points, times)
        self.models: list[ModelSnapshot] = []
        self.plans = [plan(0), plan(1)]
        self.messages: list[tuple[float, Message]] = []
        gp = SparseOnlineGP(Hyperparameters(0.5, 1e-3, (1500.0, 1200.0)), 40, prior_mean=33.0)
        self._say(0.0, survey())
        self._say(0.0, health(None, points[0]))
        for i in range(count):
            rows = slice(40 * i, 40 * (i + 1))
            end = float(times[rows][-1])
            for point, one in zip(points[rows], self.readings[rows], strict=True):
                if math.isfinite(one.value):
                    gp.update(point, one.value)
            if i % 6 == 0:
                self._say(end, self.plans[i // 6 % 2])
            self._say(end, health(end, points[rows][-1]))
            batch = ObservationBatch(RUN, 40 * i, 0, 40 * (i + 1), tuple(self.readings[rows]))
            self._say(end, batch)
            utc_s = UTC_S + end if knows_utc else None
            self._say(end, LogBatch(RUN, i, 0, i + 1, (LogNotice("info", f"minute {i}", utc_s),)))
            self.models.append(model(i + 1, gp, end, knows_utc=knows_utc))
            self._say(end, self.models[-1])

    def _say(self, at: float, value: Message) -> None:
        self.messages.append((UTC_S + at + LATE_S, value))


def topic_of(value: Message) -> Topic:
    return {
        ModelSnapshot: Topic.MODEL,
        PlanNotice: Topic.PLAN,
        ObservationBatch: Topic.OBSERVATIONS,
        HealthNotice: Topic.HEALTH,
        LogBatch: Topic.LOG,
        SurveyNotice: Topic.SURVEY,
    }[type(value)]


def record(
    folder: Path, messages: list[tuple[float, Message]], vehicle: str = "boat1", *, packed: bool = False
) -> Path:
    """Keep messages in a recording, as the shore's subscriber would hand them over."""
    with Recorder(folder) as recorder:
        for received_utc_s, value in messages:
            topic = topic_of(value)
            if isinstance(value, ModelSnapshot):
                value = replace(value, vehicle=vehicle)
            encoding = f"application/cbor;{schema(topic)}"
            recorder.write(received_utc_s, key(vehicle, topic), encoding, encode(value, packed=packed))
    return folder
