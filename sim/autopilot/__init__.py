"""The autopilot's half of MAVLink, as ArduPilot Rover with a boat's frame speaks it.

`Autopilot` is sans-io: `handle` takes a message, `advance` lets time pass, both return what is to be sent
and to whom. `sim.server` puts it on sockets; a driver in the same process can call it directly.
"""

from sim.autopilot.machine import ALL, COMPONENT_ID, HEARD, All, Autopilot, Client, Options, Outgoing
from sim.autopilot.modes import MissionState, Mode

__all__ = [
    "ALL",
    "COMPONENT_ID",
    "HEARD",
    "All",
    "Autopilot",
    "Client",
    "MissionState",
    "Mode",
    "Options",
    "Outgoing",
]
