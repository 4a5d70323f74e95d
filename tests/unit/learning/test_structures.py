import math
import pickle

import numpy as np
import pytest

from autonomy.learning.likelihood import Readings, log_parameters
from autonomy.learning.structures import STRUCTURES, Scales

SCALES = Scales(span_m=1000.0, variance=2.0, elapsed_s=5000.0)
ALL = pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)


def somewhere(structure, seed=0):
    priors = structure.priors(SCALES)
    return priors.median + 0.5 * priors.deviation * np.random.default_rng(seed).normal(size=structure.size)


@ALL
def test_parameters_and_kernel_are_each_other_s_inverse(structure):
    theta = somewhere(structure)
    np.testing.assert_allclose(structure.parameters(structure.kernel(theta)), theta, rtol=1e-12, atol=1e-12)
    assert pickle.loads(pickle.dumps(structure)) == structure


@ALL
def test_chained_gradients_are_those_of_finite_differences(structure):
    rng = np.random.default_rng(1)
    x, t = rng.uniform(0, 1000, (40, 2)), rng.uniform(0, 5000, 40)
    readings = Readings.of(x, rng.normal(size=40), rng.uniform(0.1, 1, 40), t, "gls")
    theta = somewhere(structure)
    gradient = structure.chain(theta, readings.marginal(structure.kernel(theta))[1])
    step = 1e-4
    for i in range(structure.size):
        shift = np.eye(structure.size)[i] * step
        values = [readings.marginal(structure.kernel(theta + k * shift))[0] for k in (-2, -1, 1, 2)]
        numeric = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
        assert gradient[i] == pytest.approx(numeric, rel=1e-6, abs=1e-6 * np.abs(gradient).max())


@ALL
def test_medians_lie_within_bounds_and_scale_with_survey_and_data(structure):
    priors, bounds = structure.priors(SCALES), structure.bounds(SCALES)
    assert (bounds[:, 0] < priors.median).all()
    assert (priors.median < bounds[:, 1]).all()
    kernel = structure.median(SCALES)
    assert kernel.signal_variance == pytest.approx(2.0)
    assert kernel.noise_variance == pytest.approx(0.02)
    assert kernel.components[0].space.lengthscales_m == pytest.approx((1000 * structure.spans,) * 2)
    larger = structure.median(Scales(2000.0, 8.0, 10_000.0))
    moving = sum(part.moves for part in structure.parts)
    expected = [f for part in structure.parts for f in [4.0, 2.0, 2.0] + [2.0] * part.moves]
    factors = np.exp(log_parameters(larger) - log_parameters(kernel))
    np.testing.assert_allclose(factors, [*expected, 4.0])
    assert kernel.is_static == (moving == 0)


@ALL
def test_prior_densities_are_zero_at_the_median_with_their_gradient(structure):
    priors = structure.priors(SCALES)
    assert priors.log_density(priors.median)[0] == 0.0
    theta = somewhere(structure)
    value, gradient = priors.log_density(theta)
    assert value < 0
    step = 1e-6
    for i in range(structure.size):
        shift = np.eye(structure.size)[i] * step
        numeric = (priors.log_density(theta + shift)[0] - priors.log_density(theta - shift)[0]) / (2 * step)
        assert gradient[i] == pytest.approx(numeric, rel=1e-6, abs=1e-8)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="span_m"):
        Scales(0.0, 1.0)
    with pytest.raises(ValueError, match="variance"):
        Scales(1.0, math.nan)
    with pytest.raises(ValueError, match="elapsed_s"):
        Scales(1.0, 1.0, -1.0)
    with pytest.raises(ValueError, match="elapsed_s"):
        STRUCTURES["ou"].priors(Scales(1.0, 1.0))
    with pytest.raises(ValueError, match="components"):
        STRUCTURES["long_short"].parameters(STRUCTURES["ou"].median(SCALES))
