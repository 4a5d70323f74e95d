"""The vehicle as the core sees it: where it is, who commands it, which mission it sails, and how to send it another."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.compiler import compile_mission, handling_of
from autonomy.config import Configuration
from autonomy.dispatch import Dispatched, MissionDispatch
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.mavlink.authority import Authority, OnBoard
from autonomy.mavlink.authority_table import Action
from autonomy.mavlink.companion import StreamRequests, heartbeat, status_text, wanted_streams
from autonomy.mavlink.mission import MissionItem, Route, time_scale
from autonomy.mavlink.rover import RTL, SMART_RTL, unsupported
from autonomy.mavlink.safeguards import NOT_READ, Safeguards, SafeguardsReading
from autonomy.mavlink.telemetry import Observation, Telemetry, VehicleState
from autonomy.notes import AutopilotWords, Note
from autonomy.orders import Orders
from autonomy.pace import Pace
from autonomy.planning.plan import Plan
from autonomy.progress import Progress
from autonomy.stall import ClosingWatch, StallWatch
from autonomy.track import Track
from autonomy.witness import MissionWitness

HEARTBEAT_S = 1.0

NEWS_S = 1.0
"""What is told once a second may be as old as that."""

PATIENT_HEARTBEATS = 10
"""So many, and an estimator that has not said whether it is ready will not."""

NEAR_M = 10.0
"""A waypoint this near counts as reached: autopilots have acceptance radii of their own."""

ASK_AGAIN_S = 30.0
"""Streams are asked for again when there has been no position for so long: another station on the link may have
stopped them, or a restart so quick that no heartbeat was missed."""

STALE_POSITION_S = 10.0
"""A vehicle that has not told its position for this long is nowhere: nothing is planned from where it was, and it is
not set in motion."""

DOUBTS = 2
"""So often a mission that isn't sailed is made current again; then the boat counts as stalled."""


@dataclass(frozen=True, eq=False)
class Stall:
    """The boat does not get from `point_m` to `waypoint_m`, both of shape (2,)."""

    point_m: FloatArray
    waypoint_m: FloatArray


@dataclass(frozen=True)
class Heard:
    """What one message brought.

    Attributes:
        observations: complete readings.
        replies: messages to send.
        news: whether anything is different now.
    """

    observations: list[Observation]
    replies: list[Any]
    news: bool


class Helm:
    """Everything said to and heard from the autopilot, above the protocol machines."""

    def __init__(self, configuration: Configuration, frame: LocalFrame) -> None:
        self._configuration = configuration
        self._mavlink = configuration.mavlink
        self._frame = frame
        self.telemetry = Telemetry.of(configuration)
        self.authority = _authority(configuration)
        self.dispatch = MissionDispatch(self.authority)
        self._track = Track()
        self._pace = Pace(configuration.budget.speed_mps)
        self._streams: StreamRequests | None = None
        self._streams_asked = 0.0
        self._heartbeat_due = 0.0
        self._conversing = False
        self._heartbeats_before = 0
        self._progress = Progress()
        self._words = AutopilotWords()
        self._safeguards: SafeguardsReading | None = None
        self._safeguards_of = 0
        self._orders = Orders(_return_mode(configuration))
        self._stall_watch = StallWatch(configuration.exploration.stall_s, configuration.exploration.stall_m)
        self._stall: Stall | None = None
        self._closing = ClosingWatch()
        self._witness = MissionWitness()
        self._made_current = 0
        self._doubts = 0
        self._notes: list[Note] = []

    @property
    def state(self) -> VehicleState | None:
        """The vehicle, once its autopilot is known."""
        return self.telemetry.state

    @property
    def model_time_s(self) -> float:
        """The vehicle's clock as last heard; 0 before."""
        return 0.0 if self.state is None or self.state.model_time_s is None else self.state.model_time_s

    def is_heard(self, now: float) -> bool:
        """Whether the autopilot is known and not silent."""
        heard = self.state is not None and self.state.heartbeats > self._heartbeats_before
        return heard and not self.telemetry.lost(now)

    @property
    def position_m(self) -> FloatArray | None:
        """Where the vessel was when it was last sure of it, shape (2,), local metres."""
        return self._track.position_m

    @property
    def is_sure(self) -> bool:
        """Whether the vehicle says that it knows where it is; its estimator's silence counts for yes after a while.

        Positions are sent before the estimator has one of its own.
        """
        state = self.state
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
        ours = self.authority.on_board is OnBoard.OURS and self.dispatch.active is not None
        return ours and self.authority.in_command

    @property
    def has_damaged_ours(self) -> bool:
        """Whether we have the boat, and what it sails is but a part of a mission of ours."""
        return self.authority.on_board is OnBoard.DAMAGED and self.authority.in_command

    @property
    def path_finished(self) -> bool:
        """Whether the verified mission on board has been sailed to its end and nothing newer is on its way."""
        active = self.dispatch.active
        if self.state is None or active is None or not self.sailing_ours or self.dispatch.busy:
            return False
        return active.is_whole and (self._progress.is_complete or self.dispatch.reached >= len(active.items))

    def remaining_route_m(self) -> FloatArray:
        """From the vessel along the mission it sails, shape (k, 2); the vessel alone when it sails none of ours.

        Raises:
            RuntimeError: the vessel's position is not known yet.
        """
        if self.position_m is None:
            raise RuntimeError("the vessel's position is not known yet")
        here = self.position_m.reshape(1, 2)
        if self.state is None or self.dispatch.active is None or not self.sailing_ours:
            return here
        return np.vstack([here, self.dispatch.active.plan.route_m[self.next_row :]])

    @property
    def next_row(self) -> int:
        """Row of the active plan's route that the vessel makes for, as far as it is known; 0 without a plan."""
        active, state = self.dispatch.active, self.state
        if active is None or state is None:
            return 0
        # Item 0 is home, so waypoint k of the mission is row k - 1 of the route.
        current = max(0, (state.mission_current or 1) - 1) if self.sailing_ours else 0
        # At the end of a stretch the last item stays the current one.
        return max(current, self.dispatch.reached)

    def reach_m(self, delay_s: float) -> float:
        """How far the vessel sails in `delay_s` of protocol time, at its speed of the moment."""
        speed_mps = 0.0 if self.state is None else self.state.groundspeed_mps or 0.0
        return speed_mps * delay_s * self.telemetry.clock_rate

    @property
    def pace_mps(self) -> float:
        """The vessel's speed over ground under way: the mean of the last minutes, at first the configured one."""
        return self._pace.speed_mps

    @property
    def acceptance_radius_m(self) -> float:
        """The largest of the mission being sailed; 0 without one."""
        active = self.dispatch.active
        return 0.0 if active is None else max(item.param2 for item in active.items)

    def offer(self, plan: Plan) -> None:
        """Make this plan the next to bring on board, or its first stretch if it is too long for the autopilot."""
        items = compile_mission(plan, self._frame, handling_of(self._configuration, self.pace_mps))
        self.dispatch.offer(Dispatched(plan, items[: self._configuration.mavlink.mission_items]))

    def say(self, text: str) -> list[Any]:
        """A line to the operator's ground station; returns messages to send."""
        return [status_text(text)]

    def warn(self, text: str, *, critical: bool = False) -> list[Any]:
        """The same, louder: ground stations show it in colour, or say it aloud."""
        severity = mavlink.MAV_SEVERITY_CRITICAL if critical else mavlink.MAV_SEVERITY_WARNING
        return [status_text(text, severity)]

    def take_notes(self, now: float) -> list[Note]:
        """What happened, and what the autopilot wrote to its operator, since the last call, for the log."""
        notes, self._notes = self._notes, []
        return (
            notes
            + self.dispatch.take_notes()
            + self._orders.take_notes()
            + self._words.notes(now, self.telemetry.take_texts())
        )

    @property
    def safeguards(self) -> Safeguards | None:
        """The autopilot's fence, rally points and failsafes, as last read."""
        return None if self._safeguards is None else self._safeguards.known

    @property
    def unread(self) -> str | None:
        """Why the fence in force is not known; None if it is."""
        return NOT_READ if self._safeguards is None else self._safeguards.problem

    def take_stall(self) -> Stall | None:
        """Where the boat has stalled since the last call."""
        stall, self._stall = self._stall, None
        return stall

    def link_changed(self) -> None:
        """The transport opened or closed, or the vehicle started again: what was under way is void."""
        self.dispatch.forget()
        self._streams = None

    def resume(self) -> bool:
        """The service was away: what is remembered of the vehicle's mode and mission may be wrong by now.

        Returns whether a plan waits to be brought on board.
        """
        self._heartbeats_before = 0 if self.state is None else self.state.heartbeats
        self._heartbeat_due, self._conversing = 0.0, False
        self.dispatch.resume()
        self._safeguards_of = -1  # to be read again
        self.link_changed()
        return self.dispatch.busy

    def handle(self, now: float, message: Any) -> Heard:
        """Take in one message."""
        before, breaks = self.state, self.telemetry.clock_breaks
        observations = self.telemetry.handle(now, message)
        if self.telemetry.clock_breaks != breaks:
            self.link_changed()  # also where no reboot is certain: it costs a download
        state = self.state
        if state is None:
            return Heard(observations, [], news=False)
        if state is not before:
            self._follow(message, state)
        reached = self.telemetry.take_reached()
        if reached or (message.get_type() == "MISSION_CURRENT" and state is not before):
            self._count_reached(message, state, reached)
        self._witness_mission(now, message, state, reached)
        replies = [] if self._streams is None else self._streams.handle(now, message)
        talking = self.dispatch.talking
        replies += self.dispatch.handle(now, message)
        self._orders.handle(message)
        if self._safeguards is not None and self.authority.may_transfer:
            unread = self.unread
            replies += self._safeguards.handle(now, message)
            talking = talking or self.unread != unread
        return Heard(observations, replies, news=bool(state is not before or reached or talking))

    def step(self, now: float) -> list[Any]:
        """Everything the clock asks for: heartbeat, stream requests, transfers; returns messages to send."""
        scale = time_scale(self.telemetry.clock_rate)
        sent = []
        if now >= self._heartbeat_due:
            sent.append(heartbeat(active=self.authority.in_command))
            self._heartbeat_due = now + HEARTBEAT_S * scale
        state = self.state
        if state is None or not self.is_heard(now) or unsupported(state):
            self._conversing = False
            return sent
        if not self._conversing:
            # However long it was away: it may have started again, or have been given another mission.
            self.link_changed()
            self._conversing = True
        if self.authority.take_restart():
            text = (
                "the autopilot has started again: the boat waits for its operator to arm it and select AUTO"
            )
            self._notes.append(Note(text, is_warning=True))
            sent += self.warn("halocline: autopilot restarted: arm, select AUTO")
        route = Route(state.system_id, self._mavlink.component_id, state.system_id, state.component_id)
        if self.authority.may_speak:
            sent += self._ask_streams(now, route, scale)
        if self.authority.may_transfer:
            sent += self._read_safeguards(now, state, route, scale)
        if not self.dispatch.busy:
            sent += self._orders.step(now, self._action(now), state.heartbeats, route, scale)
            if self._orders.take_undone():
                self.authority.order_undone(state)
        return sent + self.dispatch.step(now, state, route, scale)

    def _action(self, now: float) -> Action:
        """What we may do; a boat that may be anywhere by now is not set in motion."""
        action = self.authority.action
        is_stale = now - self.telemetry.position_heard > STALE_POSITION_S
        return Action.PREPARE if is_stale and action in (Action.SELECT_AUTO, Action.ARM) else action

    def _ask_streams(self, now: float, route: Route, scale: float) -> list[Any]:
        sent = []
        silent = now - max(self.telemetry.position_heard, self._streams_asked) > ASK_AGAIN_S
        if self._streams is None or (silent and self._streams.finished):
            self._streams_asked = now
            battery = self._configuration.budget.is_limited
            home = self._configuration.shore.commands.accepted  # they may want the boat to return
            streams = wanted_streams(self._mavlink.position_rate_hz, battery=battery, home=home)
            self._streams = StreamRequests(streams, route, time_scale=scale)
            sent += self._streams.start(now)
        return sent + self._streams.on_deadline(now)

    def _read_safeguards(self, now: float, state: VehicleState, route: Route, scale: float) -> list[Any]:
        """Read fence, rally points and failsafes; anew after each reboot, which may have brought others."""
        if self._safeguards is not None and self._safeguards_of == self.telemetry.clock_breaks:
            return self._safeguards.step(now)
        self._safeguards = SafeguardsReading(route, autopilot=state.autopilot, time_scale=scale)
        self._safeguards_of = self.telemetry.clock_breaks
        return self._safeguards.start(now)

    def next_deadline(self) -> float:
        """When `step` must be called at the latest."""
        if not self._conversing:
            return self._heartbeat_due
        deadlines = [self._heartbeat_due, self.dispatch.next_deadline()]
        if self._streams is not None and self.authority.may_speak:
            deadlines.append(self._streams.next_deadline())
        if self._safeguards is not None and self.authority.may_transfer:
            deadlines.append(self._safeguards.next_deadline())
        if not self.dispatch.busy:
            deadlines.append(self._orders.next_deadline())
        return min(deadline for deadline in deadlines if deadline is not None)

    def _follow(self, message: Any, state: VehicleState) -> None:
        """Mode, position, progress and the mission's size, after a message was taken in."""
        self.authority.observe(state)
        kind = message.get_type()
        if kind == "GLOBAL_POSITION_INT" and state.position_ok and state.model_time_s is not None:
            assert state.lat_deg is not None
            assert state.lon_deg is not None
            self._track.follow(state.model_time_s, self._frame.to_local(state.lat_deg, state.lon_deg))
            self._watch(state.model_time_s, state)
        elif kind == "MISSION_CURRENT":
            self.dispatch.compare(state)

    def _watch(self, time_s: float, state: VehicleState) -> None:
        """See that the boat gets on, and that it makes for the first waypoint of a mission made current."""
        if self.dispatch.made_current != self._made_current:
            self._made_current = self.dispatch.made_current
            self._closing.begin(self.dispatch.active)
        active, k = self.dispatch.active, (state.mission_current or 1) - 1
        idle = state.mission_state not in (mavlink.MISSION_STATE_UNKNOWN, mavlink.MISSION_STATE_ACTIVE)
        if not self.sailing_ours or self.path_finished or active is None or self.position_m is None:
            self._stall_watch.rest()
            self._closing.rest()
            self._pace.rest()
            return
        self._pace.follow(time_s, state.groundspeed_mps)
        distance_m = float(np.hypot(*(active.plan.route_m[0] - self.position_m)))
        reached = self.dispatch.reached == 1 or distance_m <= max(NEAR_M, 2.0 * active.items[0].param2)
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
        kind, active, current = message.get_type(), self.dispatch.active, state.mission_current or 0
        tells = kind in ("MISSION_CURRENT", "NAV_CONTROLLER_OUTPUT") and self.telemetry.is_from_autopilot(
            message
        )
        if not reached and not tells:
            return
        if not self.sailing_ours or active is None:
            self._witness.reset()
            return
        if self.dispatch.busy or self.dispatch.talking or not self.is_sure:
            self._witness.rest()
            return
        slack_m = self.reach_m(now - self.telemetry.position_heard + NEWS_S)
        for seq in reached:
            if 0 < seq <= len(active.items):
                item = active.items[seq - 1]
                distance_m = self._distance_m(state, item)
                if self._witness.doubts_place(now, distance_m, item.param2, slack_m):
                    self.dispatch.doubt(f"waypoint {seq} was reached {distance_m:.0f} m from ours")
        idle = state.mission_state not in (mavlink.MISSION_STATE_UNKNOWN, mavlink.MISSION_STATE_ACTIVE)
        if idle or self.path_finished or not 0 < current <= len(active.items):
            self._witness.rest()
        elif kind == "MISSION_CURRENT":
            self._witness.named(current)
        elif kind == "NAV_CONTROLLER_OUTPUT":
            claimed_m, distance_m = message.wp_dist, self._distance_m(state, active.items[current - 1])
            if self._witness.doubts_way(now, claimed_m, distance_m, slack_m):
                text = f"the boat sails {claimed_m} m to waypoint {current}, ours is {distance_m:.0f} m away"
                self.dispatch.doubt(text)

    def _distance_m(self, state: VehicleState, item: MissionItem) -> float:
        """From where the autopilot believes to be, glitch or not, as it reckons from there itself."""
        here_m = self._frame.to_local(state.lat_deg or 0.0, state.lon_deg or 0.0)
        return float(np.hypot(*(self._frame.to_local(item.lat_deg, item.lon_deg) - here_m)))

    def _doubt(self, waypoint_m: FloatArray) -> None:
        """The boat does not make for the mission's first waypoint."""
        self._doubts += 1
        if self._doubts <= DOUBTS:
            self.dispatch.make_current_again()
            return
        assert self.position_m is not None
        self._doubts = 0
        self._stall = Stall(self.position_m, waypoint_m)

    def _count_reached(self, message: Any, state: VehicleState, numbers: list[int]) -> None:
        self._progress.begin(self.dispatch.active)
        current = state.mission_current or 0
        certain = [self._progress.reached(seq, current) for seq in numbers]
        if message.get_type() == "MISSION_CURRENT":
            certain.append(self._progress.told(current, state.mission_state))
        self.dispatch.reached = max([self.dispatch.reached, *certain])
        active, kind = self.dispatch.active, message.get_type()
        # Held to be behind the boat, its waypoint would be sailed to unwatched.
        if active is not None and kind == "MISSION_CURRENT":
            last = len(active.items)
            goes_back = self._progress.goes_back(current, self.dispatch.reached, last)
            self.dispatch.reached = current - 1 if goes_back else self.dispatch.reached


def _authority(configuration: Configuration) -> Authority:
    section = configuration.authority
    return Authority(
        adopt=configuration.mavlink.adopt,
        mode=section.mode,
        resume=section.resume,
        return_mode=_return_mode(configuration),
        return_battery=section.return_battery if section.mode == "full" else None,
        starts_by_itself=section.mode != "full" or section.start == "by_itself",
        heeds_start=configuration.shore.commands.accepted,
    )


def _return_mode(configuration: Configuration) -> int:
    return SMART_RTL if configuration.authority.return_mode == "smart_rtl" else RTL
