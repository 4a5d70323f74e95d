"""Who has the helm: modes, arming, and the mission as ArduPilot Rover drives it."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot.fence import Fence
from sim.autopilot.missions import MissionItem, MissionStore
from sim.autopilot.modes import MissionState, Mode
from sim.autopilot.parameters import Parameters
from sim.vessel import Leg, Position, Vessel


class Navigator:
    """Mode, arming and mission progress; `advance` moves the vessel one step.

    What people should hear of (STATUSTEXT, MISSION_ITEM_REACHED) goes to `announce` as messages.
    """

    def __init__(
        self,
        vessel: Vessel,
        parameters: Parameters,
        store: MissionStore,
        announce: Callable[[Any], None],
        ready_after_s: float = 0.0,
    ) -> None:
        self.vessel = vessel
        self.parameters = parameters
        self.store = store
        self.fence = Fence(store, parameters)
        self.mode = Mode.MANUAL
        self.armed = False
        self.current = 0
        self.leg: Leg | None = None
        self._state = MissionState.NOT_STARTED
        self._announce = announce
        self._ready_after_s = ready_after_s
        self._station = vessel.position
        self._driven: MissionItem | None = None
        self._arrived: Position | None = None
        self._hold_until_s: float | None = None
        self._speed_mps: float | None = None
        self._told_aground = False

    @property
    def position_ok(self) -> bool:
        """Whether there is a position estimate yet."""
        return self.vessel.time_s >= self._ready_after_s

    @property
    def mission_state(self) -> MissionState:
        """MISSION_CURRENT.mission_state."""
        return self._state if self.store.total else MissionState.NO_MISSION

    @property
    def speed_mps(self) -> float:
        """Speed wanted under way: the last change of speed, or the parameters'."""
        return self.parameters.waypoint_speed_mps if self._speed_mps is None else self._speed_mps

    def say(self, severity: int, text: str) -> None:
        """Tell everybody in a STATUSTEXT (at most 50 characters)."""
        self._announce(mav.MAVLink_statustext_message(severity, text.encode()[:50]))

    def set_mode(self, mode: Mode) -> bool:
        """Change the mode; False, with a STATUSTEXT that says why, if it is refused."""
        if mode is self.mode:
            return True
        if mode.needs_position and not self.position_ok:
            self.say(mav.MAV_SEVERITY_CRITICAL, f"{mode.name}: mode requires position estimate")
            return False
        if mode is Mode.AUTO and self.store.total == 0:
            self.say(mav.MAV_SEVERITY_CRITICAL, "No Mission. Can't set AUTO.")
            return False
        if self.mode is Mode.AUTO and self._state is MissionState.ACTIVE:
            self._state = MissionState.PAUSED
        self.mode = mode
        self.leg = None
        self._station = self.vessel.position
        if mode is Mode.AUTO:
            self._start_or_resume()
        elif mode in (Mode.RTL, Mode.SMART_RTL):
            self._steer_to(self.store.home)
        return True

    def set_current(self, seq: int, restart: bool = False) -> bool:
        """Make `seq` the current item; `restart` revives a complete mission. False if there is none."""
        if not 0 <= seq < len(self.store) or self.store.total == 0:
            return False
        self.current = max(1, seq)
        self._forget_item()
        if restart:
            in_auto = self.mode is Mode.AUTO
            self._state = MissionState.ACTIVE if in_auto else MissionState.NOT_STARTED
        return True

    def set_speed(self, speed_mps: float) -> None:
        """Change the speed wanted under way until the next start of a mission."""
        self._speed_mps = speed_mps

    def guide_to(self, position: Position) -> None:
        """A target for GUIDED."""
        self._steer_to(position)

    def mission_stored(self, *, restart: bool = False) -> None:
        """A new mission is complete on board: progress stays where it is, as ArduPilot's does, or begins anew."""
        if restart:
            self.set_current(1, restart=True)
        if self.store.total == 0 and self.mode is not Mode.AUTO:
            self.current, self._state = 0, MissionState.NOT_STARTED

    def advance(self, dt_s: float) -> None:
        """Drive one step as the mode says, and mind the fence."""
        before = self.vessel.position
        self._drive(dt_s)
        if not self.armed or not self.fence.is_on:
            return
        if self.mode.needs_position and self.fence.stops_the_boat:
            margin_m = self.parameters["AVOID_MARGIN"]
            if self.fence.room_m(self.vessel.position) < margin_m <= self.fence.room_m(before):
                self.vessel.stop_at(before)
        elif self.fence.room_m(self.vessel.position) < 0.0 <= self.fence.room_m(before):
            self._breach()

    def _breach(self) -> None:
        self.say(mav.MAV_SEVERITY_WARNING, "Fence Breached")
        action = self.parameters["FENCE_ACTION"]
        if action != 0.0:
            self.set_mode(Mode.RTL if action == 1.0 else Mode.HOLD)

    def _drive(self, dt_s: float) -> None:
        if not self.armed:
            self.vessel.lie(dt_s)
        elif self.mode is Mode.AUTO and self._state is MissionState.ACTIVE:
            self._drive_mission(dt_s)
        elif self.mode in (Mode.GUIDED, Mode.RTL, Mode.SMART_RTL) and self.leg is not None:
            self._drive_leg(dt_s)
        elif self.mode in (Mode.MANUAL, Mode.HOLD):
            self.vessel.drift(dt_s)
        else:
            self._keep_station(dt_s)
        if self.vessel.aground and not self._told_aground:
            self._told_aground = True
            self.say(mav.MAV_SEVERITY_EMERGENCY, "Aground")

    def _start_or_resume(self) -> None:
        fresh = self._state is not MissionState.PAUSED or self.parameters["MIS_RESTART"] == 1.0
        if fresh and self._state is MissionState.COMPLETE:
            self.current = 1
        self.current = max(1, self.current)
        self._state = MissionState.ACTIVE
        self._forget_item()

    def _forget_item(self) -> None:
        self._driven = self._arrived = self._hold_until_s = self.leg = None

    def _steer_to(self, position: Position) -> None:
        self._station = position
        self.leg = Leg(self.vessel.position, position)

    def _drive_leg(self, dt_s: float) -> None:
        assert self.leg is not None
        returning = self.mode is not Mode.GUIDED
        self.vessel.follow(self.leg, self.parameters.return_speed_mps if returning else self.speed_mps, dt_s)
        if self.vessel.passed(self.leg, self.parameters["WP_RADIUS"]):
            self.leg = None
            if not returning:
                # Seen on the real one: a target that is no mission item is reported as item 0.
                self._announce(mav.MAVLink_mission_item_reached_message(0))

    def _keep_station(self, dt_s: float) -> None:
        radius_m = max(1.0, self.parameters["LOIT_RADIUS"])
        self.vessel.keep_station(self._station, radius_m, self.speed_mps, dt_s)

    def _drive_mission(self, dt_s: float) -> None:
        if self.current >= len(self.store):
            self._complete()
            self._keep_station(dt_s)
            return
        item = self.store[self.current]
        if item != self._driven:
            self._begin(item)
        if item.command == mav.MAV_CMD_DO_CHANGE_SPEED:
            if item.params[1] > 0.0:
                self._speed_mps = item.params[1]
            self._next()
            self._keep_station(dt_s)
        elif self.leg is not None:
            self.vessel.follow(self.leg, self.speed_mps, dt_s)
            if self.vessel.passed(self.leg, self.parameters["WP_RADIUS"]):
                self._arrive(item)
        else:
            self._keep_station(dt_s)
            if self._hold_until_s is not None and self.vessel.time_s >= self._hold_until_s - 1e-9:
                self._reached()

    def _begin(self, item: MissionItem) -> None:
        """Turn to a new item, or to a new version of the one being driven."""
        self._driven, self._hold_until_s = item, None
        if item.command == mav.MAV_CMD_DO_CHANGE_SPEED:
            return
        target = item.position if item.is_place else self.store.home
        # The line starts at the waypoint just reached; after a jump it starts where the boat is.
        origin = self.vessel.position if self._arrived is None else self._arrived
        self._station = target
        self.leg = Leg(origin, target)
        self._arrived = None

    def _arrive(self, item: MissionItem) -> None:
        self.leg = None
        if item.command == mav.MAV_CMD_NAV_LOITER_UNLIM:
            return
        hold_s = item.params[0] if item.is_place else 0.0
        if hold_s > 0.0:
            self._hold_until_s = self.vessel.time_s + hold_s
        else:
            self._reached()

    def _reached(self) -> None:
        self._announce(mav.MAVLink_mission_item_reached_message(self.current))
        self.say(mav.MAV_SEVERITY_INFO, f"Reached waypoint #{self.current}")
        self._arrived = self._station
        self._next()

    def _next(self) -> None:
        self._driven = self._hold_until_s = None
        if self.current + 1 >= len(self.store):
            self._complete()
        else:
            self.current += 1

    def _complete(self) -> None:
        self._state = MissionState.COMPLETE
        self._station = self.vessel.position
        self._forget_item()
        self.say(mav.MAV_SEVERITY_NOTICE, "Mission Complete")
