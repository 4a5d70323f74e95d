"""The core: ties the rooms together and owns all state. It decides; its shell does.

`Core.handle(now, event) -> effects` is synchronous and reads no clock, socket or file. `now` is protocol time (the
process's monotonic clock); model time comes from the vehicle's own clock inside its messages.
"""

import math
from collections.abc import Sequence
from typing import Any

from autonomy import jobs
from autonomy.budget import Reading, Stage
from autonomy.config import Configuration
from autonomy.course import Course
from autonomy.directives import Directives
from autonomy.effects import Answer, Effect, Level, SendMessage
from autonomy.events import (
    CommandReceived,
    Event,
    JobFailed,
    JobFinished,
    LinkDown,
    LinkUp,
    MessageReceived,
    StopRequested,
)
from autonomy.exploration import Trigger
from autonomy.geometry import FloatArray
from autonomy.handback import Handback
from autonomy.helm import Helm
from autonomy.homeward import Homeward, Sailing
from autonomy.learning.learner import Learner
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.safeguards import Safeguards
from autonomy.memory import Memory, UnfitMemoryError, capture, restore
from autonomy.planning.passage import Unreachable
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from autonomy.replanning import Replanning
from autonomy.reporting import Reporter, Status
from autonomy.sampling import TOO_CLOSE, Sample, SampleGate
from autonomy.schooling import make_learner
from autonomy.seaway import Seaway
from autonomy.situation import Situation

STALE_PLAN_S = 60.0
"""A plan that waited this long for a service that was away is made anew from where the vessel is."""


class Core:
    """The decisions of one survey; see the module's description."""

    def __init__(self, configuration: Configuration, survey: SurveyArea) -> None:
        self._survey = survey
        self._seaway = Seaway(configuration, survey)
        self._safeguards: Safeguards | None = None
        self._helm = Helm(configuration, survey.frame)
        self._gate = SampleGate(survey, configuration)
        self._learner = make_learner(configuration, survey)
        self._repairs_told = 0
        self._reporter = Reporter(configuration, survey, self._helm.telemetry, self._learner)
        self._course = Course(configuration, self._helm, self._seaway, self._reporter)
        self._handback = Handback(self._helm, self._seaway, self._reporter)
        self._homeward = Homeward(configuration, survey)
        self._situation = Situation(
            self._helm, self._seaway, self._homeward, self._reporter, configuration.sensor.message_name
        )
        rooms = (self._helm, self._seaway, self._homeward, self._course, self._situation, self._reporter)
        self._directives = Directives(configuration, *rooms)
        self._replanning = Replanning(configuration, self._learner, *rooms)
        self._effects: list[Effect] = []
        self._plans = 0
        self._stopping = False
        self._now = 0.0
        self._ahead_s = 0.0
        self._explained: set[str] = set()

    def handle(self, now: float, event: Event) -> list[Effect]:
        """Take in one event at protocol time `now`; returns what the shell shall do, in order."""
        now += self._ahead_s
        news = True
        self._now = now
        match event:
            case MessageReceived(message):
                news = self._hear(now, message)
            case JobFinished(job_id, result):
                self._finish(now, job_id, result)
            case JobFailed(job_id, reason):
                self._replanning.failed(now, job_id, reason)
            case LinkUp():
                self._helm.link_changed()
                self._reporter.log(Level.INFO, "link to the vehicle is open")
            case LinkDown(reason):
                self._helm.link_changed()
                self._reporter.log(Level.WARNING, f"link to the vehicle is gone: {reason}")
            case CommandReceived():
                self._send(self._directives.take(now, event, stopping=self._stopping))
            case StopRequested():
                self._stop()
        if not self._stopping and (news or now >= self.next_deadline()):
            self._step(now)
        effects = self._effects + self._reporter.take() + self._directives.answers()
        self._effects = []
        return effects

    def next_deadline(self) -> float:
        """Protocol time at which `handle(now, DeadlineReached())` must be called at the latest."""
        if self._stopping:
            return math.inf
        if self._learner.behind:
            return self._now - self._ahead_s
        due = min(self._helm.next_deadline(), self._reporter.next_deadline())
        called = due - self._ahead_s
        while called + self._ahead_s < due:
            # Rounded down it would be too early by the core's own time, and nothing would be done.
            called = math.nextafter(called, math.inf)
        return called

    @property
    def conversation(self) -> object | None:
        """The conversation about the mission on board that goes on, whichever it is; None without one."""
        return self._helm.dispatch.conversation

    @property
    def milestones(self) -> int:
        """Grows when something has been decided that the next run has to know to recognise what is on board."""
        return self._helm.dispatch.milestones + self._directives.milestones

    def report(self, command: CommandReceived) -> Answer:
        """How things are, for somebody ashore who asks no more than that."""
        return self._directives.report(command)

    @property
    def safeguards(self) -> Safeguards | None:
        """What the autopilot has to keep the boat safe; the same object until it is read again."""
        return self._safeguards

    @property
    def learner(self) -> Learner:
        """What has been learnt, to be looked at."""
        return self._learner

    @property
    def utc_s(self) -> float | None:
        """The moment that the vehicle's clock last told, seconds since 1970; None while they are not known."""
        return self._reporter.utc_s

    @property
    def position_m(self) -> FloatArray | None:
        """Where the vessel was last, shape (2,), local metres."""
        return self._helm.headway.position_m

    def checkpoint(self) -> Memory:
        """All that is known, to be called between two events: cheap, and safe to encode in another thread."""
        return capture(self)

    def restore(self, memory: Memory) -> None:
        """Become the core that gave this `checkpoint`, at its time; for a new core only.

        Whatever this one was made with (configuration, survey) stays. Raises UnfitMemoryError: throw this one away.
        """
        begun = self._helm.authority.command
        restore(memory, self)
        try:
            self._helm.authority.settle(begun)
        except (AttributeError, TypeError) as error:
            raise UnfitMemoryError(f"who has the boat is not in it: {error}") from error
        try:
            fault = self._learner.gp.check() if self._learner.born else None
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            raise UnfitMemoryError(f"there is no model: {error}") from error
        if fault is not None:
            raise UnfitMemoryError(f"the model is broken: {fault}")

    def resume(self, now: float, away_s: float) -> None:
        """Go on, in another process perhaps, after `away_s` seconds without events; protocol time is `now`.

        Nothing that was under way is taken up blindly: the vehicle counts as silent until its heartbeat is heard, the
        mission on board as unknown until it is read, a job as failed. The vehicle's clock may go on or have started
        again, which `ModelClock` tells.
        """
        self._now += max(0.0, away_s)
        self._ahead_s = self._now - now
        self._stopping = False
        self._effects.clear()
        stale = None
        if self._helm.resume() and away_s > STALE_PLAN_S:
            stale = "the plan that was on its way when the service ended is stale"
            self._helm.dispatch.drop_waiting()
        self._replanning.resume(stale)
        self._reporter.resume(away_s)

    # What comes in --------------------------------------------------------------------------------------------

    def _hear(self, now: float, message: Any) -> bool:
        """Take in a message; returns whether it told anything new."""
        heard = self._helm.handle(now, message)
        if any(math.isfinite(observation.value) for observation in heard.observations):
            self._situation.heard_reading(now)
        self._send(heard.replies)
        for observation in heard.observations:
            self._observe(observation)
        return heard.news or bool(heard.observations)

    def _observe(self, observation: Observation) -> None:
        vehicle, started = self._helm.state, self._helm.authority.survey_started
        if vehicle is not None:
            self._learn(self._gate.take(observation, vehicle, survey_started=started))

    def _learn(self, samples: Sequence[Sample]) -> None:
        """Learn from the samples that teach, and tell of all."""
        for sample in samples:
            if sample.teaches:
                observation = sample.observation
                self._learner.add(sample.point_m, observation.value, observation.model_time_s)
            self._reporter.observed(sample.observation, sample.flags)
        self._explain_refusals()

    def _explain_refusals(self) -> None:
        """Say it once for each reason why readings do not teach the model: a silent map wants an explanation."""
        for reason in self._gate.refused.keys() - self._explained - {TOO_CLOSE, "survey not started"}:
            self._reporter.log(Level.WARNING, f"a reading was not learnt (said once): {reason}")
            self._explained.add(reason)

    def _finish(self, now: float, job_id: int, result: jobs.ExploreResult) -> None:
        decision = self._replanning.finished(now, job_id, result)
        if decision is None or result.plan is None:
            return
        self._look(now)
        plan = self._replanning.accepted(now, result.plan, decision.trigger)
        if plan is not None:
            self._bring_on_board(now, plan)

    def _bring_on_board(self, now: float, plan: Plan) -> None:
        self._plans += 1
        self._course.offer(now, plan)
        self._reporter.planned(plan, self._plans)
        self._send(self._helm.say(f"halocline: plan {self._plans}, {plan.length_m / 1e3:.1f} km"))

    def _stop(self) -> None:
        self._stopping = True
        self._learn(self._gate.release(math.inf))
        self._send(self._helm.say("halocline: service stops"))
        self._reporter.log(Level.INFO, "stopping")
        self._reporter.flush(self._status())

    # What time and state ask for ------------------------------------------------------------------------------

    def _step(self, now: float) -> None:
        self._learner.catch_up()
        self._tell_repairs()
        self._learn(self._gate.release(self._helm.model_time_s))
        self._send(self._helm.step(now))
        for note in self._helm.take_notes(now):
            self._reporter.log(Level.WARNING if note.is_warning else Level.INFO, note.text)
        refusal = self._helm.dispatch.take_refusal()
        if refusal is not None:
            self._replanning.postpone(now, f"the plan is given up: {refusal}")
        self._watch_water()
        self._watch_budget(now)
        self._look(now)
        self._watch_course(now)
        self._follow_directives(now)
        decision = self._replanning.decide(now)
        if decision is not None:
            self._effects.append(self._replanning.start(now, decision))
        self._reporter.step(now, self._status)

    def _tell_repairs(self) -> None:
        if self._learner.repairs > self._repairs_told:
            self._repairs_told = self._learner.repairs
            text = f"the model's state had broken: made anew from the history (repair {self._repairs_told})"
            self._reporter.log(Level.ERROR, text)

    def _watch_water(self) -> None:
        """The autopilot's fence, as it is read, and stalls: they narrow the water that may be sailed."""
        safeguards, time_s = self._helm.safeguards, self._helm.model_time_s
        if safeguards is not None and safeguards is not self._safeguards:
            self._safeguards = safeguards
            self._reporter.log(Level.INFO, f"the autopilot has {safeguards.summary}")
            for warning in safeguards.warnings:
                if warning not in self._explained:
                    self._reporter.log(Level.WARNING, warning)
            self._explained.update(safeguards.warnings)
            if self._seaway.enclose(safeguards):
                self._replanning.want(Trigger.FENCE)
                if self._seaway.problem is not None:
                    self._reporter.log(Level.ERROR, self._seaway.problem)
        stall = self._helm.headway.take_stall()
        if stall is not None:
            lasts_s = self._seaway.give_up(time_s, stall.point_m, stall.waypoint_m)
            lat_deg, lon_deg = self._survey.frame.to_geodetic(stall.waypoint_m)
            self._reporter.log(
                Level.WARNING,
                f"the boat is in AUTO and does not get to {lat_deg:.5f}, {lon_deg:.5f}: "
                f"the water there is given up for {lasts_s / 60:.0f} min",
            )
            self._send(self._helm.say("halocline: stalled, sails elsewhere"))
            self._replanning.want(Trigger.STALLED)
        self._seaway.refresh(time_s)

    def _watch_course(self, now: float) -> None:
        """Land before the boat: it is sent round at once, and another plan is made from where it is then."""
        authority, alarm = self._helm.authority, self._course.watch(now)
        if alarm is not None:
            self._send(self._helm.warn(f"halocline: {alarm.text}", critical=alarm.is_critical))
            if not self._replanning.is_due:
                self._replanning.want(Trigger.LAND)
        if authority.waits_on_board and self._helm.headway.is_sure and self._course.begins_across_land(now):
            authority.ask_for_another()
            text = "land lies before waypoint 1 of the mission on board"
            self._reporter.log(Level.WARNING, f"{text}: another is made from where the boat is now")
            self._send(self._helm.warn("halocline: LAND before waypoint 1: wait for plan"))
        words = self._handback.watch(now)
        if words is not None:
            self._send(self._helm.warn(f"halocline: {words}"))

    def _watch_budget(self, now: float) -> None:
        """Mind what distance, time and energy are left; turn the vessel homeward when they ask for it."""
        helm, headway, homeward = self._helm, self._helm.headway, self._homeward
        vehicle, active = helm.state, helm.dispatch.active
        if not homeward.is_minded or vehicle is None or headway.position_m is None:
            return
        homeward.told_home(
            None if vehicle.home_deg is None else self._survey.frame.to_local(*vehicle.home_deg)
        )
        is_sailing = headway.sailing_ours and not headway.path_finished
        reading = Reading.of(vehicle, headway.position_m, headway.distance_m, is_sailing=is_sailing)
        homeward.follow(reading, armed=vehicle.armed, commanded=helm.authority.in_command)
        damaged = headway.has_damaged_ours
        if active is not None and (headway.sailing_ours or damaged):
            route_m = headway.remaining_route_m()
            self._head_home(now, Sailing(active.plan, route_m, headway.path_finished, damaged))
        for note in homeward.take_notes():
            self._reporter.log(Level.WARNING if note.is_warning else Level.INFO, note.text)
            if note.is_warning:
                self._send(helm.warn(f"halocline: {note.text}", critical=homeward.stage is Stage.CRITICAL))

    def _head_home(self, now: float, sailing: Sailing) -> None:
        try:
            plan = self._homeward.watch(
                self._helm.model_time_s, sailing, self._seaway.water, self._helm.headway.pace_mps
            )
        except Unreachable as error:
            self._homeward.cannot(str(error))
            return
        on_its_way = self._helm.dispatch.on_its_way
        if plan is not None and (on_its_way is None or not on_its_way.home_corners):
            self._bring_on_board(now, plan)
        if self._homeward.may_be_sent_home:
            self._helm.authority.return_cause = self._homeward.reason

    def _follow_directives(self, now: float) -> None:
        plan = self._directives.step(now)
        if plan is not None:
            self._bring_on_board(now, plan)
        for words in self._directives.take_words():
            self._send(self._helm.warn(f"halocline: {words}"))
        if self._directives.take_replan():
            self._replanning.want(Trigger.ASHORE)

    def _look(self, now: float) -> None:
        told = self._situation.look(now)
        if told is not None:
            self._send(self._helm.say(f"halocline: {told}"))

    # What goes out --------------------------------------------------------------------------------------------

    @property
    def system_id(self) -> int | None:
        """The vehicle's system id, which is ours too; None until it is known."""
        return None if self._helm.state is None else self._helm.state.system_id

    def _send(self, messages: Sequence[Any]) -> None:
        self._effects.extend(SendMessage(message) for message in messages)

    def _status(self) -> Status:
        trouble = self._course.trouble or self._handback.trouble
        return Status(
            state=self._situation.state.name.lower(),
            reason=self._situation.reason + ("" if trouble is None else f", but {trouble}"),
            rho=self._replanning.rho,
            plans=self._plans,
            worker_busy=self._replanning.is_busy,
            in_touch=self._situation.in_touch,
            distance_m=self._helm.headway.distance_m,
            quality=self._gate.quality.counts,
        )
