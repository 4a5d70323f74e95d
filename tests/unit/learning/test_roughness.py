"""The map of local variability: what it sees along tracks of known roughness, and what bounds it."""

import pickle

import numpy as np
import pytest

from autonomy.learning.roughness import Roughness, RoughnessReadings, local_roughness

SIDE_M = 1e4


def sailed(roughness, value, track=None, noise=0.0, seed=0, spacing_m=0.02 * SIDE_M):
    """Lanes over the square, unless a track is given."""
    rng = np.random.default_rng(seed)
    if track is None:
        along = np.arange(0.5 * spacing_m, SIDE_M, spacing_m)
        lanes = np.linspace(500.0, SIDE_M - 500.0, 10)
        track = np.vstack(
            [
                np.column_stack([along[:: 1 if k % 2 else -1], np.full(len(along), y)])
                for k, y in enumerate(lanes)
            ]
        )
    for k, point in enumerate(track):
        roughness.add(point, float(value(point)) + noise * rng.normal(), float(k))
    return roughness


def mapped(readings, points_m, shore=None, noise_variance=0.0):
    shore = np.ones(len(points_m)) if shore is None else shore
    known = np.ones(0 if readings is None else len(readings))
    return local_roughness(readings, noise_variance, known, points_m, shore, SIDE_M)


def test_a_linear_field_is_smooth_and_a_wavy_one_is_not():
    # Second differences of a plane are 0, whatever its slope.
    plane = sailed(Roughness(SIDE_M, 10 * SIDE_M), lambda p: 3.0 + 0.01 * p[0] - 0.02 * p[1]).frozen()
    assert plane.squares.max() < 1e-18
    wave = sailed(Roughness(SIDE_M, 10 * SIDE_M), lambda p: np.sin(p[0] / 300.0)).frozen()
    # Of sin(x/a) at lag h: mean square (1 − cos(h/a))² / 2.
    lag_m = Roughness(SIDE_M, 10 * SIDE_M).lag_m
    assert wave.squares.mean() == pytest.approx(0.5 * (1.0 - np.cos(lag_m / 300.0)) ** 2, rel=0.1)


def test_the_rough_half_of_the_sea_is_found():
    def value(p):
        return (5.0 if p[0] > SIDE_M / 2 else 0.5) * np.sin(p[0] / 250.0) * np.cos(p[1] / 250.0)

    readings = sailed(Roughness(SIDE_M, 10 * SIDE_M), value, noise=0.02).frozen()
    points = np.array([[2000.0, 5000.0], [8000.0, 5000.0]])
    mean, variance = mapped(readings, points, noise_variance=0.02**2)
    # The variance is a hundred times larger there.
    assert mean[1] - mean[0] == pytest.approx(np.log(100.0), abs=1.5)
    assert variance.max() < 0.5


def test_noise_is_no_roughness():
    # Of white noise alone the squares are 1.5 σ², which is taken away down to a floor.
    readings = sailed(Roughness(SIDE_M, 10 * SIDE_M), lambda p: 0.0, noise=1.0).frozen()
    mean_square = np.average(readings.squares, weights=readings.freedom)
    assert mean_square == pytest.approx(1.5, rel=0.25)
    np.testing.assert_allclose(readings.noise_shares, 1.5)
    told, _ = mapped(readings, readings.points_m, noise_variance=1.0)
    untold, _ = mapped(readings, readings.points_m, noise_variance=0.0)
    assert np.median(told) < np.median(untold) - 0.5


def test_dense_readings_are_averaged_before_they_are_compared():
    # Ten readings a stretch: the noise that is left in their mean is a tenth.
    dense = sailed(
        Roughness(SIDE_M, 10 * SIDE_M), lambda p: 0.0, noise=1.0, spacing_m=0.002 * SIDE_M
    ).frozen()
    np.testing.assert_allclose(dense.noise_shares, 0.15, rtol=0.2)
    assert dense.squares.mean() == pytest.approx(0.15, rel=0.3)


def test_turns_gaps_and_pauses_are_skipped():
    def steps(heading, n, start):
        way = 0.02 * SIDE_M * np.array([np.cos(heading), np.sin(heading)])
        return start + np.arange(1, n + 1)[:, None] * way

    lag = Roughness(SIDE_M, 20 * SIDE_M)
    k = round(lag.lag_m / (0.02 * SIDE_M))
    east = steps(0.0, 2 * k, np.array([0.0, 0.0]))
    # Not one straight triple: sharp turns after every two lags less a step.
    turned = np.vstack([east, steps(np.pi / 2, 2 * k, east[-1])])
    straight = sailed(
        Roughness(SIDE_M, 20 * SIDE_M), lambda p: 1.0, np.vstack([east, steps(0.0, 4, east[-1])])
    )
    assert len(straight) > 0
    counted = sailed(Roughness(SIDE_M, 20 * SIDE_M), lambda p: float(p[1] > 0), turned)
    assert counted.frozen().squares.max(initial=0.0) == 0.0
    apart = np.vstack([east[: 2 * k], east[: 2 * k] + np.array([5000.0, 0.0])])
    assert len(sailed(Roughness(SIDE_M, 20 * SIDE_M), lambda p: 1.0, apart)) == 0
    paused = Roughness(SIDE_M, 20 * SIDE_M)
    for number, point in enumerate(np.vstack([east, steps(0.0, 1, east[-1])])):
        paused.add(point, 1.0, 1e4 * number)
    assert len(paused) == 0


def test_memory_is_bounded_and_what_was_collected_survives_pickling():
    roughness = sailed(Roughness(SIDE_M, 10 * SIDE_M, maximum_cells=20), lambda p: np.sin(p[0] / 300.0))
    assert len(roughness) == 20
    again = pickle.loads(pickle.dumps(roughness))
    track = np.column_stack([np.arange(0.0, 3000.0, 100.0), np.full(30, 200.0)])
    one, two = (sailed(r, lambda p: p[0] ** 2, track).frozen() for r in (roughness, again))
    assert one.squares.tobytes() == two.squares.tobytes()
    assert one.points_m.tobytes() == two.points_m.tobytes()


def test_with_nothing_learnt_the_shore_is_where_to_look():
    points = np.zeros((3, 2))
    shore = np.array([0.0, 0.1, 1.0])
    mean, variance = mapped(None, points, shore)
    np.testing.assert_allclose(mean, -0.6 * np.log(shore + 0.03))
    np.testing.assert_allclose(variance, 1.0 + 0.4**2 * np.log(shore + 0.03) ** 2)


def test_the_regression_is_the_exact_posterior_of_its_prior():
    # Against sampling-free algebra of the joint Gaussian: level and slope as two extra variables.
    rng = np.random.default_rng(0)
    places, shore = rng.random((15, 2)), rng.random(15)
    points, shore_at = rng.random((4, 2)), rng.random(4)
    freedom, squares = np.full(15, 4.0), rng.gamma(2.0, 1.0, 15)
    readings = RoughnessReadings(places * SIDE_M, squares, np.full(15, 1.5), freedom, SIDE_M, 400.0)
    mean, variance = local_roughness(readings, 0.0, shore, points * SIDE_M, shore_at, SIDE_M)
    everywhere = np.vstack([places, points])
    distance = np.linalg.norm(everywhere[:, None] - everywhere[None], axis=-1)
    H = np.column_stack([np.ones(19), np.log(np.append(shore, shore_at) + 0.03)])
    y = np.log(squares) - (0.42278433509846714 - np.log(2.0))  # ψ(2) − log 2
    b = np.array([np.mean(y + 0.6 * H[:15, 1]), -0.6])
    joint = np.exp(-distance / 0.2) + H @ np.diag([100.0, 0.16]) @ H.T
    noisy = joint[:15, :15] + np.diag(np.full(15, np.pi**2 / 6 - 1.0))  # ψ′(2)
    gain = joint[15:, :15] @ np.linalg.inv(noisy)
    np.testing.assert_allclose(mean, H[15:] @ b + gain @ (y - H[:15] @ b), rtol=1e-8)
    np.testing.assert_allclose(variance, np.diag(joint[15:, 15:] - gain @ joint[:15, 15:]), rtol=1e-8)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Roughness(0.0), "side_m"),
        (lambda: Roughness(1e4, -5.0), "budget_m"),
        (lambda: Roughness(1e4, maximum_cells=0), "maximum_cells"),
        (lambda: Roughness(1e4).add(np.array([0.0, np.nan]), 1.0, 0.0), "finite"),
        (lambda: mapped(None, np.zeros((1, 2)), np.array([-0.1])), "shore"),
    ],
)
def test_what_cannot_be_is_refused(call, said):
    with pytest.raises(ValueError, match=said):
        call()
