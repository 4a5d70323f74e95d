"""What the autopilot tells: telemetry messages built from the state of the boat."""

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot.modes import MissionState, Mode, base_mode
from sim.autopilot.navigation import Navigator
from sim.vessel import Position

CAPABILITIES = (
    mav.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | mav.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mav.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mav.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_FIRMWARE_VERSION = 4 << 24 | 7 << 16 | mav.FIRMWARE_VERSION_TYPE_OFFICIAL
_EKF_READY = 0x33F  # attitude, velocities, relative and absolute position, predictions of both
_EKF_WAITING = 0x0A7  # attitude, velocities, height; constant-position mode
_INT16_MAX = 32_767  # a current beyond 327 A is told as that
_SENSORS = (
    mav.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mav.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mav.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mav.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mav.MAV_SYS_STATUS_SENSOR_GPS
    | mav.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
    | mav.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | mav.MAV_SYS_STATUS_SENSOR_YAW_POSITION
    | mav.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    | mav.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mav.MAV_SYS_STATUS_AHRS
    | mav.MAV_SYS_STATUS_LOGGING
    | mav.MAV_SYS_STATUS_SENSOR_BATTERY
    | mav.MAV_SYS_STATUS_PREARM_CHECK
)


class Reports:
    """Builds messages by id; `time_boot_ms` counts simulated milliseconds since boot, modulo 2^32."""

    def __init__(
        self, navigator: Navigator, start_utc_s: float, system_id: int, boot_clock_s: float = 0.0
    ) -> None:
        self._navigator = navigator
        self._vessel = navigator.vessel
        self._start_utc_s = start_utc_s
        self._system_id = system_id
        self._boot_clock_s = boot_clock_s
        self.failsafe = False
        self._by_id: dict[int, Callable[[], Any]] = {
            mav.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self.global_position,
            mav.MAVLINK_MSG_ID_GPS_RAW_INT: self.gps_raw,
            mav.MAVLINK_MSG_ID_SYS_STATUS: self.sys_status,
            mav.MAVLINK_MSG_ID_BATTERY_STATUS: self.battery_status,
            mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self.ekf_status,
            mav.MAVLINK_MSG_ID_SYSTEM_TIME: self.system_time,
            mav.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.autopilot_version,
            mav.MAVLINK_MSG_ID_ATTITUDE: self.attitude,
            mav.MAVLINK_MSG_ID_VFR_HUD: self.vfr_hud,
            mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self.global_origin,
            mav.MAVLINK_MSG_ID_MISSION_CURRENT: self.mission_current,
            mav.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: self.nav_controller_output,
        }

    def build(self, message_id: int) -> Any | None:
        """The message with this id as of now; None if it is not one of ours."""
        builder = self._by_id.get(message_id)
        return None if builder is None else builder()

    @property
    def time_boot_ms(self) -> int:
        """Simulated milliseconds since boot, as a uint32."""
        return round((self._boot_clock_s + self._vessel.time_s) * 1e3) & 0xFFFFFFFF

    @property
    def _place(self) -> tuple[int, int]:
        return _scaled(self._vessel.position)

    def heartbeat(self) -> Any:
        """HEARTBEAT of a surface boat under ArduPilot."""
        navigator = self._navigator
        if self.failsafe:
            status = mav.MAV_STATE_CRITICAL
        elif not navigator.position_ok:
            status = mav.MAV_STATE_CALIBRATING
        else:
            status = mav.MAV_STATE_ACTIVE if navigator.armed else mav.MAV_STATE_STANDBY
        return mav.MAVLink_heartbeat_message(
            mav.MAV_TYPE_SURFACE_BOAT,
            mav.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode(navigator.mode, navigator.armed),
            int(navigator.mode),
            status,
            3,
        )

    def global_position(self) -> Any:
        """GLOBAL_POSITION_INT; velocities in cm/s, heading in hundredths of a degree."""
        east, north = self._vessel.velocity_mps
        heading = round(self._vessel.heading_deg * 100.0) % 36000
        return mav.MAVLink_global_position_int_message(
            self.time_boot_ms, *self._place, 0, 0, round(north * 100.0), round(east * 100.0), 0, heading
        )

    def gps_raw(self) -> Any:
        """GPS_RAW_INT of a receiver with a good fix."""
        vessel = self._vessel
        return mav.MAVLink_gps_raw_int_message(
            round(vessel.time_s * 1e6),
            mav.GPS_FIX_TYPE_3D_FIX,
            *self._place,
            0,
            121,
            200,
            round(vessel.ground_speed_mps * 100.0),
            round(vessel.course_deg * 100.0) % 36000,
            12,
        )

    def sys_status(self) -> Any:
        """SYS_STATUS; the pre-arm bit says whether the position estimate is there."""
        battery = self._vessel.battery
        healthy = _SENSORS
        if not self._navigator.position_ok:
            healthy &= ~(mav.MAV_SYS_STATUS_PREARM_CHECK | mav.MAV_SYS_STATUS_AHRS)
        return mav.MAVLink_sys_status_message(
            _SENSORS,
            _SENSORS,
            healthy,
            120,
            round(battery.voltage_v * 1e3),
            min(round(battery.current_a * 1e2), _INT16_MAX),
            round(battery.remaining * 1e2),
            *(0,) * 6,
        )

    def battery_status(self) -> Any:
        """BATTERY_STATUS; energy in hectojoules, charge in mAh."""
        battery = self._vessel.battery
        volts = [round(battery.voltage_v * 1e3), *[0xFFFF] * 9]
        return mav.MAVLink_battery_status_message(
            0,
            mav.MAV_BATTERY_FUNCTION_ALL,
            mav.MAV_BATTERY_TYPE_LIPO,
            0x7FFF,
            volts,
            min(round(battery.current_a * 1e2), _INT16_MAX),
            round(battery.drawn_c / 3.6),
            round(battery.used_wh * 36.0),
            round(battery.remaining * 1e2),
        )

    def ekf_status(self) -> Any:
        """EKF_STATUS_REPORT."""
        flags = _EKF_READY if self._navigator.position_ok else _EKF_WAITING
        return mav.MAVLink_ekf_status_report_message(flags, 0.01, 0.01, 0.01, 0.01, 0.0)

    def system_time(self) -> Any:
        """SYSTEM_TIME: UTC at the start plus simulated time."""
        utc_us = round((self._start_utc_s + self._vessel.time_s) * 1e6)
        return mav.MAVLink_system_time_message(utc_us, self.time_boot_ms)

    def home_position(self) -> Any:
        """HOME_POSITION."""
        place = _scaled(self._navigator.store.home)
        return mav.MAVLink_home_position_message(
            *place, 0, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0
        )

    def global_origin(self) -> Any:
        """GPS_GLOBAL_ORIGIN: the estimator starts from home."""
        return mav.MAVLink_gps_global_origin_message(*_scaled(self._navigator.store.home), 0)

    def autopilot_version(self) -> Any:
        """AUTOPILOT_VERSION: what this autopilot can do."""
        return mav.MAVLink_autopilot_version_message(
            CAPABILITIES, _FIRMWARE_VERSION, 0, 0, 0, b"simulate", b"\0" * 8, b"\0" * 8, 0, 0, self._system_id
        )

    def attitude(self) -> Any:
        """ATTITUDE: level, at the boat's heading."""
        vessel = self._vessel
        yaw = math.radians((vessel.heading_deg + 180.0) % 360.0 - 180.0)
        rate = math.radians(vessel.turn_rate_deg_s)
        return mav.MAVLink_attitude_message(self.time_boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, rate)

    def vfr_hud(self) -> Any:
        """VFR_HUD."""
        vessel = self._vessel
        most = max(0.1, self._navigator.speed_mps)
        throttle = min(100, round(100.0 * abs(vessel.speed_mps) / most))
        return mav.MAVLink_vfr_hud_message(
            vessel.speed_mps, vessel.ground_speed_mps, round(vessel.heading_deg) % 360, throttle, 0.0, 0.0
        )

    def mission_current(self) -> Any:
        """MISSION_CURRENT; its total does not count home, as ArduPilot's does not."""
        navigator = self._navigator
        state = navigator.mission_state
        in_mission = 1 if navigator.mode is Mode.AUTO and state is not MissionState.NO_MISSION else 2
        return mav.MAVLink_mission_current_message(
            navigator.current, navigator.store.total, int(state), in_mission
        )

    def nav_controller_output(self) -> Any:
        """NAV_CONTROLLER_OUTPUT: bearing and distance to where the boat is going."""
        vessel, leg = self._vessel, self._navigator.leg
        east, north = (0.0, 0.0) if leg is None else vessel.position.offset_to(leg.destination)
        bearing = round(math.degrees(math.atan2(east, north)))
        distance = min(0xFFFF, round(math.hypot(east, north)))
        return mav.MAVLink_nav_controller_output_message(
            0.0, 0.0, round(vessel.course_deg) % 360, bearing, distance, 0.0, 0.0, 0.0
        )

    def sensor_value(self, name: str, value: float) -> Any:
        """NAMED_VALUE_FLOAT of the instrument."""
        return mav.MAVLink_named_value_float_message(self.time_boot_ms, name.encode(), value)

    def timesync(self, request: Any) -> Any:
        """The answer to a TIMESYNC request: our nanoseconds since boot beside the sender's stamp."""
        return mav.MAVLink_timesync_message(round(self._vessel.time_s * 1e9), request.ts1)


def _scaled(position: Position) -> tuple[int, int]:
    return round(position.lat_deg * 1e7), round(position.lon_deg * 1e7)
