"""What the autopilot has to keep the boat safe: fence, rally points, failsafes. Read once, watched after that."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.fence import FenceError, Zone, parse_fence
from autonomy.mavlink.mission_download import Download, MissionDownload
from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.parameters import ParameterReading

_OFF = {
    "FS_ACTION": "failsafes do nothing (FS_ACTION 0)",
    "FS_THR_ENABLE": "the failsafe for a lost remote control is off (FS_THR_ENABLE 0)",
    "FS_GCS_ENABLE": "the failsafe for a lost ground station is off (FS_GCS_ENABLE 0)",
    "FS_EKF_ACTION": "the failsafe for a lost position is off (FS_EKF_ACTION 0)",
    "FENCE_ENABLE": "the fence is off (FENCE_ENABLE 0)",
    "FENCE_ACTION": "a breach of the fence is only told (FENCE_ACTION 0)",
    "BATT_MONITOR": "the battery is not watched (BATT_MONITOR 0)",
    "BATT_FS_LOW_ACT": "a low battery has no consequence (BATT_FS_LOW_ACT 0)",
    "BATT_FS_CRT_ACT": "a critical battery has no consequence (BATT_FS_CRT_ACT 0)",
}
"""ArduPilot Rover's failsafes, and how it is said that one is off."""

_FENCE = ("FENCE_ENABLE", "FENCE_TYPE", "FENCE_RADIUS", "FENCE_OPTIONS", "FENCE_TOTAL")
NAMES = tuple(dict.fromkeys((*_OFF, *_FENCE)))
"""The parameters that are read."""

NOT_READ = "the autopilot's fence has not been read yet"

_CIRCLE_ABOUT_HOME = 2  # of FENCE_TYPE
_ANY_INCLUSION = 2  # of FENCE_OPTIONS
_RETRY_S = 5.0
_LONGEST_RETRY_S = 60.0


@dataclass(frozen=True)
class Safeguards:
    """What was read.

    Attributes:
        inclusions: the vehicle must be inside one zone of each of these groups.
        exclusions: and in none of these.
        rally_deg: latitude, longitude of the rally points.
        parameters: those that the autopilot knows, by name.
    """

    inclusions: tuple[tuple[Zone, ...], ...]
    exclusions: tuple[Zone, ...]
    rally_deg: tuple[tuple[float, float], ...]
    parameters: Mapping[str, float]

    @property
    def has_fence(self) -> bool:
        """Whether there is any."""
        return bool(self.inclusions or self.exclusions)

    @property
    def summary(self) -> str:
        """What there is, in words."""
        zones = sum(map(len, self.inclusions)) + len(self.exclusions)
        fence = f"a fence of {zones} zone{'s' * (zones != 1)}" if zones else "no fence"
        return f"{fence} and {len(self.rally_deg)} rally point{'s' * (len(self.rally_deg) != 1)}"

    @property
    def warnings(self) -> tuple[str, ...]:
        """What an operator should know before the boat leaves."""
        known = self.parameters
        said = [text for name, text in _OFF.items() if known.get(name) == 0.0]
        if known.get("FENCE_ENABLE") and not self.has_fence:
            said.append("the fence is on, and there is none on board")
        untold = [name for name in _OFF if name not in known]
        if untold:
            said.append(f"the autopilot does not tell {', '.join(untold)}")
        return tuple(said)


class SafeguardsReading:
    """Reads parameters, fence and rally points, one after the other, until it has them.

    Theory of operation. `start` begins: parameters and home, fence, rally points, then `known`. What can't be read
    or understood is tried again after 5 s, doubled up to a minute, for ever; `problem` says what it is. Meanwhile what
    was known before holds. Afterwards a PARAM_VALUE or HOME_POSITION that tells another fence makes it begin anew.
    """

    def __init__(self, route: Route, *, autopilot: int, time_scale: float = 1.0) -> None:
        self._route = route
        self._autopilot = autopilot
        self._time_scale = time_scale
        self._parameters = ParameterReading(NAMES, route, time_scale=time_scale)
        self._machine: ParameterReading | MissionDownload | None = None
        self._zones: tuple[Zone, ...] = ()
        self._failures = 0
        self._not_before: float | None = None
        self._stale = False
        self.known: Safeguards | None = None
        self.problem: str | None = NOT_READ

    def next_deadline(self) -> float | None:
        """Protocol time at which `step` wants to be called."""
        return self._not_before if self._machine is None else self._machine.next_deadline()

    def start(self, now: float) -> list[Any]:
        """Begin, from the beginning."""
        self._not_before, self._stale = None, False
        self._machine = self._parameters
        return self._parameters.start(now) + self._proceed(now)

    def handle(self, now: float, message: Any) -> list[Any]:
        """React to one message of the vehicle; returns what to send."""
        news = self._parameters.handle(message)
        sent = self._machine.handle(now, message) if isinstance(self._machine, MissionDownload) else []
        if news and self._machine is not self._parameters:
            home = message.get_type() == "HOME_POSITION"
            self._stale = self._stale or (self._is_about_home if home else message.param_id in _FENCE)
        return sent + self._proceed(now)

    def step(self, now: float) -> list[Any]:
        """Repeat what may have been lost; begin again what failed, if it is time to."""
        if self._machine is None:
            due = self._stale or (self._not_before is not None and now >= self._not_before)
            return self.start(now) if due else []
        return self._machine.on_deadline(now) + self._proceed(now)

    def _proceed(self, now: float) -> list[Any]:
        machine = self._machine
        if isinstance(machine, ParameterReading) and machine.finished:
            return self._download(now, mavlink.MAV_MISSION_TYPE_FENCE)
        if not isinstance(machine, MissionDownload):
            return []
        if machine.state is Download.FAILED:
            return self._fail(now, f"the fence can't be read: {machine.reason}")
        if machine.mission is None:
            return []
        if machine.mission_type == mavlink.MAV_MISSION_TYPE_RALLY:
            return self._finish(now, tuple((item.lat_deg, item.lon_deg) for item in machine.mission))
        try:
            self._zones = parse_fence(machine.mission)
        except FenceError as error:
            return self._fail(now, f"the fence can't be understood: {error}")
        return self._download(now, mavlink.MAV_MISSION_TYPE_RALLY)

    @property
    def _is_about_home(self) -> bool:
        """Whether the fence in force is a circle about home."""
        values = self._parameters.values
        return bool(values.get("FENCE_ENABLE") and int(values.get("FENCE_TYPE", 0)) & _CIRCLE_ABOUT_HOME)

    def _download(self, now: float, mission_type: int) -> list[Any]:
        self._machine = MissionDownload(
            self._route, autopilot=self._autopilot, time_scale=self._time_scale, mission_type=mission_type
        )
        return self._machine.start(now)

    def _finish(self, now: float, rally_deg: tuple[tuple[float, float], ...]) -> list[Any]:
        values = self._parameters.values
        inclusions = tuple(zone for zone in self._zones if zone.is_inclusion)
        any_of = int(values.get("FENCE_OPTIONS", 0)) & _ANY_INCLUSION
        groups = [inclusions] if any_of and inclusions else [(zone,) for zone in inclusions]
        if self._is_about_home:
            home, radius_m = self._parameters.home_deg, values.get("FENCE_RADIUS")
            if home is None or radius_m is None:
                return self._fail(now, "the fence is a circle about home, which the autopilot does not tell")
            if not radius_m > 0.0:
                return self._fail(now, f"the fence is a circle about home with a radius of {radius_m:g} m")
            groups.append((Zone(True, (home,), radius_m),))
        exclusions = tuple(zone for zone in self._zones if not zone.is_inclusion)
        self.known = Safeguards(tuple(groups), exclusions, rally_deg, dict(values))
        self._machine, self._failures, self.problem = None, 0, None
        return []

    def _fail(self, now: float, problem: str) -> list[Any]:
        self._machine, self.problem = None, problem
        self._not_before = now + min(_LONGEST_RETRY_S, _RETRY_S * 2**self._failures)
        self._failures = min(10, self._failures + 1)
        return []
