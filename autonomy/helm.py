"""The vehicle as the core sees it: where it is, who commands it, which mission it sails, and how to send it another."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from autonomy.config import Configuration
from autonomy.dispatch import Dispatched, MissionDispatch
from autonomy.geometry import FloatArray, LocalFrame, advance_along
from autonomy.mavlink.authority import Authority, OnBoard, unsupported
from autonomy.mavlink.companion import StreamRequests, heartbeat, status_text, wanted_streams
from autonomy.mavlink.mission import Route, time_scale, waypoint
from autonomy.mavlink.telemetry import Observation, Telemetry, VehicleState
from autonomy.notes import AutopilotWords, Note
from autonomy.planning.plan import Plan
from autonomy.progress import Progress
from autonomy.track import Track

HEARTBEAT_S = 1.0


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
        self._mavlink = configuration.mavlink
        self._frame = frame
        self.telemetry = Telemetry(
            configuration.sensor.message_name,
            pairing_gap_s=configuration.sampling.pairing_gap_s,
            vehicle_system_id=configuration.mavlink.system_id,
            link_timeout_s=configuration.mavlink.link_timeout_s,
        )
        self.authority = Authority(adopt=configuration.mavlink.adopt)
        self.dispatch = MissionDispatch(self.authority)
        self._track = Track()
        self._streams: StreamRequests | None = None
        self._heartbeat_due = 0.0
        self._conversing = False
        self._heartbeats_before = 0
        self._progress = Progress()
        self._words = AutopilotWords()

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
    def distance_m(self) -> float:
        """How far the vessel has sailed."""
        return self._track.distance_m

    @property
    def sailing_ours(self) -> bool:
        """Whether we have the boat and it sails a verified mission of ours."""
        ours = self.authority.on_board is OnBoard.OURS and self.dispatch.active is not None
        return ours and self.authority.in_command

    @property
    def path_finished(self) -> bool:
        """Whether the verified mission on board has been sailed to its end and nothing newer is on its way."""
        active = self.dispatch.active
        if self.state is None or active is None or not self.sailing_ours or self.dispatch.busy:
            return False
        return self._progress.is_complete or self.dispatch.reached >= len(active.items)

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
        # Item 0 is home, so waypoint k of the mission is row k - 1 of the route.
        return np.vstack(
            [here, self.dispatch.active.plan.route_m[max(0, (self.state.mission_current or 1) - 1) :]]
        )

    def expected_point_m(self, delay_s: float) -> FloatArray:
        """Where the vessel will be after `delay_s` of protocol time, shape (2,), if it keeps to its mission."""
        speed_mps = 0.0 if self.state is None else self.state.groundspeed_mps or 0.0
        return advance_along(self.remaining_route_m(), speed_mps * delay_s * self.telemetry.clock_rate)

    def offer(self, plan: Plan) -> None:
        """Make this plan the next to bring on board."""
        radius_m = self._mavlink.acceptance_radius_m
        geodetic = self._frame.to_geodetic(plan.route_m).tolist()
        items = tuple(waypoint(lat, lon, acceptance_radius_m=radius_m) for lat, lon in geodetic)
        self.dispatch.offer(Dispatched(plan, items))

    def say(self, text: str) -> list[Any]:
        """A line to the operator's ground station; returns messages to send."""
        return [status_text(text)]

    def take_notes(self, now: float) -> list[Note]:
        """What happened, and what the autopilot wrote to its operator, since the last call, for the log."""
        return self.dispatch.take_notes() + self._words.notes(now, self.telemetry.take_texts())

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
        replies = [] if self._streams is None else self._streams.handle(now, message)
        talking = self.dispatch.talking
        replies += self.dispatch.handle(now, message)
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
        route = Route(state.system_id, self._mavlink.component_id, state.system_id, state.component_id)
        if self._streams is None:
            streams = wanted_streams(self._mavlink.position_rate_hz)
            self._streams = StreamRequests(streams, route, time_scale=scale)
            sent += self._streams.start(now)
        sent += self._streams.on_deadline(now)
        return sent + self.dispatch.step(now, state, route, scale)

    def next_deadline(self) -> float:
        """When `step` must be called at the latest."""
        if not self._conversing:
            return self._heartbeat_due
        asked = None if self._streams is None else self._streams.next_deadline()
        deadlines = [self._heartbeat_due, asked, self.dispatch.next_deadline()]
        return min(deadline for deadline in deadlines if deadline is not None)

    def _follow(self, message: Any, state: VehicleState) -> None:
        """Mode, position, progress and the mission's size, after a message was taken in."""
        self.authority.observe(state)
        kind = message.get_type()
        if kind == "GLOBAL_POSITION_INT" and state.position_ok and state.model_time_s is not None:
            assert state.lat_deg is not None
            assert state.lon_deg is not None
            self._track.follow(state.model_time_s, self._frame.to_local(state.lat_deg, state.lon_deg))
        elif kind == "MISSION_CURRENT":
            self.dispatch.compare(state)

    def _count_reached(self, message: Any, state: VehicleState, numbers: list[int]) -> None:
        self._progress.begin(self.dispatch.active)
        current = state.mission_current or 0
        certain = [self._progress.reached(seq, current) for seq in numbers]
        if message.get_type() == "MISSION_CURRENT":
            certain.append(self._progress.told(current, state.mission_state))
        self.dispatch.reached = max([self.dispatch.reached, *certain])
