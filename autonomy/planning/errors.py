"""What can go wrong in planning."""


class SurveyError(ValueError):
    """The survey's geometry cannot be used; the text says which file, which feature, what would be right."""


class PlanningError(Exception):
    """No plan can be made; the text says why, for a person."""


class Unreachable(PlanningError):  # noqa: N818  (a state of the sea, not a mistake)
    """There is no way over water between two points."""
