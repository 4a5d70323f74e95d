import pickle
import tracemalloc

import numpy as np
import pytest

from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP

H = Hyperparameters(2.0, 0.02, (30.0, 50.0))


@pytest.fixture
def model():
    rng = np.random.default_rng(0)
    gp = SparseOnlineGP(H, 40, prior_mean=33.5)
    for point in rng.uniform(0, 200, (300, 2)):
        gp.update(point, 33.5 + np.sin(point[0] / 40) + 0.1 * rng.normal())
    return gp.model()


def test_a_map_is_the_prediction_at_its_cells_with_north_along_the_rows(model):
    x, y = np.linspace(-20, 220, 37), np.linspace(-50, 250, 23)
    grid = model.predict_grid(x, y)
    assert grid.mean.shape == grid.variance.shape == (23, 37)
    points = model.predict(np.array([[u, v] for v in y for u in x]))
    np.testing.assert_allclose(grid.mean.ravel(), points.mean, atol=1e-9)
    np.testing.assert_allclose(grid.variance.ravel(), points.variance, atol=1e-9)


def test_a_map_wider_than_one_chunk_is_still_the_same(model, monkeypatch):
    x, y = np.linspace(0, 200, 301), np.linspace(0, 200, 11)
    whole = model.predict_grid(x, y)
    monkeypatch.setattr("autonomy.learning.field_model._CHUNK_BYTES", 1)
    pieces = model.predict_grid(x, y)
    np.testing.assert_allclose(pieces.mean, whole.mean, atol=1e-12)
    np.testing.assert_allclose(pieces.variance, whole.variance, atol=1e-12)


def test_a_map_takes_no_temporary_over_32_megabytes():
    rng = np.random.default_rng(1)
    gp = SparseOnlineGP(Hyperparameters(1.0, 0.01, (40.0, 40.0)), 100)
    for point in rng.uniform(0, 391, (400, 2)):
        gp.update(point, rng.normal())
    model = gp.model()
    tracemalloc.start()
    model.predict_grid(np.arange(351.0), np.arange(391.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 32e6


def test_the_covariance_has_the_variances_on_its_diagonal_and_is_positive(model):
    points = np.random.default_rng(2).uniform(-50, 250, (60, 2))
    posterior = model.covariance(points)
    np.testing.assert_allclose(np.diag(posterior), model.predict(points).variance, atol=1e-9)
    np.testing.assert_array_equal(posterior, posterior.T)
    assert np.linalg.eigvalsh(posterior)[0] > -1e-9


def test_the_prior_predicts_itself():
    prior = FieldModel.prior(H, 33.5)
    assert len(prior) == 0
    prediction = prior.predict_grid([0.0, 1.0], [0.0, 1.0, 2.0])
    assert (prediction.mean == 33.5).all()
    assert (prediction.variance == 2.0).all()
    assert prior.covariance([[0.0, 0.0], [30.0, 0.0]])[0, 1] == pytest.approx(2 * np.exp(-0.5))


def test_it_travels_by_pickle_without_what_it_can_compute(model):
    before = len(pickle.dumps(model))
    expected = model.predict([[10.0, 20.0]])
    assert len(pickle.dumps(model)) == before
    other = pickle.loads(pickle.dumps(model))
    assert other.predict([[10.0, 20.0]]).mean == expected.mean
    assert not other.basis.flags.writeable


def test_no_points_give_no_predictions(model):
    assert model.predict(np.zeros((0, 2))).mean.shape == (0,)
    assert model.covariance(np.zeros((0, 2))).shape == (0, 0)
    assert model.predict_grid([], [1.0]).mean.shape == (1, 0)


@pytest.mark.parametrize(
    ("points", "complaint"),
    [
        ([0.0, 1.0], "shape"),
        ([[0.0, 1.0, 2.0]], "shape"),
        ([[0.0, np.nan]], "finite"),
        ([["a", 1]], "numbers"),
    ],
)
def test_bad_points_are_refused(model, points, complaint):
    for ask in (model.predict, model.covariance):
        with pytest.raises(ValueError, match=complaint):
            ask(points)


def test_a_map_needs_two_axes():
    with pytest.raises(ValueError, match="two axes"):
        FieldModel.prior(Hyperparameters(1.0, 1.0, (1.0,))).predict_grid([0.0], [0.0])
    with pytest.raises(ValueError, match="x_axis"):
        FieldModel.prior(H).predict_grid([[0.0]], [0.0])


def test_arrays_that_do_not_fit_together_are_refused():
    with pytest.raises(ValueError, match="factor"):
        FieldModel(H.kernel, 0.0, 1e-8, np.zeros((2, 2)), (np.zeros((3, 3)),), np.zeros(2), np.zeros((2, 2)))
