"""A vehicle that talks nonsense with a sound checksum: the service survives it, and asks no less to be called.

HALOCLINE_LIES: how many surveys; without it two.
"""

import os
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from sim.autopilot import Autopilot, Mode, Options
from sim.autopilot.missions import MissionItem
from sim.discrete import DiscreteRun
from sim.sensor import Sensor
from sim.vessel import Handling, Position, Vessel

from .decoders.survey import AREA, FRAME, SURVEY

SURVEYS = range(int(os.environ.get("HALOCLINE_LIES", "2")))
SETTINGS: dict[str, Any] = {
    "survey": {"area": AREA},
    "model": {"capacity": 20, "centring_samples": 6, "history_cells": 200},
    "shore": {"model_period_s": 30.0, "health_period_s": 5.0},
    "exploration": {"stall_s": 60.0},
}
INTEGERS = [0, 1, -1, 127, -128, 32767, -32768, 2**31 - 1, -(2**31), 900_000_000, 1_800_000_000]
FLOATS = [0.0, -0.0, 1.0, -1.0, 3.4e38, -3.4e38, 1e-45, np.nan, np.inf, -np.inf]


class Sea:
    """The same everywhere."""

    def value(self, lat_deg: Any, lon_deg: Any, time_s: Any) -> Any:
        return 33.5 + 10.0 * (np.asarray(lat_deg) - 33.5)


def near_by(name: str, request: jobs.ExploreRequest, survey: SurveyArea) -> jobs.ExploreResult:
    """Two corners close to the boat."""
    plan = request.plan
    if plan is None:
        raise ValueError("nothing to plan")
    route = np.clip(plan.start_m + np.array([[40.0, 10.0 * (plan.seed % 5)], [10.0, 60.0]]), 10.0, 1900.0)
    return jobs.ExploreResult(
        None, Plan(plan.start_m, route, np.ones(2, bool), 1.0, "paper", plan.reason), None
    )


class Lying(DiscreteRun):
    """Of what comes to the core a share has other content than was said."""

    rng: np.random.Generator
    share = 0.0
    lies = 0

    def _take(self, packets: list[tuple[Any, bytes]]) -> None:
        super()._take([(client, self._perhaps_false(data)) for client, data in packets])

    def _perhaps_false(self, data: bytes) -> bytes:
        if self.share == 0.0 or self.rng.random() >= self.share:
            return data
        self.lies += 1
        kind = mavlink.mavlink_map[int.from_bytes(data[7:10], "little")]
        payload = bytearray(data[10 : 10 + data[1]].ljust(kind.unpacker.size, b"\0"))
        place = int(self.rng.integers(len(payload)))
        match self.rng.integers(4):
            case 0:
                payload[place] ^= 1 << int(self.rng.integers(8))
            case 1:
                payload[place] = int(self.rng.integers(256))
            case 2:
                place -= place % 4
                number = INTEGERS[self.rng.integers(len(INTEGERS))]
                payload[place : place + 4] = (number % 2**32).to_bytes(4, "little")[: len(payload) - place]
            case 3:
                place -= place % 4
                number = np.float32(FLOATS[self.rng.integers(len(FLOATS))])
                payload[place : place + 4] = number.tobytes()[: len(payload) - place]
        head = data[:1] + bytes([len(payload)]) + data[2:10]
        crc = mavlink.x25crc(head[1:] + payload)
        crc.accumulate(bytes([kind.crc_extra]))
        return head + bytes(payload) + int(crc.crc).to_bytes(2, "little")


def voyage(seed: int) -> Lying:
    rng = np.random.default_rng(seed)
    start = Position(*FRAME.to_geodetic((900.0, 900.0)).tolist())
    vessel = Vessel(start, handling=Handling(acceleration_mps2=4.0, turn_rate_deg_s=90.0))
    autopilot = Autopilot(
        vessel, Sensor(Sea(), rng, "SALT", 1.0, 0.02), Options(speed_mps=8.0, waypoint_radius_m=10.0)
    )
    command = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    corners = [
        FRAME.to_geodetic(corner).tolist() for corner in ((-50, -50), (2950, -50), (2950, 1950), (-50, 1950))
    ]
    autopilot.store.fence = [
        MissionItem(0, command, (4.0, 0.0, 0.0, 0.0), round(lat * 1e7), round(lon * 1e7), 0.0)
        for lat, lon in corners
    ]
    for name, value in {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 6.0, "FENCE_RADIUS": 5000.0}.items():
        autopilot.parameters.set(name, value)
    mode = "full" if seed % 4 == 3 else "missions"
    configuration = Configuration.model_validate({**SETTINGS, "authority": {"mode": mode}})
    run = Lying(Core(configuration, SURVEY), autopilot, SURVEY, job_s=0.5, run_job=near_by)
    run.rng = rng
    return run


@pytest.mark.parametrize("seed", SURVEYS)
def test_lies_end_no_survey(seed: int) -> None:
    run = voyage(seed)
    run.share = 0.02 if seed % 2 else 0.0
    run.advance(20.0)
    run.share = 0.05
    for _ in range(10):
        run.arm()
        run.select(Mode.AUTO)
        run.advance(20.0)
    run.share = 0.0
    run.autopilot.reports.failsafe = False
    run.advance(30.0)
    assert run.lies > 50
    assert any("exploring" in text for _, text in run.log), "or this would prove nothing"
    heard = len(run.sent)
    run.advance(5.0)
    assert len(run.sent) >= heard + 4, "it still lives: a heartbeat every second"
