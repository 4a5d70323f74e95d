"""The mission being sailed: where the vessel is on it, and whether the autopilot sails it as we believe."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.dispatch import MissionDispatch
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.mavlink.authority import Authority, OnBoard
from autonomy.mavlink.mission_items import MissionItem
from autonomy.mavlink.telemetry import Telemetry
from autonomy.mavlink.vehicle import VehicleState
from autonomy.pace import Pace
from autonomy.progress import Progress
from autonomy.stall import ClosingWatch, StallWatch
from autonomy.track import Track
from autonomy.witness import MissionWitness

NEWS_S = 1.0
"""What is told once a second may be as old as that."""

PATIENT_HEARTBEATS = 10
"""So many, and an estimator that has not said whether it is ready will not."""

NEAR_M = 10.0
"""A waypoint this near counts as reached: autopilots have acceptance radii of their own."""

DOUBTS = 2
"""So often a mission that isn't sailed is made current again; then the boat counts as stalled."""


@dataclass(frozen=True, eq=False)
class Stall:
    """The boat does not get from `point_m` to `waypoint_m`, both of shape (2,)."""

    point_m: FloatArray
    waypoint_m: FloatArray


class Headway:
    """Follows the vessel along the mission that `dispatch` brought on board.

    Theory of operation. What the vehicle tells of its way is held against the mission verified on
    board: positions say whether the boat gets on (`take_stall`) and makes for the first waypoint of a mission made
    current, MISSION_CURRENT and MISSION_ITEM_REACHED how far it has got, and all that tells of its way whether it
    sails ours at all. Where it does not seem to, `dispatch` is asked to read, or to make current again.
    """

    def __init__(
        self,
        configuration: Configuration,
        frame: LocalFrame,
        telemetry: Telemetry,
        authority: Authority,
        dispatch: MissionDispatch,
    ) -> None:
        self._frame = frame
        self._telemetry = telemetry
        self._authority = authority
        self._dispatch = dispatch
        self._track = Track()
        self._pace = Pace(configuration.budget.speed_mps)
        self._progress = Progress()
        self._stall_watch = StallWatch(configuration.exploration.stall_s, configuration.exploration.stall_m)
        self._stall: Stall | None = None
        self._closing = ClosingWatch()
        self._witness = MissionWitness()
        self._made_current = 0
        self._doubts = 0

    @property
    def position_m(self) -> FloatArray | None:
        """Where the vessel was when it was last sure of it, shape (2,), local metres."""
        return self._track.position_m

    @property
    def is_sure(self) -> bool:
        """Whether the vehicle says that it knows where it is; its estimator's silence counts for yes after a while.

        Positions are sent before the estimator has one of its own.
        """
        state = self._telemetry.state
        if state is None or self.position_m is None or not state.position_ok:
            return False
        return state.ekf_ok is not None or state.heartbeats >= PATIENT_HEARTBEATS

    @property
    def distance_m(self) -> float:
        """How far the vessel has sailed."""
        return self._track.distance_m

    @property
    def sailing_ours(self) -> bool:
        """Whether we have the boat and it sails a verified mission of ours."""
        ours = self._authority.on_board is OnBoard.OURS and self._dispatch.active is not None
        return ours and self._authority.in_command

    @property
    def has_damaged_ours(self) -> bool:
        """Whether we have the boat, and what it sails is but a part of a mission of ours."""
        return self._authority.on_board is OnBoard.DAMAGED and self._authority.in_command

    @property
    def path_finished(self) -> bool:
        """Whether the verified mission on board has been sailed to its end and nothing newer is on its way."""
        active = self._dispatch.active
        if self._telemetry.state is None or active is None or not self.sailing_ours or self._dispatch.busy:
            return False
        return active.is_whole and (self._progress.is_complete or self._dispatch.reached >= len(active.items))

    def remaining_route_m(self) -> FloatArray:
        """From the vessel along the mission it sails, shape (k, 2); the vessel alone when it sails none of ours.

        Raises:
            RuntimeError: the vessel's position is not known yet.
        """
        if self.position_m is None:
            raise RuntimeError("the vessel's position is not known yet")
        here = self.position_m.reshape(1, 2)
        if self._telemetry.state is None or self._dispatch.active is None or not self.sailing_ours:
            return here
        return np.vstack([here, self._dispatch.active.plan.route_m[self.next_row :]])

    @property
    def next_row(self) -> int:
        """Row of the active plan's route that the vessel makes for, as far as it is known; 0 without a plan."""
        active, state = self._dispatch.active, self._telemetry.state
        if active is None or state is None:
            return 0
        # Item 0 is home, so waypoint k of the mission is row k - 1 of the route.
        current = max(0, (state.mission_current or 1) - 1) if self.sailing_ours else 0
        # At the end of a stretch the last item stays the current one.
        return max(current, self._dispatch.reached)

    def reach_m(self, delay_s: float) -> float:
        """How far the vessel sails in `delay_s` of protocol time, at its speed of the moment."""
        speed_mps = 0.0 if self._telemetry.state is None else self._telemetry.state.groundspeed_mps or 0.0
        return speed_mps * delay_s * self._telemetry.clock_rate

    @property
    def pace_mps(self) -> float:
        """The vessel's speed over ground under way: the mean of the last minutes, at first the configured one."""
        return self._pace.speed_mps

    @property
    def acceptance_radius_m(self) -> float:
        """The largest of the mission being sailed; 0 without one."""
        active = self._dispatch.active
        return 0.0 if active is None else max(item.param2 for item in active.items)

    def take_stall(self) -> Stall | None:
        """Where the boat has stalled since the last call."""
        stall, self._stall = self._stall, None
        return stall

    def handle(self, now: float, message: Any, state: VehicleState, *, changed: bool) -> bool:
        """Take in a message, and whether it has changed the vehicle's state; returns whether a waypoint was reached."""
        kind = message.get_type()
        if changed and kind == "GLOBAL_POSITION_INT" and state.position_ok and state.model_time_s is not None:
            assert state.lat_deg is not None
            assert state.lon_deg is not None
            self._track.follow(state.model_time_s, self._frame.to_local(state.lat_deg, state.lon_deg))
            self._watch(state.model_time_s, state)
        reached = self._telemetry.take_reached()
        if reached or (kind == "MISSION_CURRENT" and changed):
            self._count_reached(message, state, reached)
        self._witness_mission(now, message, state, reached)
        return bool(reached)

    def _watch(self, time_s: float, state: VehicleState) -> None:
        """See that the boat gets on, and that it makes for the first waypoint of a mission made current."""
        if self._dispatch.made_current != self._made_current:
            self._made_current = self._dispatch.made_current
            self._closing.begin(self._dispatch.active)
        active, k = self._dispatch.active, (state.mission_current or 1) - 1
        idle = state.mission_state not in (mavlink.MISSION_STATE_UNKNOWN, mavlink.MISSION_STATE_ACTIVE)
        if not self.sailing_ours or self.path_finished or active is None or self.position_m is None:
            self._stall_watch.rest()
            self._closing.rest()
            self._pace.rest()
            return
        self._pace.follow(time_s, state.groundspeed_mps)
        distance_m = float(np.hypot(*(active.plan.route_m[0] - self.position_m)))
        reached = self._dispatch.reached == 1 or distance_m <= max(NEAR_M, 2.0 * active.items[0].param2)
        if self._closing.follow(time_s, distance_m, reached=reached, elsewhere=k > 0):
            self._doubt(active.plan.route_m[0])
        elif not self._closing.open:
            self._doubts = 0
        if idle or k >= len(active.items):
            self._stall_watch.rest()
        elif self._stall_watch.follow(time_s, self.position_m, (self._made_current, k)):
            self._stall = Stall(self.position_m, active.plan.route_m[k])

    def _witness_mission(self, now: float, message: Any, state: VehicleState, reached: list[int]) -> None:
        """Have the mission on board read if what the autopilot tells of its way does not fit ours."""
        kind, active, current = message.get_type(), self._dispatch.active, state.mission_current or 0
        tells = kind in ("MISSION_CURRENT", "NAV_CONTROLLER_OUTPUT") and self._telemetry.is_from_autopilot(
            message
        )
        if not reached and not tells:
            return
        if not self.sailing_ours or active is None:
            self._witness.reset()
            return
        if self._dispatch.busy or self._dispatch.talking or not self.is_sure:
            self._witness.rest()
            return
        slack_m = self.reach_m(now - self._telemetry.position_heard + NEWS_S)
        for seq in reached:
            if 0 < seq <= len(active.items):
                item = active.items[seq - 1]
                distance_m = self._distance_m(state, item)
                if self._witness.doubts_place(now, distance_m, item.param2, slack_m):
                    self._dispatch.doubt(f"waypoint {seq} was reached {distance_m:.0f} m from ours")
        idle = state.mission_state not in (mavlink.MISSION_STATE_UNKNOWN, mavlink.MISSION_STATE_ACTIVE)
        if idle or self.path_finished or not 0 < current <= len(active.items):
            self._witness.rest()
        elif kind == "MISSION_CURRENT":
            self._witness.named(current)
        elif kind == "NAV_CONTROLLER_OUTPUT":
            claimed_m, distance_m = message.wp_dist, self._distance_m(state, active.items[current - 1])
            if self._witness.doubts_way(now, claimed_m, distance_m, slack_m):
                text = f"the boat sails {claimed_m} m to waypoint {current}, ours is {distance_m:.0f} m away"
                self._dispatch.doubt(text)

    def _distance_m(self, state: VehicleState, item: MissionItem) -> float:
        """From where the autopilot believes to be, glitch or not, as it reckons from there itself."""
        here_m = self._frame.to_local(state.lat_deg or 0.0, state.lon_deg or 0.0)
        return float(np.hypot(*(self._frame.to_local(item.lat_deg, item.lon_deg) - here_m)))

    def _doubt(self, waypoint_m: FloatArray) -> None:
        """The boat does not make for the mission's first waypoint."""
        self._doubts += 1
        if self._doubts <= DOUBTS:
            self._dispatch.make_current_again()
            return
        assert self.position_m is not None
        self._doubts = 0
        self._stall = Stall(self.position_m, waypoint_m)

    def _count_reached(self, message: Any, state: VehicleState, numbers: list[int]) -> None:
        self._progress.begin(self._dispatch.active)
        current = state.mission_current or 0
        certain = [self._progress.reached(seq, current) for seq in numbers]
        if message.get_type() == "MISSION_CURRENT":
            certain.append(self._progress.told(current, state.mission_state))
        self._dispatch.reached = max([self._dispatch.reached, *certain])
        active, kind = self._dispatch.active, message.get_type()
        # Held to be behind the boat, its waypoint would be sailed to unwatched.
        if active is not None and kind == "MISSION_CURRENT":
            last = len(active.items)
            goes_back = self._progress.goes_back(current, self._dispatch.reached, last)
            self._dispatch.reached = current - 1 if goes_back else self._dispatch.reached
