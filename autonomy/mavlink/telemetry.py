"""What the vehicle tells: its state, and the sensor's readings paired with its position."""

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from statistics import median
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.mavlink.clock import ModelClock
from autonomy.mavlink.pairing import Intake, Observation, Pairing
from autonomy.mavlink.vehicle import StatusText, VehicleState

TIME_UNKNOWN = "time unknown"

_NAME_LENGTH = 10
_REMEMBERED_READINGS = 1024
_TWICE_S = 2.0  # a packet that comes twice does so sooner; its number comes again after 256 others
_KEPT_EVENTS = 256
_MISSED_HEARTBEATS = 5
_FASTEST_HEARTBEAT_S = 0.4  # a vehicle whose clock runs fast isn't lost over one stall of this machine
_EKF_POSITION = mavlink.EKF_POS_HORIZ_ABS
_EKF_CONSTANT_POSITION = mavlink.EKF_CONST_POS_MODE
_NOT_VEHICLES = frozenset(
    {
        mavlink.MAV_TYPE_GCS,
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
        mavlink.MAV_TYPE_GIMBAL,
        mavlink.MAV_TYPE_ADSB,
        mavlink.MAV_TYPE_CAMERA,
        mavlink.MAV_TYPE_ANTENNA_TRACKER,
    }
)


class Telemetry:
    """Follows one vehicle: latches on its autopilot, keeps its state and clock, pairs the sensor's readings.

    The autopilot is the first component (of `vehicle_system_id`, if given) whose heartbeat names one.
    Readings are NAMED_VALUE_FLOAT messages called `sensor_name` from the same system; the autopilot's own are
    timed by their stamp, those of another component, which has another boot clock, and those stamped zero, whose
    sender has none, by their arrival. With `stamped_by_vehicle` other components stamp by the autopilot's clock, and
    all stamps may lie back as far as the water has had to come: they tell when a reading was taken, but not the time.
    """

    def __init__(
        self,
        sensor_name: str,
        pairing_gap_s: float = 1.0,
        vehicle_system_id: int | None = None,
        link_timeout_s: float = 5.0,
        stamped_by_vehicle: bool = False,
        intake: Intake | None = None,
    ) -> None:
        self._sensor_name = sensor_name.encode()[:_NAME_LENGTH]
        self._wanted_system_id = vehicle_system_id
        self._link_timeout_s = link_timeout_s
        self._stamped_by_vehicle = stamped_by_vehicle
        self._clock = ModelClock()
        self._epoch = 0
        self._heard = self._position_time_s = -math.inf
        self._heartbeats: deque[float] = deque(maxlen=_MISSED_HEARTBEATS + 1)
        self._heartbeat_s = 1.0
        self._readings_heard: dict[tuple[int, int, int, str], float] = {}
        self._reached: deque[int] = deque(maxlen=_KEPT_EVENTS)
        self._texts: deque[StatusText] = deque(maxlen=_KEPT_EVENTS)
        self.dropped: Counter[str] = Counter()
        """Readings that taught nothing, counted by reason."""
        self.position_heard = -math.inf
        """Protocol time of the last position of the vehicle."""
        self._pairing = Pairing(pairing_gap_s, self.dropped, intake)
        self.state: VehicleState | None = None
        self._handlers: dict[str, Callable[[float, Any], list[Observation]]] = {
            "GLOBAL_POSITION_INT": self._on_position,
            "GPS_RAW_INT": self._on_gps,
            "SYSTEM_TIME": self._on_system_time,
            "EKF_STATUS_REPORT": self._on_ekf,
            "MISSION_CURRENT": self._on_mission_current,
            "MISSION_ITEM_REACHED": self._on_reached,
            "SYS_STATUS": self._on_sys_status,
            "BATTERY_STATUS": self._on_battery,
            "HOME_POSITION": self._on_home,
            "STATUSTEXT": self._on_text,
        }

    @classmethod
    def of(cls, configuration: Configuration) -> "Telemetry":
        """Following the vehicle and the sensor of a configuration."""
        sensor, link = configuration.sensor, configuration.mavlink
        return cls(
            sensor.message_name,
            pairing_gap_s=configuration.sampling.pairing_gap_s,
            vehicle_system_id=link.system_id,
            link_timeout_s=link.link_timeout_s,
            stamped_by_vehicle=sensor.clock == "vehicle",
            intake=Intake(sensor.intake_forward_m, sensor.intake_starboard_m),
        )

    @property
    def clock_rate(self) -> float:
        """Model seconds per second of protocol time; 1.0 until measured."""
        return self._clock.rate

    @property
    def reboots(self) -> int:
        """How often the vehicle's clock started again."""
        return self._clock.reboots

    @property
    def clock_breaks(self) -> int:
        """How often the vehicle's clock did not go on where it was: reboots, and jumps that were none."""
        return self._clock.breaks

    @property
    def utc_offset_s(self) -> float | None:
        """UTC (Unix seconds) minus model time; None until the vehicle told the date."""
        return self._clock.utc_offset_s

    def model_time(self, now: float) -> float | None:
        """Model time at protocol time `now`, extrapolated from the newest stamp; None before the first."""
        return self._clock.estimate(now)

    def lost(self, now: float) -> bool:
        """Whether the vehicle has been silent for `link_timeout_s` (five heartbeats); False before the first.

        A vehicle whose clock runs fast beats faster and is missed sooner, at most two and a half times.
        """
        if not self._heartbeats:
            return False
        return now - self._heartbeats[-1] > self._heartbeat_s * self._link_timeout_s

    def take_reached(self) -> list[int]:
        """Numbers of the mission items reached since the last call, as the vehicle counts them."""
        reached = list(self._reached)
        self._reached.clear()
        return reached

    def take_texts(self) -> list[StatusText]:
        """What the vehicle wrote to its operator since the last call."""
        texts = list(self._texts)
        self._texts.clear()
        return texts

    def handle(self, now: float, message: Any) -> list[Observation]:
        """Take in one message that arrived at protocol time `now`; returns the observations it completed."""
        kind, self._heard = message.get_type(), now
        if kind == "HEARTBEAT":
            self._on_heartbeat(now, message)
            return []
        if kind == "NAMED_VALUE_FLOAT":
            return self._on_reading(now, message)
        handler = self._handlers.get(kind)
        if handler is not None and self.is_from_autopilot(message):
            return handler(now, message)
        return []

    def is_from_autopilot(self, message: Any) -> bool:
        """Whether the autopilot we follow sent it."""
        state = self.state
        return state is not None and (message.get_srcSystem(), message.get_srcComponent()) == (
            state.system_id,
            state.component_id,
        )

    def _update(self, **changes: Any) -> None:
        assert self.state is not None
        clock = self._clock
        self.state = replace(
            self.state,
            model_time_s=clock.model_time_s,
            reboots=clock.reboots,
            heard=self._heard,
            booted=clock.booted,
            **changes,
        )

    def _model_time(self, now: float, time_boot_ms: int) -> float | None:
        model_time_s = self._clock.observe(now, time_boot_ms)
        self._follow_epoch()
        return model_time_s

    def _follow_epoch(self) -> None:
        if self._clock.epoch != self._epoch:
            self._epoch = self._clock.epoch
            self._pairing.reset()
            self._readings_heard.clear()

    def _on_heartbeat(self, now: float, message: Any) -> None:
        if self.state is None:
            if not self._is_our_vehicle(message):
                return
            self.state = VehicleState(
                message.get_srcSystem(),
                message.get_srcComponent(),
                message.autopilot,
                message.type,
                message.custom_mode,
                _is_armed(message),
                message.system_status,
            )
        elif not self.is_from_autopilot(message):
            return
        self._heartbeats.append(now)
        gaps = [after - before for before, after in pairwise(self._heartbeats)]
        self._heartbeat_s = min(1.0, max(_FASTEST_HEARTBEAT_S, median(gaps))) if gaps else 1.0
        self._update(
            mode=message.custom_mode,
            armed=_is_armed(message),
            system_status=message.system_status,
            heartbeats=self.state.heartbeats + 1,
        )

    def _is_our_vehicle(self, message: Any) -> bool:
        if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID or message.type in _NOT_VEHICLES:
            return False
        return self._wanted_system_id is None or message.get_srcSystem() == self._wanted_system_id

    def _on_position(self, now: float, message: Any) -> list[Observation]:
        model_time_s = self._model_time(now, message.time_boot_ms)
        lat_deg, lon_deg = message.lat * 1e-7, message.lon * 1e-7
        if (message.lat, message.lon) == (0, 0) or abs(lat_deg) > 90 or abs(lon_deg) > 180:
            return []  # ArduPilot sends zeros until its estimator has an origin
        if model_time_s is None:
            return []
        heading_deg = None if message.hdg == 65535 else message.hdg / 100
        if model_time_s >= self._position_time_s:  # not a straggler
            self._position_time_s = model_time_s
            self.position_heard = now
            self._update(
                lat_deg=lat_deg,
                lon_deg=lon_deg,
                heading_deg=heading_deg,
                groundspeed_mps=math.hypot(message.vx, message.vy) / 100,
            )
        return self._pairing.add_fix(model_time_s, lat_deg, lon_deg, heading_deg)

    def _on_reading(self, now: float, message: Any) -> list[Observation]:
        if _name(message.name) != self._sensor_name:
            return []
        if self.state is None or message.get_srcSystem() != self.state.system_id:
            self.dropped["not from our vehicle"] += 1
            return []
        model_time_s = self._time_of_reading(now, message)
        if model_time_s is None:
            self.dropped[TIME_UNKNOWN] += 1
            return []
        if self._is_repeat(now, message):
            self.dropped["repeated"] += 1
            return []
        return self._pairing.add_reading(model_time_s, message.value)

    def _time_of_reading(self, now: float, message: Any) -> float | None:
        if message.time_boot_ms == 0:
            return self._clock.estimate(now)
        if self._stamped_by_vehicle:
            return self._clock.translate(now, message.time_boot_ms)
        if self.is_from_autopilot(message):
            return self._model_time(now, message.time_boot_ms)
        return self._clock.estimate(now)

    def _is_repeat(self, now: float, message: Any) -> bool:
        # Senders without a clock stamp zero; only the packet's number tells their readings apart, for a while.
        has_clock = message.time_boot_ms != 0
        sequence = 0 if has_clock else message.get_seq()
        # As text, in which a NaN equals itself.
        key = (message.get_srcComponent(), message.time_boot_ms, sequence, repr(message.value))
        heard = self._readings_heard.pop(key, None)
        self._readings_heard[key] = now
        if len(self._readings_heard) > _REMEMBERED_READINGS:
            del self._readings_heard[next(iter(self._readings_heard))]
        return heard is not None and (has_clock or now - heard <= _TWICE_S)

    def _on_gps(self, now: float, message: Any) -> list[Observation]:
        self._update(gps_fix_type=message.fix_type)
        return []

    def _on_system_time(self, now: float, message: Any) -> list[Observation]:
        self._clock.observe_utc(now, message.time_boot_ms, message.time_unix_usec)
        self._follow_epoch()
        return []

    def _on_ekf(self, now: float, message: Any) -> list[Observation]:
        self._update(
            ekf_ok=bool(message.flags & _EKF_POSITION) and not message.flags & _EKF_CONSTANT_POSITION
        )
        return []

    def _on_mission_current(self, now: float, message: Any) -> list[Observation]:
        # The extension fields of old autopilots arrive as zeros, 65535 says unknown.
        total = message.total if message.total not in (0, 65535) else None
        self._update(mission_current=message.seq, mission_total=total, mission_state=message.mission_state)
        return []

    def _on_reached(self, now: float, message: Any) -> list[Observation]:
        self._reached.append(message.seq)
        return []

    def _on_sys_status(self, now: float, message: Any) -> list[Observation]:
        if message.voltage_battery not in (0, 65535):
            self._update(battery_voltage_v=message.voltage_battery / 1000)
        if message.battery_remaining >= 0:
            self._update(battery_remaining=message.battery_remaining / 100)
        return []

    def _on_battery(self, now: float, message: Any) -> list[Observation]:
        if message.id != 0:
            return []
        # -1 is unknown; energy comes in hectojoules, charge in mAh.
        told = {
            "battery_remaining": message.battery_remaining / 100,
            "battery_consumed_j": message.energy_consumed * 100.0,
            "battery_drawn_c": message.current_consumed * 3.6,
        }
        self._update(**{name: value for name, value in told.items() if value >= 0})
        return []

    def _on_home(self, now: float, message: Any) -> list[Observation]:
        lat_deg, lon_deg = message.latitude * 1e-7, message.longitude * 1e-7
        if (message.latitude, message.longitude) != (0, 0) and abs(lat_deg) <= 90 and abs(lon_deg) <= 180:
            self._update(home_deg=(lat_deg, lon_deg))
        return []

    def _on_text(self, now: float, message: Any) -> list[Observation]:
        text = message.text if isinstance(message.text, str) else message.text.decode(errors="replace")
        self._texts.append(StatusText(message.severity, text.rstrip("\0")))
        return []


def _is_armed(heartbeat: Any) -> bool:
    return bool(heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)


def _name(name: bytes | str) -> bytes:
    """A message's name field, as bytes without padding."""
    raw = name.encode() if isinstance(name, str) else bytes(name)
    return raw.split(b"\0", 1)[0][:_NAME_LENGTH]
