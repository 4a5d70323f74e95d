"""A small sea with an island, a fast boat, and an operator: the world of the scenarios."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.effects import Topic
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.mavlink.signing import SigningKey
from autonomy.planning.survey import SurveyArea
from sim.autopilot import Autopilot, Options
from sim.autopilot.missions import MissionItem
from sim.discrete import DiscreteRun
from sim.sensor import Sensor
from sim.vessel import Handling, Position, Vessel

FRAME = LocalFrame(33.5, -118.5)
WIDTH_M, HEIGHT_M = 3000.0, 2400.0
AREA = shapely.box(0.0, 0.0, WIDTH_M, HEIGHT_M)
ISLAND = shapely.box(1300.0, 900.0, 1700.0, 1500.0)
HARBOUR_M = (150.0, -250.0)
SPEED_MPS = 8.0
MANNERS = frozenset({"HEARTBEAT", "STATUSTEXT"})


class Sea:
    """Waves of a kilometre, and the island; in degrees, and sharing nothing with the survey's polygons."""

    south, west = FRAME.to_geodetic(ISLAND.bounds[:2])
    north, east = FRAME.to_geodetic(ISLAND.bounds[2:])

    def value(self, lat_deg: Any, lon_deg: Any, time_s: Any) -> Any:
        return 33.5 + 0.5 * np.sin((lon_deg + 118.5) * 220.0) * np.cos((lat_deg - 33.5) * 290.0)

    def is_land(self, lat_deg: Any, lon_deg: Any) -> Any:
        return (self.south < lat_deg) & (lat_deg < self.north) & (self.west < lon_deg) & (lon_deg < self.east)


def rmse_of(model: Any) -> float:
    """Of a model's map against the truth, over the water."""
    x, y = np.linspace(0.0, WIDTH_M, 40), np.linspace(0.0, HEIGHT_M, 32)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    degrees = FRAME.to_geodetic(grid)
    truth = Sea().value(degrees[..., 0], degrees[..., 1], 0.0)
    mean = model.predict_grid(x, y).mean
    water = ~shapely.contains_xy(ISLAND, grid[..., 0], grid[..., 1])
    return float(np.sqrt(np.mean((mean - truth)[water] ** 2)))


SETTINGS: dict[str, dict[str, Any]] = {
    "mavlink": {"acceptance_radius_m": 15.0},
    "survey": {"area": [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]},
    "sampling": {"spacing_m": 60.0},
    "model": {"capacity": 40, "centring_samples": 8, "history_cells": 400},
    "estimation": {"maximum_points": 80, "iterations": 30},
    "exploration": {"minimum_basis": 24, "maximum_interval_s": None, "outgrown_ratio": None},
    "planning": {"planner": "paper", "lattice": (6, 5), "spots": 6},
    "shore": {"model_period_s": 20.0, "health_period_s": 5.0},
}


def boat(
    *, at_m: tuple[float, float] = HARBOUR_M, seed: int = 0, current: Any = None, **habits: Any
) -> Autopilot:
    """An autopilot that has just been switched on, with a probe called SALT."""
    lat_deg, lon_deg = FRAME.to_geodetic(at_m).tolist()
    handling = Handling(acceleration_mps2=4.0, turn_rate_deg_s=60.0)
    vessel = Vessel(Position(lat_deg, lon_deg), handling=handling, land=Sea())
    if current is not None:
        vessel.current = current
    sensor = Sensor(Sea(), np.random.default_rng(seed), "SALT", 1.5, noise_std=0.02)
    return Autopilot(vessel, sensor, Options(speed_mps=SPEED_MPS, waypoint_radius_m=15.0, **habits))


class Voyage(DiscreteRun):
    """A discrete run, and what a scenario asks of it."""

    configuration: Configuration

    def lines(self, word: str, since: float = 0.0) -> list[str]:
        """Lines of the log that hold a word, written after `since`."""
        return [text for time, text in self.log if time > since and word in text]

    def until(self, word: str, patience_s: float = 3000.0) -> None:
        """Sail until another line of the log holds a word."""
        known = len(self.lines(word))
        reached = self.advance(patience_s, until=lambda: len(self.lines(word)) > known)
        assert reached, f"no {word!r} within {patience_s:g} s; last: {self.log[-4:]}"

    def until_sent(self, kind: str, count: int = 1, patience_s: float = 3000.0) -> None:
        """Sail until the core has sent `count` more messages of a kind."""
        known = len(self.said(kind))
        assert self.advance(patience_s, until=lambda: len(self.said(kind)) >= known + count)

    def said(self, kind: str, since: float = 0.0) -> list[Any]:
        """Messages of a kind that the core has sent after `since`."""
        return [each for time, each in self.sent if time > since and each.get_type() == kind]

    def traffic(self, since: float = 0.0) -> list[str]:
        """Kinds of everything that the core has sent after `since`, manners apart."""
        return [
            each.get_type() for time, each in self.sent if time > since and each.get_type() not in MANNERS
        ]

    @property
    def verified(self) -> int:
        """How many missions of ours were verified on board."""
        return len(self.lines("verified on board"))

    @property
    def plans(self) -> list[Any]:
        return self.published[Topic.PLAN]

    @property
    def health(self) -> Any:
        """As the core would tell it now."""
        self.advance(5.0)
        return self.published[Topic.HEALTH][-1]

    @property
    def samples(self) -> int:
        return int(self.health.samples)

    def on_board_m(self) -> FloatArray:
        """Waypoints of the mission on board, shape (n, 2), local metres."""
        store = self.autopilot.store
        return np.array([FRAME.to_local(*store[k].position) for k in range(1, len(store))]).reshape(-1, 2)

    def plan_m(self, index: int = -1) -> FloatArray:
        """The route of a published plan, shape (n, 2), local metres."""
        return FRAME.to_local(*np.transpose(self.plans[index].route_deg))

    def rmse(self) -> float:
        """Of the newest published model against the truth, over the water."""
        return rmse_of(self.published[Topic.MODEL][-1].model)

    def start(self) -> None:
        """The operator starts the survey; it is under way when this returns."""
        self.start_survey()
        assert self.advance(60.0, until=lambda: bool(self.lines("exploring")))

    def announce_as_operator(self, count: int) -> None:
        """The operator's ground station begins to upload a mission."""
        self.operate(mavlink.MAVLink_mission_count_message(self.autopilot.system_id, 1, count, 0))

    def upload_as_operator(self, *corners_m: tuple[float, float]) -> None:
        """The operator's ground station puts a mission of its own on board, home as its first item."""
        corners = [(0.0, 0.0), *corners_m] if corners_m else []
        self.announce_as_operator(len(corners))
        for seq, corner in enumerate(corners):
            lat_deg, lon_deg = FRAME.to_geodetic(corner).tolist()
            target = (
                self.autopilot.system_id,
                1,
                seq,
                mavlink.MAV_FRAME_GLOBAL,
                mavlink.MAV_CMD_NAV_WAYPOINT,
            )
            place = (round(lat_deg * 1e7), round(lon_deg * 1e7), 0.0, 0)
            self.operate(mavlink.MAVLink_mission_item_int_message(*target, 0, 1, 0, 0, 0, 0, *place))

    def fence(self, *corners_m: tuple[float, float], stops_the_boat: bool = True) -> None:
        """An inclusion fence of these corners is on board, and on."""
        count = float(len(corners_m))
        command = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
        places = [FRAME.to_geodetic(corner).tolist() for corner in corners_m]
        self.autopilot.store.fence = [
            MissionItem(0, command, (count, 0.0, 0.0, 0.0), round(lat * 1e7), round(lon * 1e7), 0.0)
            for lat, lon in places
        ]
        settings = {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 4.0, "AVOID_ENABLE": 3.0 if stops_the_boat else 0.0}
        for name, value in settings.items():
            self.autopilot.parameters.set(name, value)

    def stall_upload_after(self, items: int) -> None:
        """From the next upload on no more than so many items get through."""
        left = iter(range(items))
        self.passes = lambda message: message.get_type() != "MISSION_ITEM_INT" or next(left, None) is not None

    def unstall(self) -> None:
        """Everything gets through again."""
        self.passes = lambda message: True

    def reboot(self, *, keep_mission: bool = True) -> None:
        """The autopilot starts again where the boat is: disarmed, in MANUAL, its clock at zero."""
        old = self.autopilot
        new = boat(at_m=tuple(FRAME.to_local(*old.vessel.position).tolist()))
        if keep_mission:
            for seq in range(len(old.store)):
                new.store.write(seq, old.store[seq])
        self.replace_autopilot(new)


@pytest.fixture
def legs_over_land() -> Callable[[FloatArray], int]:
    """How many legs of a polyline, shape (n, 2), touch the island."""

    def count(points_m: FloatArray) -> int:
        return sum(ISLAND.intersects(shapely.LineString(leg)) for leg in pairwise(points_m))

    return count


@pytest.fixture(scope="session")
def survey() -> SurveyArea:
    return SurveyArea.from_geometry(FRAME, AREA, land=ISLAND, standoff_m=60.0, passage_cells=40)


@pytest.fixture
def make_voyage(survey: SurveyArea) -> Callable[..., Voyage]:
    """`make_voyage(autopilot=None, run_job=…, section={key: value}, …)`."""

    def make(
        autopilot: Autopilot | None = None,
        run_job: Callable[..., Any] = jobs.run,
        seed: int = 0,
        key: SigningKey | None = None,
        **sections: dict[str, Any],
    ) -> Voyage:
        settings: dict[str, Any] = {name: dict(section) for name, section in SETTINGS.items()}
        for name, section in sections.items():
            settings.setdefault(name, {}).update(section)
        configuration = Configuration.model_validate({**settings, "seed": seed})
        core = Core(configuration, survey)
        autopilot = boat(seed=seed) if autopilot is None else autopilot
        made = Voyage(core, autopilot, survey, run_job=run_job, key=key)
        made.configuration = configuration
        return made

    return make


@pytest.fixture
def voyage(make_voyage: Callable[..., Voyage]) -> Voyage:
    """Under way: the first mission is on board and the operator has selected AUTO."""
    made = make_voyage()
    made.start()
    return made
