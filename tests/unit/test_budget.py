"""Limits, what is left of them, and what legs cost: values worked out by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from autonomy.budget import DISTANCE, DURATION, ENERGY, Budget, Reading, Stage
from autonomy.config import BudgetSection

HERE = np.zeros(2)


def budget(**keys: float | None) -> Budget:
    return Budget(BudgetSection.model_validate(keys))


def at(time_s: float, x_m: float = 0.0, **told: float | None) -> Reading:
    """After so many metres due east."""
    return Reading(time_s, np.array([x_m, 0.0]), sailed_m=x_m, **told)  # type: ignore[arg-type]


def test_without_limits_everything_is_affordable() -> None:
    endless = budget()
    assert not endless.is_limited
    assert endless.metres() == math.inf
    assert endless.affords(np.full(3, 1e12))
    assert endless.room([(0, 0), (1e6, 0)], 1.2) == 1.0
    assert endless.stage([(0, 0), (1e6, 0)]) == (Stage.FINE, "")


def test_distance_and_time_count_from_the_start_and_the_reserve_is_not_spent() -> None:
    some = budget(distance_m=1000.0, duration_s=2000.0, reserve=0.1)
    some.follow(at(50.0, 300.0))
    some.begin()
    np.testing.assert_allclose(some.left()[:2], [1000.0, 2000.0])
    some.follow(at(450.0, 700.0))
    np.testing.assert_allclose(some.left()[:2], [600.0, 1600.0])
    np.testing.assert_allclose(some.usable()[:2], [500.0, 1400.0])
    assert some.usable()[ENERGY] == math.inf


def test_energy_counts_from_the_charge_at_the_start() -> None:
    some = budget(energy_wh=1000.0, consumption_j_per_m=100.0, reserve=0.2)
    some.follow(at(0.0, charge=0.8, consumed_j=5e4))
    some.begin()
    some.follow(at(10.0, charge=0.8, consumed_j=5e4 + 36e4))  # 100 Wh
    assert some.left()[ENERGY] == pytest.approx((800.0 - 100.0) * 3600.0)
    assert some.usable()[ENERGY] == pytest.approx((700.0 - 200.0) * 3600.0)


def test_the_gauge_is_believed_where_it_is_the_lower() -> None:
    some = budget(energy_wh=1000.0, consumption_j_per_m=100.0)
    some.follow(at(0.0, charge=0.8, consumed_j=0.0))
    some.begin()
    some.follow(at(10.0, charge=0.3, consumed_j=3.6e5))
    assert some.left()[ENERGY] == pytest.approx(310.0 * 3600.0)


def test_where_the_autopilot_tells_nothing_the_guess_counts() -> None:
    some = budget(energy_wh=100.0, consumption_j_per_m=72.0)
    some.follow(at(0.0))
    some.begin()
    some.follow(at(1000.0, 2500.0))
    assert some.left()[ENERGY] == pytest.approx(360e3 - 72.0 * 2500.0)


def test_the_cost_of_a_leg_before_anything_is_learnt() -> None:
    some = budget(energy_wh=100.0, consumption_j_per_m=72.0, speed_mps=2.0)
    (distance_m, duration_s, energy_j), _ = some.costs([(0, 0), (300, 400), (0, 0)])
    assert distance_m == pytest.approx(500.0)
    # On the safe side by a deviation: half of the guess, and a fifth of it for the current.
    assert duration_s == pytest.approx(500.0 / 2.0 * (1.0 + math.hypot(0.5, 0.2)))
    assert energy_j == pytest.approx(500.0 * 72.0 * (1.0 + math.hypot(0.5, 0.2)))


def learnt(current_mps: float) -> Budget:
    """After twenty minutes each way, at 2 m/s through the water and 100 J/m, in a current from the west."""
    some = budget(energy_wh=1e4, consumption_j_per_m=300.0)
    time_s, x_m, sailed_m, joules = 0.0, 0.0, 0.0, 0.0
    for towards in (1.0, -1.0):
        for _ in range(120):
            time_s += 10.0
            step_m = 10.0 * (current_mps + 2.0 * towards)
            x_m, sailed_m, joules = x_m + step_m, sailed_m + abs(step_m), joules + 2000.0
            point = np.array([x_m, 0.0])
            some.follow(Reading(time_s, point, sailed_m, consumed_j=joules))
    return some


def test_what_is_learnt_prices_legs_by_their_direction() -> None:
    some = learnt(0.5)
    assert some.speed_mps == pytest.approx(1.0 / (0.5 / 2.5 + 0.5 / 1.5), rel=0.03)
    east, west = some.costs([(0, 0), (1000, 0), (0, 0)])
    assert east[DURATION] == pytest.approx(400.0, rel=0.08)
    assert west[DURATION] == pytest.approx(667.0, rel=0.08)
    assert west[ENERGY] / east[ENERGY] == pytest.approx(2.5 / 1.5, rel=0.08)
    assert west[ENERGY] >= 100.0 * 2.0 * 667.0  # on the safe side


def test_nothing_is_learnt_while_somebody_else_sails() -> None:
    some = budget(energy_wh=1e4, consumption_j_per_m=300.0)
    for k in range(200):
        reading = Reading(10.0 * k, np.array([20.0 * k, 0.0]), 20.0 * k, consumed_j=2e3 * k, is_sailing=False)
        some.follow(reading)
    assert some.consumption_j_per_m == 300.0
    assert some.speed_mps == 1.5


def test_metres_left_are_those_of_the_scarcest_limit() -> None:
    assert budget(distance_m=1000.0, reserve=0.25).metres() == pytest.approx(750.0)
    some = learnt(0.0)
    assert some.metres() == pytest.approx(0.9 * (1e4 * 3600 - 240 * 2e3) / 100.0, rel=0.06)


def test_stages_by_the_way_home() -> None:
    some = budget(distance_m=1000.0, reserve=0.1, home_margin=1.2)
    some.follow(at(0.0))
    some.begin()
    some.follow(at(300.0, 500.0))  # 400 m may still be spent
    assert some.stage([(0, 0), (360, 0)])[0] is Stage.FINE
    stage, why = some.stage([(0, 0), (370, 0)])  # 1.1 × 370 = 407
    assert stage is Stage.LOW
    assert why == "0.4 km left to spend, the way home takes 0.4 km"
    assert some.stage([(0, 0), (401, 0)])[0] is Stage.CRITICAL


def test_stages_by_the_charge() -> None:
    some = budget(low_battery=0.3, critical_battery=0.15)
    assert some.is_limited
    for charge, stage in ((0.31, Stage.FINE), (0.3, Stage.LOW), (0.16, Stage.LOW), (0.15, Stage.CRITICAL)):
        some.follow(at(0.0, charge=charge))
        assert some.stage([HERE, HERE])[0] is stage
    assert some.stage([HERE, HERE])[1] == "the battery is at 15%"


def test_room_is_what_the_way_home_leaves() -> None:
    some = budget(distance_m=1000.0, reserve=0.1)
    assert some.room([(0, 0), (400, 0)], 1.5) == pytest.approx((900.0 - 600.0) / 1000.0)
    assert some.limits[DISTANCE] == 1000.0


def test_another_survey_begins_with_a_budget_of_its_own() -> None:
    some = budget(distance_m=1000.0, energy_wh=100.0, consumption_j_per_m=72.0, reserve=0.0)
    some.follow(at(0.0, 0.0, consumed_j=0.0))
    some.begin()
    some.follow(at(600.0, 900.0, consumed_j=300e3, charge=1.0))
    some.begin()
    np.testing.assert_allclose(some.left()[[DISTANCE, ENERGY]], [1000.0, 360e3])


def test_the_example_of_the_documentation_is_accepted() -> None:
    page = (Path(__file__).parents[2] / "docs" / "budget.md").read_text()
    example = yaml.safe_load(page.split("```")[1])
    some = Budget(BudgetSection.model_validate(example["budget"], strict=False))
    np.testing.assert_allclose(some.limits, [30e3, 21600.0, 1200.0 * 3600.0])


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"energy_wh": 100.0}, "needs budget.consumption_j_per_m"),
        ({"low_battery": 0.2, "critical_battery": 0.3}, "must be at most budget.low_battery"),
        ({"home_margin": 0.9}, "greater than or equal to 1"),
        ({"reserve": 1.0}, "less than 1"),
    ],
)
def test_what_cannot_be_is_refused(keys: dict[str, float], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        BudgetSection.model_validate(keys)


def test_the_shorter_the_way_the_less_the_weather_averages_out() -> None:
    some = learnt(0.0)
    spread_j_per_m = 0.05 * 100.0  # nothing is steadier at sea
    for length_m, coherent_m in ((400.0, 400.0), (4000.0, 2000.0)):
        way = [(0.0, 0.0), (length_m, 0.0)]
        more = some.cost(way) - some.costs(way).sum(axis=0)
        assert more[ENERGY] == pytest.approx(spread_j_per_m * coherent_m, rel=0.02)
        assert more[DISTANCE] == 0.0
