"""Random missions within a budget: always home with the reserve unspent, little left over, no leg begun past it.

They are sailed without messages by `sim.budget_trials`, with noise in consumption and current, wrong guesses, and the
vehicle's own `Homeward` and planners. HALOCLINE_MISSIONS says how many (500 take about a quarter of an hour).
"""

import math
import os

import numpy as np
import pytest
import shapely

from autonomy.homeward import Homeward
from sim.budget_trials import ACCEPTANCE_M, Mission, draw

MISSIONS = int(os.environ.get("HALOCLINE_MISSIONS", "3"))


@pytest.mark.timeout(600 + 20 * MISSIONS)
@pytest.mark.parametrize("block", range(-(-MISSIONS // 50)))
def test_home_with_the_reserve_unspent_and_the_budget_used(block: int) -> None:
    for seed in range(50 * block, min(MISSIONS, 50 * (block + 1))):
        conditions = draw(seed)
        outcome = Mission(conditions, seed).sail()
        told = f"mission {seed}: {outcome.use:.3f} of the budget, {outcome.stage.name}, {outcome.plans} plans"
        assert outcome.is_home, told
        assert (outcome.spent <= outcome.usable).all(), told
        assert outcome.use >= 0.85, told
        assert not outcome.overdrawn_legs, told
        assert outcome.legs >= 1, told
        track = shapely.LineString([conditions.home_m, *outcome.track_m])
        assert not conditions.survey.obstacles.intersects(track), told
        assert math.dist(outcome.track_m[-1], conditions.home_m) <= ACCEPTANCE_M, told


def test_a_mission_is_the_same_to_the_last_bit() -> None:
    one, other = (Mission(draw(0), 0).sail() for _ in range(2))
    np.testing.assert_array_equal(one.track_m, other.track_m)
    np.testing.assert_array_equal(one.spent, other.spent)


def test_without_it_the_boat_would_not_come_home(monkeypatch: pytest.MonkeyPatch) -> None:
    """The figures above are no matter of course."""
    monkeypatch.setattr(Homeward, "watch", lambda *_: None)
    monkeypatch.setattr(Homeward, "fitted", lambda _, plan, *__: plan)
    conditions = draw(4)
    monkeypatch.setattr(Homeward, "bounds", lambda *_: (None, None))
    outcome = Mission(conditions, 4).sail()
    assert not outcome.is_home
    assert outcome.overdrawn_legs
    assert outcome.use > 1.0
