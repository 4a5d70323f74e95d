import math

import numpy as np
import pytest

from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.spatial import SPATIAL, Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static


def test_covariance_is_the_squared_exponential_with_a_lengthscale_per_axis():
    h = Hyperparameters(2.0, 0.1, (10.0, 40.0))
    a, b = np.array([[1.0, 2.0], [5.0, -3.0]]), np.array([[0.0, 0.0], [7.0, 8.0], [1.0, 2.0]])
    K = h.kernel.covariance(a, b)
    for i in range(2):
        for j in range(3):
            dx, dy = a[i] - b[j]
            assert K[i, j] == pytest.approx(
                2.0 * math.exp(-0.5 * ((dx / 10) ** 2 + (dy / 40) ** 2)), rel=1e-14
            )


def test_noise_takes_no_part_where_places_coincide():
    h = Hyperparameters(2.0, 0.5, (10.0, 10.0))
    assert h.kernel.covariance(np.ones((1, 2)), np.ones((1, 2)))[0, 0] == 2.0


def test_covariance_stays_exact_far_from_the_origin():
    h = Hyperparameters(1.0, 0.1, (10.0, 10.0))
    a, b, far = np.array([[0.0, 0.0]]), np.array([[3.0, 4.0]]), np.array([2.0**17, -(2.0**17)])
    # 2**17 / 10 is not exact in binary: what remains is the rounding of the scaled coordinates.
    assert h.kernel.covariance(a + far, b + far) == pytest.approx(h.kernel.covariance(a, b), rel=1e-11)


@pytest.mark.parametrize("scales", [[5, 6], (5.0, 6.0), np.array([5.0, 6.0])])
def test_any_sequence_of_lengthscales_becomes_a_tuple_of_floats(scales):
    h = Hyperparameters(1, 1, scales)
    assert h.lengthscales_m == (5.0, 6.0)
    assert all(type(value) is float for value in (*h.lengthscales_m, h.signal_variance, h.noise_variance))
    assert hash(h) == hash(Hyperparameters(1.0, 1.0, (5.0, 6.0)))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((0.0, 1.0, (1.0,)), "signal_variance"),
        ((1.0, -1.0, (1.0,)), "noise_variance"),
        ((1.0, math.nan, (1.0,)), "noise_variance"),
        ((1.0, 1.0, (1.0, math.inf)), r"lengthscales_m\[1\]"),
        ((1.0, 1.0, ()), "empty"),
        ((1.0, 1.0, 500.0), "must be a sequence"),
        ((1.0, 1.0, "12"), "must be a sequence"),
        ((1.0, 1.0, ("a",)), "must be a number"),
        ((1.0, 1.0, (1.0,), 0.0), "timescale_s"),
        ((1.0, 1.0, (1.0,), math.nan), "timescale_s"),
    ],
)
def test_impossible_hyperparameters_are_refused(arguments, complaint):
    with pytest.raises(ValueError, match=complaint):
        Hyperparameters(*arguments)


A, B = np.array([[1.0, 2.0], [5.0, -3.0]]), np.array([[0.0, 0.0], [7.0, 8.0], [1.0, 2.0]])
LONG = Component(2.0, SquaredExponential((10.0, 40.0)))
SHORT = Component(0.5, Matern32((5.0, 6.0)))
MOVING = Component(0.25, SquaredExponential((7.0, 7.0)), OrnsteinUhlenbeck(60.0))


def test_the_matern_kernel_is_the_textbook_one():
    K = SHORT.covariance(A, B)
    for i in range(2):
        for j in range(3):
            dx, dy = A[i] - B[j]
            u = math.sqrt(3.0 * ((dx / 5.0) ** 2 + (dy / 6.0) ** 2))
            assert K[i, j] == pytest.approx(0.5 * (1.0 + u) * math.exp(-u), rel=1e-13)


@pytest.mark.parametrize("kind", SPATIAL.values(), ids=SPATIAL)
def test_a_slope_is_the_derivative_in_a_lengthscale(kind):
    squared, step = np.array([0.0, 0.3, 2.0, 9.0]), 1e-6
    # Of one axis alone, so that s = (d/l)²: dg/dlog l by central differences.
    there, back = (kind((1.0,)).correlation(squared * math.exp(-2.0 * h)) for h in (step, -step))
    np.testing.assert_allclose(kind((1.0,)).slope(squared) * squared, (there - back) / (2 * step), atol=1e-8)
    assert kind((1.0,)).correlation(np.zeros(1))[0] == 1.0


@pytest.mark.parametrize("kind", SPATIAL.values(), ids=SPATIAL)
def test_what_calls_itself_separable_is(kind):
    kernel, east, north = kind((1.0, 1.0)), np.array([0.1, 2.0]), np.array([0.7, 0.3])
    product = kernel.correlation(east.copy()) * kernel.correlation(north.copy())
    assert np.allclose(kernel.correlation(east + north), product) == kernel.separable


@pytest.mark.parametrize("time", [Static(), OrnsteinUhlenbeck(30.0), MaternMotion(30.0)])
def test_a_temporal_kernel_is_the_first_coordinate_of_its_own_linear_system(time):
    for dt in (0.0, 0.7, 25.0, 400.0):
        step = time.transition(dt)
        assert step.shape == (time.states, time.states)
        assert step[0, 0] == pytest.approx(time.correlation(np.array([dt]))[0], rel=1e-13)
        # A step may be taken in two, and never adds negative noise.
        np.testing.assert_allclose(time.transition(0.6 * dt) @ time.transition(0.4 * dt), step, atol=1e-14)
        assert np.linalg.eigvalsh(np.eye(time.states) - step @ step.T)[0] > -1e-15


@pytest.mark.parametrize("kind", [OrnsteinUhlenbeck, MaternMotion])
def test_a_temporal_slope_is_the_derivative_in_the_timescale(kind):
    lags, step = np.array([0.0, 1.0, 20.0, 90.0]), 1e-6
    there, back = (kind(30.0 * math.exp(h)).correlation(lags) for h in (step, -step))
    np.testing.assert_allclose(kind(30.0).slope(lags), (there - back) / (2 * step), atol=1e-8)


def test_components_that_move_alike_share_a_group():
    also_moving = Component(0.1, Matern32((3.0, 3.0)), OrnsteinUhlenbeck(60.0))
    kernel = Kernel((MOVING, LONG, SHORT, also_moving), 0.01)
    assert [group.components for group in kernel.groups] == [(MOVING, also_moving), (LONG, SHORT)]
    assert kernel.states == 2
    assert kernel.groups[1].variance == 2.5
    assert kernel.signal_variance == pytest.approx(2.85)
    assert not kernel.is_static
    assert Kernel((LONG, SHORT), 0.01).is_static
    still, moving = LONG.covariance(A, B) + SHORT.covariance(A, B), MOVING.covariance(A, B)
    moving += also_moving.covariance(A, B)
    lags = np.array([[0.0, 30.0, 60.0], [5.0, 0.0, 1e9]])
    np.testing.assert_allclose(kernel.covariance(A, B), still + moving, rtol=1e-14)
    np.testing.assert_allclose(
        kernel.covariance(A, B, lags), still + moving * np.exp(-lags / 60.0), rtol=1e-14
    )


def test_hyperparameters_are_the_case_of_one_component():
    for h in (Hyperparameters(2.0, 0.1, (3.0, 4.0)), Hyperparameters(2.0, 0.1, (3.0, 4.0), 60.0)):
        assert h.kernel.hyperparameters == h
    for components in ((LONG, MOVING), (SHORT,), (Component(1.0, LONG.space, MaternMotion(9.0)),)):
        with pytest.raises(ValueError, match="only one squared-exponential"):
            _ = Kernel(components, 0.1).hyperparameters


def test_impossible_kernels_are_refused():
    with pytest.raises(ValueError, match="at least one component"):
        Kernel((), 0.1)
    with pytest.raises(ValueError, match="same number of axes"):
        Kernel((LONG, Component(1.0, Matern32((1.0,)))), 0.1)
    with pytest.raises(ValueError, match="noise_variance"):
        Kernel((LONG,), 0.0)
    with pytest.raises(ValueError, match="variance"):
        Component(math.inf, LONG.space)
