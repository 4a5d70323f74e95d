"""Where to go next: candidate sites, information, routes over water."""

from autonomy.planning.errors import PlanningError, Unreachable
from autonomy.planning.exchange import select_by_exchange
from autonomy.planning.information import measurement_covariance, mutual_information
from autonomy.planning.passage import Passage
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.selection import Selection, select_by_dynamic_programming, select_greedily
from autonomy.planning.survey import SurveyArea, SurveyError, read_survey
from autonomy.planning.tour import closed_tour, open_tour

__all__ = [
    "Passage",
    "Plan",
    "PlanRequest",
    "PlanningError",
    "Selection",
    "SurveyArea",
    "SurveyError",
    "Unreachable",
    "closed_tour",
    "measurement_covariance",
    "mutual_information",
    "open_tour",
    "read_survey",
    "select_by_dynamic_programming",
    "select_by_exchange",
    "select_greedily",
]
