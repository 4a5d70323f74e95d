"""What a learner under a transform believes, and how it judges itself: against a learner of transformed readings."""

import math

import numpy as np
import pytest

from autonomy.config import EstimationSection
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import reestimate
from autonomy.learning.transform import Log, Logit, Transform

SPAN = 4000.0
X, Y = np.linspace(0, SPAN, 23), np.linspace(0, SPAN, 17)
CASES: list[Transform] = [Log(0.05), Logit(0.0, 40.0)]


def readings(transform: Transform, number: int = 250) -> tuple[np.ndarray, np.ndarray]:
    """Places along a meander, and sensor values whose image is a smooth Gaussian-looking field with noise."""
    rng = np.random.default_rng(12)
    along = np.linspace(0, 1, number)
    places = np.c_[SPAN * along, SPAN * (0.5 + 0.45 * np.sin(40 * along))]
    latent = np.sin(places[:, 0] / 600) + np.cos(places[:, 1] / 500) + 0.1 * rng.normal(size=number)
    return places, np.asarray(transform.inverse(latent))


def taught(places: np.ndarray, values: np.ndarray, transform: Transform | None = None) -> Learner:
    learner = Learner(SPAN, 60, transform=transform)
    for i, (place, value) in enumerate(zip(places, values.tolist(), strict=True)):
        learner.add(place, value, float(i))
    while learner.catch_up():
        pass
    return learner


@pytest.mark.parametrize("transform", CASES, ids=repr)
def test_a_transform_is_learning_the_images_and_telling_the_originals(transform: Transform) -> None:
    places, values = readings(transform)
    ours = taught(places, values, transform).model()
    theirs = taught(places, np.asarray(transform.forward(values))).model()
    grid, latent = ours.predict_grid(X, Y), theirs.predict_grid(X, Y)
    np.testing.assert_allclose(grid.latent_mean, latent.mean, atol=1e-9)
    np.testing.assert_allclose(grid.latent_variance, latent.variance, atol=1e-9)
    lower, upper = grid.interval(0.8)
    below, above = latent.interval(0.8)
    np.testing.assert_allclose(lower, transform.inverse(below), rtol=1e-9)
    np.testing.assert_allclose(upper, transform.inverse(above), rtol=1e-9)
    assert (lower < grid.median).all()
    assert (grid.median < upper).all()
    np.testing.assert_allclose(ours.mean_grid(X, Y), grid.mean)
    points = np.array([[u, v] for v in Y for u in X])
    np.testing.assert_allclose(ours.predict(points).mean, grid.mean.ravel(), rtol=1e-9)
    # The planner's covariance stays that of the Gaussian.
    np.testing.assert_allclose(ours.covariance(points[:9]), theirs.covariance(points[:9]), atol=1e-12)


@pytest.mark.parametrize("transform", CASES, ids=repr)
def test_the_score_is_per_sensor_unit_and_the_rest_does_not_change(transform: Transform) -> None:
    places, values = readings(transform)
    images = np.asarray(transform.forward(values))
    ours, theirs = taught(places, values, transform), taught(places, images)
    for mine, other in (
        (ours.calibration.figures, theirs.calibration.figures),
        (ours.ahead.figures, theirs.ahead.figures),
    ):
        assert (mine.count, mine.coverage_95) == (other.count, other.coverage_95)
        assert mine.mean_square == pytest.approx(other.mean_square, rel=1e-9)
    slopes = [transform.log_slope(image) for image in images.tolist()]
    expected = theirs.calibration.log_score + float(np.mean(slopes))
    assert ours.calibration.log_score == pytest.approx(expected, abs=1e-9)


def test_values_outside_the_domain_change_nothing() -> None:
    learner = taught(*readings(Log(0.05)), Log(0.05))
    samples, figures = learner.samples, learner.calibration.figures
    with pytest.raises(ValueError, match=r"the logarithm needs values above -0\.05"):
        learner.add((1.0, 2.0), -0.05, 1000.0)
    assert (learner.samples, learner.calibration.figures) == (samples, figures)


def test_skewed_values_are_better_predicted_under_their_logarithm() -> None:
    """Log-normal values: by the prequential score in the sensor's units the logarithm must win, by far."""
    places, values = readings(Log(), 400)
    values = np.asarray(Log().inverse(1.5 * np.log(values)))
    plain, logged = taught(places, values), taught(places, values, Log())
    print(f"log score {plain.calibration.log_score:.2f} plain, {logged.calibration.log_score:.2f} under log")
    assert logged.calibration.log_score > plain.calibration.log_score + 0.3


def test_every_reading_is_judged_once_and_some_from_afar() -> None:
    places, values = readings(Log(), 250)
    learner = taught(places, values, Log())
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert learner.calibration.count == 250
    # One in a fortieth of the span, or in a whole step where that is longer.
    assert 20 <= learner.ahead.figures.count <= steps.sum() / (SPAN / 40)
    assert 0.6 < learner.calibration.coverage_95 <= 1.0


def test_before_birth_the_prior_is_told_in_sensor_units() -> None:
    h = Hyperparameters(0.5, 0.01, (300.0, 300.0))
    model = Learner(SPAN, 60, hyperparameters=h, transform=Log()).model()
    assert isinstance(model, FieldModel)
    assert model.predict([[0.0, 0.0]]).mean[0] == pytest.approx(math.exp(0.25))


def test_a_new_kernel_is_judged_by_what_it_says_itself() -> None:
    places, values = readings(Log(), 250)
    learner = taught(places[:200], values[:200], Log())
    assert learner.calibration.count == 200
    learner.adopt(reestimate(learner.reestimate_request(1, EstimationSection())))
    assert (learner.calibration.count, learner.ahead.figures.count) == (0, 0)
    for i in range(200, 250):
        learner.add(places[i], float(values[i]), float(i))
    assert learner.calibration.count == 50
    assert 0 < learner.ahead.figures.count < 50


def test_what_came_meanwhile_is_learnt_again_but_not_judged_again() -> None:
    places, values = readings(Log(), 70)
    learner = taught(places[:50], values[:50], Log())
    request = learner.reestimate_request(1, EstimationSection(candidates=("squared_exponential",)))
    for i in range(50, 60):
        learner.add(places[i], float(values[i]), float(i))
    learner.adopt(reestimate(request))
    while learner.catch_up():
        pass
    assert learner.calibration.count == 0
    for i in range(60, 70):
        learner.add(places[i], float(values[i]), float(i))
    assert learner.calibration.count == 10
