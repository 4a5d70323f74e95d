"""What a metre costs, against values worked out by hand."""

import math

import numpy as np
import pytest

from autonomy.consumption import Meter, MetreCost

EAST, NORTH, WEST, SOUTH = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def sail(
    cost: MetreCost, towards: np.ndarray, j_per_m: list[float], *, from_j: float = 0.0, step_j: float = 1.0
) -> float:
    """Sail 110 m at each cost, 10 m at a time, on a meter that counts in steps; returns what has been drawn."""
    for each in j_per_m:
        for _ in range(11):
            from_j += 10.0 * each
            cost.follow(math.floor(from_j / step_j) * step_j, 10.0, 10.0 * towards)
    return from_j


def test_the_guess_holds_until_something_is_measured() -> None:
    cost = MetreCost(80.0)
    assert cost.mean == 80.0
    np.testing.assert_allclose(cost.along([EAST, WEST]), 80.0)
    # Half the guess, and a fifth of it for the direction.
    np.testing.assert_allclose(cost.along(EAST, 1.0), 80.0 * (1.0 + math.hypot(0.5, 0.2)))
    assert MetreCost(None).along(EAST, 1.0)[0] == 0.0


def test_the_posterior_of_windows_that_are_all_alike() -> None:
    cost = MetreCost(150.0)
    sail(cost, EAST, [100.0] * 12)
    windows = 12  # of 110 m; the first begins with the first tick, and the last ends in time
    spread = 0.05 * cost.mean
    precision = np.diag([1 / 75.0**2, 1 / 30.0**2])
    design = np.array([1.0, 1.0])
    precision_after = precision + windows / (4.0 * spread**2) * np.outer(design, design)
    mean = np.linalg.solve(
        precision_after, precision @ [150.0, 0.0] + windows * 100.0 / (4.0 * spread**2) * design
    )
    assert cost.mean == pytest.approx(mean[0], rel=0.01)
    assert cost.along(EAST)[0] == pytest.approx(mean.sum(), rel=0.005)
    assert cost.along(EAST)[0] == pytest.approx(100.0, rel=0.005)


def test_the_current_is_known_after_the_turn_and_not_before() -> None:
    cost = MetreCost(100.0)
    drawn_j = sail(cost, EAST, [80.0] * 15)
    there, back = cost.along([EAST, WEST], 1.0) - cost.along([EAST, WEST])
    assert there < 5.0
    assert back > 30.0  # twice the direction's own deviation, less what the guess says of the mean
    sail(cost, WEST, [120.0] * 15, from_j=drawn_j)
    np.testing.assert_allclose(cost.along([EAST, WEST]), [80.0, 120.0], rtol=0.02)
    assert max(cost.along([EAST, WEST], 1.0) - cost.along([EAST, WEST])) < 5.0


def test_weather_that_has_come_up_is_seen_before_the_mean_sees_it() -> None:
    cost = MetreCost(100.0)
    drawn_j = sail(cost, EAST, [100.0] * 60)
    assert cost.excess == pytest.approx(0.0, abs=0.5)
    drawn_j = sail(cost, EAST, [130.0] * 10, from_j=drawn_j)
    usual = cost.along(EAST)[0]
    assert usual < 106.0
    assert usual + cost.excess == pytest.approx(130.0, rel=0.01)
    sail(cost, EAST, [70.0] * 10, from_j=drawn_j)
    assert cost.excess == 0.0


@pytest.mark.parametrize("current", [0.1, 0.2, 0.3])
def test_a_first_harmonic_prices_a_boat_in_a_current(current: float) -> None:
    """At v = 1 and a current of c to the east the speed made good is c·u + sqrt(1 - (c × u)²)."""
    cost = MetreCost(100.0)
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    truth = 100.0 / (current * directions[:, 0] + np.sqrt(1.0 - (current * directions[:, 1]) ** 2))
    drawn_j = 0.0
    for towards, each in zip(directions, truth, strict=True):
        drawn_j = sail(cost, towards, [float(each)] * 5, from_j=drawn_j)
    assert np.abs(cost.along(directions) / truth - 1.0).max() < 0.06
    assert (cost.along(directions, 1.0) > 0.96 * truth).all()


def test_a_crooked_window_counts_by_its_length_and_its_displacement() -> None:
    cost = MetreCost(100.0)
    drawn_j = 0.0
    for k in range(400):
        towards = EAST if k % 2 else NORTH
        drawn_j += 10.0 * (100.0 + 30.0 * towards[0])
        cost.follow(drawn_j, 10.0, 10.0 * towards)
    drawn_j = sail(cost, WEST, [70.0] * 20, from_j=drawn_j)
    sail(cost, SOUTH, [100.0] * 20, from_j=drawn_j)
    np.testing.assert_allclose(cost.along([EAST, WEST, NORTH]), [130.0, 70.0, 100.0], rtol=0.04)


def test_outliers_do_not_move_the_mean() -> None:
    cost = MetreCost(100.0)
    sail(cost, NORTH, [100.0] * 12 + [900.0] + [100.0] * 12)
    assert cost.along(NORTH)[0] == pytest.approx(100.0, rel=0.01)


def test_a_meter_in_coarse_steps_is_as_exact() -> None:
    cost = MetreCost(200.0)
    sail(cost, EAST, [100.0] * 200, step_j=25_000.0)  # a tick each 250 m
    assert cost.along(EAST)[0] == pytest.approx(100.0, rel=0.05)


def test_a_pause_is_no_part_of_a_window() -> None:
    cost = MetreCost(100.0)
    drawn_j = sail(cost, EAST, [100.0] * 10)
    cost.pause()
    sail(cost, EAST, [100.0] * 10, from_j=drawn_j + 1e6)
    assert cost.along(EAST)[0] == pytest.approx(100.0, rel=0.01)


def test_the_meter_prefers_energy_then_charge_then_the_gauge() -> None:
    meter = Meter(capacity_j=1000.0)
    meter.follow(None, None, None, 0.9)
    assert meter.drawn_j == 0.0
    assert meter.is_coarse
    meter.follow(None, None, None, 0.7)
    assert meter.drawn_j == pytest.approx(200.0)
    meter.follow(None, 5.0, 12.0, 0.7)  # counts from here on
    meter.follow(None, 7.0, 12.0, 0.1)
    assert meter.drawn_j == pytest.approx(200.0 + 2.0 * 12.0)
    assert not meter.is_coarse
    meter.follow(1e6, 8.0, 12.0, 0.1)
    meter.follow(1e6 + 50.0, 8.0, 12.0, 0.1)
    assert meter.drawn_j == pytest.approx(274.0)


def test_a_gauge_that_swings_counts_once_and_a_counter_starts_again() -> None:
    gauge = Meter(capacity_j=1000.0)
    for share in (0.9, 0.8, 0.81, 0.8, 0.79):
        gauge.follow(None, None, None, share)
    assert gauge.drawn_j == pytest.approx(110.0)
    counter = Meter(capacity_j=None)
    for joules in (500.0, 700.0, 30.0, 40.0):
        counter.follow(joules, None, None, None)
    assert counter.drawn_j == pytest.approx(200.0 + 30.0 + 10.0)


def test_nothing_told_is_nothing_known() -> None:
    meter = Meter(capacity_j=None)
    meter.follow(None, None, 12.0, 0.5)
    assert meter.drawn_j is None
