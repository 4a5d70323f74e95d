import math

import numpy as np
import pytest

from autonomy.learning.kernel import Hyperparameters, axis_factor, covariance


def test_covariance_is_the_squared_exponential_with_a_lengthscale_per_axis():
    h = Hyperparameters(2.0, 0.1, (10.0, 40.0))
    a, b = np.array([[1.0, 2.0], [5.0, -3.0]]), np.array([[0.0, 0.0], [7.0, 8.0], [1.0, 2.0]])
    K = covariance(a, b, h)
    for i in range(2):
        for j in range(3):
            dx, dy = a[i] - b[j]
            assert K[i, j] == pytest.approx(
                2.0 * math.exp(-0.5 * ((dx / 10) ** 2 + (dy / 40) ** 2)), rel=1e-14
            )


def test_noise_takes_no_part_where_places_coincide():
    h = Hyperparameters(2.0, 0.5, (10.0, 10.0))
    assert covariance(np.ones((1, 2)), np.ones((1, 2)), h)[0, 0] == 2.0


def test_covariance_stays_exact_far_from_the_origin():
    h = Hyperparameters(1.0, 0.1, (10.0, 10.0))
    a, b, far = np.array([[0.0, 0.0]]), np.array([[3.0, 4.0]]), np.array([2.0**17, -(2.0**17)])
    # 2**17 / 10 is not exact in binary: what remains is the rounding of the scaled coordinates.
    assert covariance(a + far, b + far, h) == pytest.approx(covariance(a, b, h), rel=1e-11)


def test_axis_factors_multiply_to_the_kernel_on_a_grid():
    h = Hyperparameters(3.0, 0.1, (10.0, 25.0))
    centres, x, y = np.array([[1.0, 2.0], [30.0, -4.0]]), np.linspace(0, 30, 4), np.linspace(-5, 5, 3)
    grid = np.array([[u, v] for v in y for u in x])
    factors = (
        axis_factor(centres[:, 1], y, 25.0)[:, :, None] * axis_factor(centres[:, 0], x, 10.0)[:, None, :]
    )
    np.testing.assert_allclose(3.0 * factors.reshape(2, -1), covariance(centres, grid, h), rtol=1e-13)


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
