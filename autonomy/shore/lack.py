"""Plan and survey are told once, and may be lost on the way: noticing it, and asking. Knows no network or clock."""

from autonomy.effects import Topic
from autonomy.shore.greeting import Greeting
from autonomy.wire_values import HealthNotice, PlanNotice, SurveyNotice

GRACE_S = 5.0
"""What health tells of may still be on its way for so long."""


class Lack:
    """Whether to ask for one thing that has not come, with the patience of a greeting."""

    def __init__(self) -> None:
        self._greeting = Greeting()
        self._since: float | None = None

    def question(self, now: float, lacking: bool) -> bool:
        """Whether to ask, which counts as asked; `closed` must be called when the answer is complete."""
        if not lacking:
            self._since = None
            return False
        if self._since is None:
            self._since = now
            self._greeting.begin()
        return now - self._since >= GRACE_S and self._greeting.question(now)

    def closed(self) -> None:
        """No more answers to a question will come."""
        self._greeting.closed()


def lacking(
    health: HealthNotice | None, plan: PlanNotice | None, survey: SurveyNotice | None
) -> dict[Topic, bool]:
    """What must have been told, going by the newest health, and is not what is held."""
    if health is None:
        return {Topic.PLAN: False, Topic.SURVEY: False}
    return {Topic.PLAN: _lacks_plan(health, plan), Topic.SURVEY: survey is None}


def _lacks_plan(health: HealthNotice, plan: PlanNotice | None) -> bool:
    if plan is None or not health.replans:
        return health.replans > 0
    if plan.run == health.run:
        return health.replans > plan.sequence
    # A run that goes on from a checkpoint goes on counting, and does not tell again the plan that it sails.
    return health.replans != plan.sequence
