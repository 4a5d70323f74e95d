"""The vehicle as the core sees it: who commands it, which mission it sails, and how to send it another."""

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.compiler import compile_mission, handling_of
from autonomy.config import Configuration
from autonomy.dispatch import Dispatched, MissionDispatch
from autonomy.geometry import LocalFrame
from autonomy.headway import Headway
from autonomy.mavlink.authority import Authority
from autonomy.mavlink.authority_table import Action
from autonomy.mavlink.companion import StreamRequests, heartbeat, status_text, wanted_streams
from autonomy.mavlink.mission import Route, time_scale
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.rover import RTL, SMART_RTL, unsupported
from autonomy.mavlink.safeguards import NOT_READ, Safeguards, SafeguardsReading
from autonomy.mavlink.telemetry import Telemetry
from autonomy.mavlink.vehicle import VehicleState
from autonomy.notes import AutopilotWords, Note
from autonomy.orders import Orders
from autonomy.planning.plan import Plan

HEARTBEAT_S = 1.0

ASK_AGAIN_S = 30.0
"""Streams are asked for again when there has been no position for so long: another station on the link may have
stopped them, or a restart so quick that no heartbeat was missed."""

STALE_POSITION_S = 10.0
"""A vehicle that has not told its position for this long is nowhere: nothing is planned from where it was, and it is
not set in motion."""


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
    """Everything said to and heard from the autopilot, above the protocol machines.

    What there is to hear is shared out: `telemetry` knows the vehicle, `authority` who commands it, `dispatch` which
    mission is on board, and `headway` where on it the vessel is.
    """

    def __init__(self, configuration: Configuration, frame: LocalFrame) -> None:
        self._configuration = configuration
        self._mavlink = configuration.mavlink
        self._frame = frame
        self.telemetry = Telemetry.of(configuration)
        self.authority = _authority(configuration)
        self.dispatch = MissionDispatch(self.authority)
        self.headway = Headway(configuration, frame, self.telemetry, self.authority, self.dispatch)
        self._streams: StreamRequests | None = None
        self._streams_asked = 0.0
        self._heartbeat_due = 0.0
        self._conversing = False
        self._heartbeats_before = 0
        self._words = AutopilotWords()
        self._safeguards: SafeguardsReading | None = None
        self._safeguards_of = 0
        self._orders = Orders(_return_mode(configuration))
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

    def offer(self, plan: Plan) -> None:
        """Make this plan the next to bring on board, or its first stretch if it is too long for the autopilot."""
        items = compile_mission(plan, self._frame, handling_of(self._configuration, self.headway.pace_mps))
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
            self.authority.observe(state)
            if message.get_type() == "MISSION_CURRENT":
                self.dispatch.compare(state)
        reached = self.headway.handle(now, message, state, changed=state is not before)
        replies = [] if self._streams is None else self._streams.handle(now, message)
        talking = self.dispatch.talking
        replies += self.dispatch.handle(now, message)
        self._orders.handle(message)
        if self._safeguards is not None and self.authority.may_transfer:
            unread = self.unread
            replies += self._safeguards.handle(now, message)
            talking = talking or self.unread != unread
        return Heard(observations, replies, news=state is not before or reached or talking)

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
