"""Re-planning: when the worker is asked for a plan, with what, and what becomes of its answer. One job at a time.

A boat on its way home needs no plan, but goes on learning: then the worker is asked for a re-estimate alone.
"""

from dataclasses import dataclass, replace

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.course import Course
from autonomy.effects import Level, StartJob
from autonomy.exploration import Decision, Exploration, Figures, Trigger
from autonomy.helm import Helm
from autonomy.homeward import Homeward
from autonomy.learning.learner import Learner
from autonomy.planning.passage import Unreachable
from autonomy.planning.plan import Plan
from autonomy.planning.planners import PlanRequest
from autonomy.reporting import Reporter
from autonomy.seaway import Seaway
from autonomy.situation import Situation

JOB_RETRY_S = 5.0
"""Pause after a job without a plan, doubled with every further one up to 32 times as long."""

FAILURES_AT_SEA = 3
"""So many jobs without a plan for a boat at the end of its path, and what a budget has left is for the way home."""


@dataclass(frozen=True)
class _Job:
    job_id: int
    decision: Decision
    started: float


def figures(learner: Learner, model_time_s: float, *, path_finished: bool = False) -> Figures:
    """What the decision looks at, of a learner alone."""
    return Figures(
        model_time_s=model_time_s,
        basis_size=len(learner.gp) if learner.born else 0,
        capacity=learner.capacity,
        fresh=learner.fresh_count,
        replaced=learner.replaced_since_mark,
        path_finished=path_finished,
        cells=len(learner.history),
        places=learner.history.places,
        spread=learner.history.variance / learner.gp.kernel.signal_variance if learner.born else 0.0,
    )


class Replanning:
    """See the module's description. It looks at rooms that belong to the core, and tells the learner."""

    def __init__(
        self,
        configuration: Configuration,
        learner: Learner,
        helm: Helm,
        seaway: Seaway,
        homeward: Homeward,
        course: Course,
        situation: Situation,
        reporter: Reporter,
    ) -> None:
        self._configuration = configuration
        self._exploration = Exploration(configuration.exploration)
        self._learner = learner
        self._helm, self._seaway, self._homeward = helm, seaway, homeward
        self._course, self._situation, self._reporter = course, situation, reporter
        self._job: _Job | None = None
        self._jobs_started = 0
        self._failed_in_a_row = 0
        self._not_before = 0.0
        self._owed: Decision | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a job is under way."""
        return self._job is not None

    @property
    def is_due(self) -> bool:
        """Whether a plan is being made, or owed as soon as one can be made."""
        return self.is_busy or self._owed is not None

    @property
    def rho(self) -> float:
        """The paper's rho of the moment, in [0, 1]."""
        return self._exploration.rho(self._figures())

    def want(self, trigger: Trigger) -> None:
        """A new plan is wanted as soon as one can be made; after one that failed, when its pause is over."""
        self._owed = Decision(trigger, False, trigger.value)
        self._not_before = self._not_before if self._failed_in_a_row else 0.0

    def postpone(self, now: float, problem: str) -> None:
        """There is no plan to sail, and why: the next is made after a pause."""
        pause_s = JOB_RETRY_S * 2 ** min(self._failed_in_a_row, 5)
        self._failed_in_a_row += 1
        self._not_before = now + pause_s
        if self._failed_in_a_row >= FAILURES_AT_SEA and self._helm.headway.path_finished:
            self._homeward.give_up()
        self._reporter.log(Level.WARNING, f"{problem}; trying again in {pause_s:.0f} s")

    def resume(self, stale: str | None) -> None:
        """Go on in another process: the job of the last one has failed. `stale`: why its plan is; None: it is not."""
        if self._job is not None:
            self._job = None
            self._learner.withdraw_request()
        if stale is not None:
            self._owed = self._owed or Decision(Trigger.RESUMED, False, stale)

    # Asking ---------------------------------------------------------------------------------------------------

    def decide(self, now: float) -> Decision | None:
        """What to ask the worker now, if it is time to: a plan that could be sailed, or a re-estimate."""
        helm = self._helm
        if self.is_busy or now < self._not_before or not self._situation.may_upload:
            return None
        if not helm.headway.is_sure or helm.dispatch.busy:
            return None
        if helm.unread is not None or self._seaway.problem is not None or self._situation.is_lost(now):
            return None
        if (self._homeward.reason or self._situation.wish is not None) and helm.authority.survey_started:
            return self._decide_on_the_way_home(now)
        if helm.dispatch.active is None or not helm.authority.survey_started:
            return Decision(Trigger.FIRST_PLAN, False, Trigger.FIRST_PLAN.value)
        if not helm.headway.sailing_ours:
            return Decision(Trigger.DAMAGED, False, Trigger.DAMAGED.value)
        if self._homeward.has_room:
            return Decision(Trigger.ROOM, False, Trigger.ROOM.value)
        if self._homeward.is_returning:
            return self._decide_on_the_way_home(now)
        if self._situation.is_deaf(now):
            # There is nothing new to plan with; fences and stalls are another matter.
            return self._owed
        return self._exploration.decide(self._figures()) or self._owed

    def _decide_on_the_way_home(self, now: float) -> Decision | None:
        """A re-estimate, if the readings ask for one; what is left of the path is none of its business."""
        homeward = self._homeward
        if not homeward.is_returning or homeward.is_finished or self._situation.is_deaf(now):
            return None
        if not self._learner.born:
            return None
        decision = self._exploration.decide(replace(self._figures(), path_finished=False, sailed_share=0.0))
        return None if decision is None else replace(decision, plans=False)

    def start(self, now: float, decision: Decision) -> StartJob:
        """What the worker is asked. RuntimeError if a plan is wanted and the vessel's position is not known yet."""
        self._jobs_started += 1
        configuration, learner = self._configuration, self._learner
        estimate = None
        if decision.reestimate and learner.born:
            estimate = learner.reestimate_request(self._seed, configuration.estimation)
        elif decision.trigger is Trigger.PATH_FINISHED:
            # In the paper every new path begins with rho = 0, re-estimate or not.
            learner.mark()
        planning = configuration.planning
        plan = self._plan_request(decision) if decision.plans else None
        request = jobs.ExploreRequest(estimate, planning.planner, plan, self._seaway.restrictions)
        self._job = _Job(self._jobs_started, decision, now)
        return StartJob(self._jobs_started, jobs.EXPLORE, request, planning.deadline_s)

    def _plan_request(self, decision: Decision) -> PlanRequest:
        configuration, learner = self._configuration, self._learner
        departure = self._course.begin(reestimates=decision.reestimate)
        budget_m, home_m = self._homeward.bounds(
            self._helm.headway.position_m, departure.start_m, self._seaway.water
        )
        return PlanRequest(
            model=learner.model(self._helm.model_time_s),
            start_m=departure.start_m,
            spots=configuration.planning.spots,
            lattice=configuration.planning.lattice,
            reason=decision.reason,
            seed=self._seed,
            iterations=configuration.planning.iterations,
            remainder_m=departure.remainder_m,
            remainder_is_spot=departure.remainder_is_spot,
            measured=learner.history.cells() if len(learner.history) else None,
            roughness=learner.roughness.frozen(),
            sample_spacing_m=configuration.sampling.spacing_m,
            speed_mps=self._helm.headway.pace_mps,
            budget_m=budget_m,
            home_m=home_m,
            model_version=learner.samples if learner.born else None,
        )

    @property
    def _seed(self) -> int:
        return self._configuration.seed + self._jobs_started

    def _figures(self) -> Figures:
        active = self._helm.dispatch.active
        return replace(
            figures(self._learner, self._helm.model_time_s, path_finished=self._helm.headway.path_finished),
            sailed_share=self._course.sailed_share,
            planner="" if active is None else active.plan.planner,
        )

    # The answer -----------------------------------------------------------------------------------------------

    def finished(self, now: float, job_id: int, result: jobs.ExploreResult) -> Decision | None:
        """The worker is done: the model is adopted. Returns what the job was for; None if it is not ours any more."""
        job = self._job
        if job is None or job.job_id != job_id:
            return None
        self._job = None
        if job.decision.plans:
            self._course.took(now - job.started, reestimated=job.decision.reestimate)
            self._owed = replace(job.decision, reestimate=False)
        if result.reestimate is not None:
            self._learner.adopt(result.reestimate)
            self._exploration.reestimated(self._helm.model_time_s, len(self._learner.history))
            self._reporter.reestimated(result.reestimate)
        if result.problem is not None:
            self.postpone(now, f"no plan: {result.problem}")
        return job.decision

    def failed(self, now: float, job_id: int, reason: str) -> None:
        """The worker has no answer."""
        if self._job is None or self._job.job_id != job_id:
            return
        self._job = None
        self._learner.withdraw_request()
        self.postpone(now, f"the planning job failed: {reason}")

    def accepted(self, now: float, plan: Plan, trigger: Trigger) -> Plan | None:
        """The plan as it is to be sailed from here; None if it is not to be, which is said."""
        if not self._seaway.is_open(plan.route_m, ends_home=plan.home_corners > 0):
            self._reporter.log(
                Level.INFO, "the new plan is dropped: part of its water has been closed meanwhile"
            )
            return None
        if not self._situation.wants_plans:
            self._reporter.log(Level.INFO, f"the new plan is dropped: {self._situation.reason}")
            return None
        accepted = None
        if not self._course.keeps(plan, trigger):
            try:
                joined = self._course.joined(plan)
                accepted = self._homeward.fitted(joined, self._helm.headway.position_m, self._seaway.water)
            except Unreachable as error:
                self.postpone(now, f"the new plan can't be joined: {error}")
                return None
        self._failed_in_a_row, self._owed = 0, None
        return accepted
