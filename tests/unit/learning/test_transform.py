"""Transforms against Monte Carlo and adaptive quadrature, and predictions through them."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from autonomy.config import SensorSection
from autonomy.learning.prediction import Prediction
from autonomy.learning.transform import TRANSFORMS, Identity, Log, Logit, Transform, transform_of

EVERY: list[Transform] = [Identity(), Log(), Log(0.5), Logit(0.0, 40.0), Logit(-3.0, 1.5)]
CASES = [(-1.0, 0.3), (0.0, 1.0), (2.5, 0.05), (4.0, 1.4)]


@pytest.mark.parametrize("transform", EVERY, ids=repr)
@given(latent=st.floats(-8, 8))
def test_there_and_back(transform: Transform, latent: float) -> None:
    value = float(transform.inverse(latent))
    assert transform.refusal(value) is None
    # Near an end of its range a value has few digits left to say where it is.
    assert float(transform.forward(value)) == pytest.approx(latent, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("transform", EVERY, ids=repr)
@given(low=st.floats(-8, 8), step=st.floats(1e-3, 5))
def test_every_transform_increases_and_its_slope_is_a_derivative(
    transform: Transform, low: float, step: float
) -> None:
    assert float(transform.inverse(low + step)) > float(transform.inverse(low))
    h = 1e-4
    # d inverse / d latent is one over the slope; central differences are right to h².
    rate = (float(transform.inverse(low + h)) - float(transform.inverse(low - h))) / (2 * h)
    assert -math.log(rate) == pytest.approx(transform.log_slope(low), abs=1e-6)


@pytest.mark.parametrize("transform", EVERY, ids=repr)
@pytest.mark.parametrize(("mean", "deviation"), CASES)
def test_moments_are_those_of_quadrature(transform: Transform, mean: float, deviation: float) -> None:
    def expectation(power: int, about: float) -> float:
        def integrand(z: float) -> float:
            value = float(transform.inverse(mean + deviation * z))
            return (value - about) ** power * math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)

        return float(quad(integrand, -14, 14, epsabs=1e-12, epsrel=1e-11, limit=200)[0])

    first, second = transform.moments(np.array([mean]), np.array([deviation**2]))
    centre = expectation(1, 0.0)
    # The stated precision of the quadrature, of a range of at most 40.
    assert first[0] == pytest.approx(centre, rel=1e-7, abs=4e-5)
    assert second[0] == pytest.approx(expectation(2, centre), rel=1e-6, abs=4e-4)


@pytest.mark.parametrize("transform", EVERY, ids=repr)
@pytest.mark.parametrize(("mean", "deviation"), CASES)
def test_moments_and_intervals_are_those_of_monte_carlo(
    transform: Transform, mean: float, deviation: float
) -> None:
    draws = np.asarray(transform.inverse(np.random.default_rng(9).normal(mean, deviation, 400_000)))
    prediction = Prediction(np.array([mean]), np.array([deviation**2]), transform)
    spread = draws.std()
    assert prediction.mean[0] == pytest.approx(draws.mean(), abs=5 * spread / math.sqrt(len(draws)))
    # The fourth moment of a log-normal is large: its sample variance is known to a few per cent only.
    assert prediction.variance[0] == pytest.approx(spread**2, rel=0.15)
    assert np.mean(draws <= prediction.median[0]) == pytest.approx(0.5, abs=2.5 / math.sqrt(len(draws)))
    for level in (0.5, 0.95):
        lower, upper = prediction.interval(level)
        inside = np.mean((lower[0] <= draws) & (draws <= upper[0]))
        assert inside == pytest.approx(level, abs=5 * math.sqrt(level * (1 - level) / len(draws)))


def test_without_a_transform_the_interval_is_the_gaussian_one() -> None:
    mean, variance = np.array([[1.0, -2.0], [0.0, 33.5]]), np.array([[0.04, 1.0], [9.0, 0.0]])
    prediction = Prediction(mean, variance)
    assert prediction.mean is mean
    assert prediction.variance is variance
    lower, upper = prediction.interval(0.9)
    half = norm.ppf(0.95) * np.sqrt(variance)
    np.testing.assert_allclose(lower, mean - half, atol=1e-14)
    np.testing.assert_allclose(upper, mean + half, atol=1e-14)


def test_a_variance_a_rounding_below_nothing_is_nothing() -> None:
    for transform in EVERY:
        prediction = Prediction(np.array([0.5]), np.array([-1e-9]), transform)
        lower, upper = prediction.interval()
        assert lower == upper == prediction.median
        assert np.isfinite(prediction.mean).all()


@pytest.mark.parametrize("level", [0.0, 1.0, -0.5, 1.5, math.nan])
def test_a_level_is_a_probability(level: float) -> None:
    with pytest.raises(ValueError, match="level must lie between 0 and 1"):
        Prediction(np.zeros(1), np.ones(1)).interval(level)


@pytest.mark.parametrize(
    ("transform", "value", "says"),
    [
        (Identity(), math.nan, "must be finite"),
        (Log(), 0.0, "above 0"),
        (Log(), -1.0, "above 0"),
        (Log(), math.inf, "above 0"),
        (Log(0.5), -0.5, "above -0.5"),
        (Logit(0.0, 40.0), 0.0, "between 0 and 40"),
        (Logit(0.0, 40.0), 40.0, "between 0 and 40"),
        (Logit(0.0, 40.0), math.nan, "between 0 and 40"),
    ],
)
def test_values_outside_the_domain_are_refused_with_the_reason(
    transform: Transform, value: float, says: str
) -> None:
    reason = transform.refusal(value)
    assert reason is not None
    assert says in reason
    with pytest.raises(ValueError, match=says):
        transform.forward([1.0, value])


@pytest.mark.parametrize(
    "ends", [(1.0, 1.0), (2.0, 1.0), (math.nan, 1.0), (0.0, math.inf), (-1e308, 1.7e308)]
)
def test_ends_that_enclose_nothing_are_refused(ends: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="must be"):
        Logit(*ends)


def test_far_out_nothing_overflows_into_a_warning() -> None:
    far = np.array([-1e4, 1e4])
    for transform in EVERY:
        prediction = Prediction(far, np.array([1e4, 1e4]), transform)
        assert prediction.mean.shape == prediction.variance.shape == prediction.interval()[0].shape == (2,)
        assert not np.isnan(prediction.mean).any()


def test_transforms_are_values_by_name() -> None:
    assert set(TRANSFORMS) == {"none", "log", "logit"}
    for transform in EVERY:
        assert type(transform) is TRANSFORMS[transform.name]
        assert pickle.loads(pickle.dumps(transform)) == transform


def test_the_configuration_chooses() -> None:
    assert transform_of(SensorSection()) == Identity()
    assert transform_of(SensorSection(transform="log", transform_offset=0.01)) == Log(0.01)
    plume = SensorSection(transform="logit", transform_bounds=(0.0, 40.0))
    assert transform_of(plume) == Logit(0.0, 40.0)
