"""Routes that end at a home outside the survey: the leg home need only be free of land."""

import numpy as np
import pytest
import shapely

from autonomy.geometry import LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.planning.assembly import verify
from autonomy.planning.errors import PlanningError
from autonomy.planning.plan import Plan
from autonomy.planning.planners import PLANNERS, PlanRequest, make_plan
from autonomy.planning.survey import SurveyArea

MOLE = shapely.box(900, -300, 1000, 200)
SURVEY = SurveyArea.from_geometry(
    LocalFrame(33.5, -118.5), shapely.box(0, 0, 2000, 2000), land=MOLE, passage_cells=40
)
HARBOUR = (600.0, -200.0)


def test_the_leg_home_may_leave_the_survey_and_no_other_leg_may():
    start = (500.0, 500.0)
    verify(start, [(600.0, 100.0), HARBOUR], SURVEY, HARBOUR)
    for home in (None, (700.0, -200.0)):
        with pytest.raises(PlanningError, match="leg 1 of the route"):
            verify(start, [(600.0, 100.0), HARBOUR], SURVEY, home)
    with pytest.raises(PlanningError, match="leg 0 of the route"):
        verify(start, [HARBOUR, (600.0, 100.0), HARBOUR], SURVEY, HARBOUR)


def test_the_leg_home_is_free_of_land():
    with pytest.raises(PlanningError, match="leg 0 of the route"):
        verify((1200.0, 100.0), [HARBOUR], SURVEY, HARBOUR)


@pytest.mark.parametrize(("end", "corners"), [(HARBOUR, 1), ((600.0, 100.0), 0)])
def test_a_plan_that_ends_at_home_says_so(end, corners, monkeypatch):
    route = np.array([(500.0, 500.0), end])
    made = lambda request, survey: Plan(request.start_m, route, np.ones(2, dtype=bool), 0.0, "p", "r")  # noqa: E731
    monkeypatch.setitem(PLANNERS, "p", made)
    model = FieldModel.prior(Hyperparameters(1.0, 0.1, (500.0, 500.0)))
    request = PlanRequest(
        model, np.array([500.0, 100.0]), 5, (5, 5), "r", budget_m=5e3, home_m=np.array(HARBOUR)
    )
    assert make_plan("p", request, SURVEY).home_corners == corners
