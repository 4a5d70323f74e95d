"""The modes of ArduPilot Rover, and whether a vehicle is one: of other autopilots no mode is understood."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.vehicle import VehicleState

HOLD, AUTO, RTL, SMART_RTL = 4, 10, 11, 12
ROVER_MODES = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
}
_ROVERS = (mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_TYPE_SURFACE_BOAT)


def mode_name(custom_mode: int) -> str:
    """The name ArduPilot Rover gives to a mode."""
    return str(ROVER_MODES.get(custom_mode, f"mode {custom_mode}"))


def unsupported(state: VehicleState) -> str:
    """Why this vehicle's modes can't be understood; empty if they can."""
    if state.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        name = "PX4" if state.autopilot == mavlink.MAV_AUTOPILOT_PX4 else f"MAV_AUTOPILOT {state.autopilot}"
        return f"unsupported autopilot {name}: only ArduPilot Rover's modes are known"
    if state.vehicle_type not in _ROVERS:
        return f"unsupported vehicle type {state.vehicle_type}: only ArduPilot Rover's modes are known"
    return ""
