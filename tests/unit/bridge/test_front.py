"""A boat sails over a front and back. Where does the map put it?

The truth is made apart from the code under test: the sensor's response is the textbook's solution for a step, the
hose a delay, positions are of LocalFrame. Between it and the observations stand the bridge and the service's telemetry,
with two clocks and a link that delays.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.bridge.bridge import Bridge
from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.geometry import LocalFrame
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.pairing import Intake, Observation
from autonomy.mavlink.telemetry import Telemetry

from .examples import bridge_configuration

FRAME = LocalFrame(59.0, 5.0)
SPEED_MPS, INTERVAL_S = 1.5, 1.0
SAMPLE_M = SPEED_MPS * INTERVAL_S
DELAY_S, RESPONSE_S, AHEAD_M = 8.0, 5.0, 3.0
BEARING_DEG = 60.0
BOOTED_S = 4000.0
"""On the bridge's clock."""


class Voyage:
    """Straight over a front 150 m away at 0 m, there or back, at a constant speed."""

    def __init__(self, configuration: BridgeConfiguration, telemetry: Telemetry, way: float) -> None:
        self._way = way
        self._rng = np.random.default_rng(7)
        self._bridge = Bridge(configuration, BOOTED_S)
        self._bridge.port_up(BOOTED_S)
        self._telemetry = telemetry
        self._boat, self._companion = Codec(1, 1), Codec(1, 158)
        self.observations: list[Observation] = []
        self._say(BOOTED_S, mavlink.MAVLink_heartbeat_message(11, 3, 81, 10, 4, 3))

    def sail(self) -> list[Observation]:
        for tick in range(1, 800):
            time_s = 0.25 * tick
            self._say(BOOTED_S + time_s, self._position(time_s))
            if (time_s + 0.1) % INTERVAL_S < 0.25:
                line = f"{self._sensor(time_s + 0.1):.4f},0"
                for message in self._bridge.on_line(BOOTED_S + time_s + 0.1, line).messages:
                    self._hear(time_s + 0.11, self._companion, message)
        return self.observations

    def _along_m(self, time_s: float) -> float:
        """Of the antenna, from the front, in the direction of the first way."""
        return self._way * (SPEED_MPS * time_s - 150.0)

    def _sensor(self, time_s: float) -> float:
        """34 before the front and 35 behind it, as hose and response let the sensor say it, with a little noise."""
        crossed_s = (150.0 - AHEAD_M) / SPEED_MPS + DELAY_S
        passed_s = time_s - crossed_s
        share = -math.expm1(-passed_s / RESPONSE_S) if passed_s > 0.0 else 0.0
        share = share if self._way > 0.0 else 1.0 - share
        return 34.0 + share + 0.003 * float(self._rng.standard_normal())

    def _position(self, time_s: float) -> object:
        bearing = math.radians(BEARING_DEG)
        along_m = self._along_m(time_s)
        lat, lon = FRAME.to_geodetic((along_m * math.sin(bearing), along_m * math.cos(bearing)))
        heading_deg = BEARING_DEG if self._way > 0.0 else BEARING_DEG + 180.0
        fields = (round(time_s * 1000), round(lat * 1e7), round(lon * 1e7), 0, 0, 75, 130, 0)
        return mavlink.MAVLink_global_position_int_message(*fields, round(100 * heading_deg))

    def _say(self, host_s: float, message: object) -> None:
        """The autopilot speaks: to the bridge over a link that delays, to the service at once."""
        (heard,) = Codec(9, 9).decode(self._boat.encode(message))
        self._bridge.on_message(host_s + float(self._rng.exponential(0.02)), heard)
        self.observations += self._telemetry.handle(host_s - BOOTED_S, heard)

    def _hear(self, time_s: float, sender: Codec, message: object) -> None:
        (heard,) = Codec(9, 9).decode(sender.encode(message))
        self.observations += self._telemetry.handle(time_s, heard)


def front_m(observations: list[Observation]) -> float:
    """Where along the way the readings go through 34.5."""
    bearing = math.radians(BEARING_DEG)
    east_north = FRAME.to_local([o.lat_deg for o in observations], [o.lon_deg for o in observations])
    along_m = east_north @ (math.sin(bearing), math.cos(bearing))
    for k, (before, after) in enumerate(pairwise(o.value for o in observations)):
        if (before - 34.5) * (after - 34.5) <= 0.0:
            share = (34.5 - before) / (after - before)
            return float(along_m[k] + share * (along_m[k + 1] - along_m[k]))
    raise AssertionError("the front is nowhere")


def sailed(value: dict[str, object], telemetry: Telemetry, way: float) -> float:
    configuration = bridge_configuration(values={"SALT": {"field": 1, **value}})
    return front_m(Voyage(configuration, telemetry, way).sail())


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["there", "back"])
def test_uncorrected_the_front_is_carried_along(way: float) -> None:
    """By the hose and the response, less what the intake is ahead: 8 s + 5 s ln 2, 1.5 m/s, 3 m."""
    carried_m = SPEED_MPS * (DELAY_S + RESPONSE_S * math.log(2.0)) - AHEAD_M
    assert sailed({}, Telemetry("SALT"), way) == pytest.approx(way * carried_m, abs=1.0)
    assert carried_m > 9 * SAMPLE_M


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["there", "back"])
def test_corrected_it_is_where_it_is_to_within_one_sample(way: float) -> None:
    correction = {"delay_s": DELAY_S, "response_s": RESPONSE_S, "response": "sharpen"}
    telemetry = Telemetry("SALT", stamped_by_vehicle=True, intake=Intake(AHEAD_M, 0.0))
    assert abs(sailed(correction, telemetry, way)) < SAMPLE_M


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["there", "back"])
def test_a_shift_alone_leaves_a_third_of_the_response(way: float) -> None:
    correction = {"delay_s": DELAY_S, "response_s": RESPONSE_S}
    telemetry = Telemetry("SALT", stamped_by_vehicle=True, intake=Intake(AHEAD_M, 0.0))
    left_m = -SPEED_MPS * RESPONSE_S * (1.0 - math.log(2.0))
    assert sailed(correction, telemetry, way) == pytest.approx(way * left_m, abs=0.5)
