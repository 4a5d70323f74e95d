"""Which planner the name `auto` stands for."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from autonomy.geometry import LocalFrame
from autonomy.learning import Hyperparameters
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck
from autonomy.planning.planners import AUTO, PlanRequest, make_plan
from autonomy.planning.survey import SurveyArea

SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0.0, 0.0, 3000.0, 3000.0))
STILL = Hyperparameters(1.0, 0.01, (600.0, 600.0)).kernel
MOVING = Kernel((Component(1.0, SquaredExponential((600.0, 600.0)), OrnsteinUhlenbeck(20_000.0)),), 0.01)


@pytest.mark.parametrize(
    ("kernel", "budget_m", "planner"),
    [
        (STILL, None, "spots"),
        (MOVING, None, "patrol"),
        (STILL, 12_000.0, "route"),
        (MOVING, 12_000.0, "route"),
    ],
)
def test_auto_asks_whether_there_is_an_end_and_whether_the_field_moves(kernel, budget_m, planner):
    request = PlanRequest(
        FieldModel.prior(kernel), np.array([100.0, 100.0]), 5, (6, 6), "first plan", iterations=4
    )
    plan = make_plan(AUTO, replace(request, budget_m=budget_m), SURVEY)
    assert plan.planner == planner
    assert SURVEY.legs_are_clear([plan.start_m, *plan.route_m[:-1]], plan.route_m).all()
