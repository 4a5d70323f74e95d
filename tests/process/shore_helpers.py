"""What the tests of publisher and shore share: a model, values to publish, free ports, a router."""

import contextlib
import json
import queue
import socket
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import zenoh

from autonomy.effects import Topic
from autonomy.endpoints import Certificates, session_settings
from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.shell.publisher import Publisher
from autonomy.wire import HealthNotice, ModelSnapshot, ObservationNotice, PlanNotice, SurveyNotice, decode

SOON_S = 60.0


def free_endpoint() -> str:
    """A loopback address nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def session(mode: str, connect=(), listen=()) -> Iterator[zenoh.Session]:
    """A bare zenoh session, as a stranger's program would open it."""
    config = zenoh.Config()
    for path, value in session_settings(mode, connect, listen).items():
        config.insert_json5(path, json.dumps(value))
    with zenoh.open(config) as opened:
        yield opened


def learnt_model(seed: int = 0):
    """A model of a wavy field seen along a track through 12 × 9 km, and the track."""
    rng = np.random.default_rng(seed)
    gp = SparseOnlineGP(Hyperparameters(0.5, 1e-3, (1500.0, 1200.0)), 60, prior_mean=33.0)
    points = np.cumsum(rng.normal(0, 400, (400, 2)), axis=0) % [12_000, 9_000]
    for point in points:
        gp.update(point, field(point) + rng.normal(0, 0.03))
    return gp.model(), points


def field(points):
    """The wavy truth, in the units of salinity."""
    x, y = np.moveaxis(np.asarray(points), -1, 0)
    return 33.0 + 0.7 * np.sin(x / 1900.0) * np.cos(y / 2300.0)


def model_snapshot(model, sequence: int = 0, vehicle: str = "boat1") -> ModelSnapshot:
    """A snapshot of a model, off Point Conception."""
    return ModelSnapshot(
        vehicle=vehicle,
        sequence=sequence,
        software_version="0.1.0",
        variable="sea_water_practical_salinity",
        units="1",
        model=model,
        model_time_s=1000.0 + sequence,
        utc_s=1.7e9 + sequence,
        samples=400,
        rho=0.25,
        replans=3,
        calibration=CalibrationFigures(0.942, 1.08, 1.31, 400),
        ahead=CalibrationFigures(0.907, 1.4, 0.52, 43),
        origin_lat_deg=34.4,
        origin_lon_deg=-120.5,
        bounds_m=(0.0, 0.0, 12_000.0, 9_000.0),
        survey="off Point Conception",
        capacity=60,
        rho0=0.6,
        configuration_hash="0123456789abcdef",
    )


def plan_notice(sequence: int = 0) -> PlanNotice:
    """A plan of three corners, two of them spots."""
    corners = ((34.41, -120.49), (34.42, -120.47), (34.44, -120.46))
    return PlanNotice(sequence, (34.4, -120.5), corners, (True, False, True), 4.5, "paper", "path finished")


def survey_notice() -> SurveyNotice:
    """A survey with an island."""
    area = ((34.4, -120.5), (34.4, -120.37), (34.48, -120.37), (34.48, -120.5))
    island = ((34.43, -120.45), (34.43, -120.44), (34.44, -120.44))
    return SurveyNotice(
        name="off Point Conception",
        variable="sea_water_practical_salinity",
        long_name="sea water practical salinity",
        units="1",
        valid_range=(0.0, 42.0),
        rho0=0.6,
        capacity=60,
        bounds_deg=(34.4, -120.5, 34.48, -120.37),
        area=(area,),
        land=(island,),
    )


def health_notice(reason: str = "") -> HealthNotice:
    """A vehicle under way."""
    return HealthNotice(
        state="EXPLORING",
        reason=reason,
        mode="AUTO",
        armed=True,
        lat_deg=34.41,
        lon_deg=-120.49,
        heading_deg=88.0,
        groundspeed_mps=1.5,
        model_time_s=1000.0,
        samples=400,
        basis_size=60,
        rho=0.25,
        rho0=0.6,
        replans=3,
        kernel="smooth 1.5 km x 1.2 km",
        calibration=CalibrationFigures(0.942, 1.08, 1.31, 400),
        ahead=CalibrationFigures(0.907, 1.4, 0.52, 43),
        repairs=0,
        journal="",
        distance_m=4321.0,
        clock_rate=1.0,
        link_ok=True,
        worker_busy=False,
        dropped=0,
        quality={"aggregate": (400, 0, 2, 1, 0)},
    )


def observation(number: int) -> ObservationNotice:
    """The number-th reading of a run."""
    return ObservationNotice(float(number), 34.4 + 1e-4 * number, -120.5, 33.0 + 1e-3 * number, 1, (1,) * 7)


@contextlib.contextmanager
def router(endpoint: str) -> Iterator[zenoh.Session]:
    """A router at an address."""
    with session("router", listen=[endpoint]) as opened:
        yield opened


@contextlib.contextmanager
def publisher(
    endpoint: str, vehicle: str = "boat1", backlog: int = 5000, certificates: Certificates | None = None
) -> Iterator[Publisher]:
    """A started publisher that dials an address."""
    boat = Publisher(vehicle, [endpoint], backlog=backlog, certificates=certificates)
    boat.start()
    try:
        yield boat
    finally:
        boat.stop(SOON_S)


@dataclass(frozen=True)
class Heard:
    """One sample, or one change of presence."""

    key: str
    payload: bytes
    encoding: str
    appeared: bool


class Listener:
    """Everything a bare zenoh session hears under usv/."""

    def __init__(self, on: zenoh.Session):
        self._session = on
        self._heard: queue.Queue[Heard] = queue.Queue()
        self._passed: list[Heard] = []

    def __enter__(self) -> "Listener":
        self._session.declare_subscriber("usv/*/*", self._on_sample)
        self._session.liveliness().declare_subscriber("usv/*/alive", self._on_sample, history=True)
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def _on_sample(self, sample: zenoh.Sample) -> None:
        put = sample.kind == zenoh.SampleKind.PUT
        self._heard.put(Heard(str(sample.key_expr), bytes(sample.payload), str(sample.encoding), put))

    def wait(self, key: str) -> Heard:
        """The next thing heard under a key."""
        for index, heard in enumerate(self._passed):
            if heard.key == key:
                return self._passed.pop(index)
        while True:
            heard = self._heard.get(timeout=SOON_S)
            if heard.key == key:
                return heard
            self._passed.append(heard)

    def ask(self, selector: str) -> dict:
        """What a vehicle answers to a query, decoded."""
        replies = list(self._session.get(selector, timeout=SOON_S))
        topics = [Topic(str(reply.ok.key_expr).split("/")[-1]) for reply in replies]
        pairs = zip(topics, replies, strict=True)
        return {topic: decode(topic, bytes(reply.ok.payload)) for topic, reply in pairs}
