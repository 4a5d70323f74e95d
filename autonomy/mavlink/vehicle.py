"""The vehicle as last heard."""

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink


@dataclass(frozen=True)
class VehicleState:
    """The vehicle as last heard; None where it has not said anything yet."""

    system_id: int
    component_id: int
    autopilot: int
    """MAV_AUTOPILOT: 3 is ArduPilot, 12 is PX4."""
    vehicle_type: int
    """MAV_TYPE: 10 is a ground rover, 11 a surface boat."""
    mode: int
    """The autopilot's custom_mode; `authority.mode_name` gives its name."""
    armed: bool
    system_status: int
    """MAV_STATE: 4 active, 5 critical (a failsafe has struck), 6 emergency."""
    model_time_s: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    heading_deg: float | None = None
    groundspeed_mps: float | None = None
    gps_fix_type: int | None = None
    ekf_ok: bool | None = None
    """Whether the estimator has an absolute position of its own; None if the autopilot never said."""
    mission_current: int | None = None
    mission_total: int | None = None
    mission_state: int = mavlink.MISSION_STATE_UNKNOWN
    """MISSION_STATE: 0 not told, 2 not started, 3 active, 4 paused, 5 complete."""
    battery_voltage_v: float | None = None
    battery_remaining: float | None = None
    """Share of the charge that is left, 0 to 1."""
    battery_consumed_j: float | None = None
    """Energy drawn since the autopilot started."""
    battery_drawn_c: float | None = None
    """Charge drawn since then, in coulombs."""
    home_deg: tuple[float, float] | None = None
    """Latitude and longitude of the place that it returns to."""
    reboots: int = 0
    """How often the vehicle's clock started again."""
    heartbeats: int = 0
    """How many of them were heard; mode, arming and status are the last one's."""
    heard: float = -math.inf
    """Protocol time at which any of this was last told."""
    booted: float = -math.inf
    """Protocol time at which the vehicle last started again, as its clock tells."""

    @property
    def position_ok(self) -> bool:
        """Whether the vehicle knows where it is."""
        has_gps = self.gps_fix_type is None or self.gps_fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX
        return self.lat_deg is not None and has_gps and self.ekf_ok is not False


@dataclass(frozen=True)
class StatusText:
    """A line from the vehicle to its operator; `severity` is MAV_SEVERITY (0 emergency … 7 debug)."""

    severity: int
    text: str
