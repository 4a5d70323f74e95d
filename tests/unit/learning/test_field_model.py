import pickle
import tracemalloc

import numpy as np
import pytest

from autonomy.learning.field_model import FieldModel, Prediction
from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck

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


def two_groups(m=300):
    """A still field of a smooth and a rough part and a moving one, at the largest size that is meant."""
    kernel = Kernel(
        (
            Component(1.0, SquaredExponential((400.0, 300.0))),
            Component(0.3, Matern32((150.0, 150.0))),
            Component(0.5, SquaredExponential((200.0, 200.0)), OrnsteinUhlenbeck(1e4)),
        ),
        0.01,
    )
    rng = np.random.default_rng(1)
    gp = SparseOnlineGP(kernel, m, prior_mean=3.0)
    points = rng.uniform(0, 2000, (m, 2))
    gp.start_basis(points, np.zeros(m), np.ones(m))
    gp.absorb(points, 3.0 + rng.normal(size=m), np.full(m, 0.01))
    return gp.model()


def peak_of(work):
    """The most memory in bytes that `work` needs beyond what it returns."""
    tracemalloc.start()
    result = work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    kept = (result.mean, result.variance) if isinstance(result, Prediction) else (result,)
    return peak - sum(array.nbytes for array in kept)


@pytest.mark.parametrize("shape", [(30, 1500), (1500, 30), (3, 15_000), (700, 900)])
def test_a_map_takes_no_more_than_32_megabytes_beside_itself(shape):
    model = two_groups()
    y, x = (np.linspace(0, 2000, n) for n in shape)
    if shape[0] * shape[1] < 100_000:
        assert peak_of(lambda: model.predict_grid(x, y)) < 32e6
    assert peak_of(lambda: model.mean_grid(x, y)) < 32e6


def test_many_points_take_no_more_than_32_megabytes():
    model, points = two_groups(), np.random.default_rng(2).uniform(0, 2000, (40_000, 2))
    assert peak_of(lambda: model.predict(points)) < 32e6


def test_the_mean_alone_of_a_separable_field_evaluates_it_along_two_edges_only(model, monkeypatch):
    seen = []
    correlation = SquaredExponential.correlation

    def counting(self, squared):
        seen.append(squared.size)
        return correlation(self, squared)

    x, y = np.linspace(0, 200, 400), np.linspace(0, 200, 300)
    expected = model.predict_grid(x, y).mean
    monkeypatch.setattr(SquaredExponential, "correlation", counting)
    mean = model.mean_grid(x, y)
    assert sum(seen) == len(model) * (400 + 300)
    np.testing.assert_allclose(mean, expected, atol=1e-10)


@pytest.mark.parametrize("shape", [(1, 1), (1, 2500), (1500, 2), (37, 23)])
def test_maps_of_any_shape_and_kernel_are_the_predictions_at_their_cells(shape):
    model = two_groups(30)
    y, x = (np.linspace(-100, 2100, n) for n in shape)
    points = model.predict(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
    grid = model.predict_grid(x, y)
    np.testing.assert_allclose(grid.mean.ravel(), points.mean, atol=1e-9)
    np.testing.assert_allclose(grid.variance.ravel(), points.variance, atol=1e-9)
    np.testing.assert_allclose(model.mean_grid(x, y).ravel(), points.mean, atol=1e-9)


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
    assert (prior.mean_grid([0.0, 1.0], [0.0]) == 33.5).all()
    assert prior.advanced(5.0).predict([[0.0, 0.0]]).variance == 2.0
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
    with pytest.raises(ValueError, match="y_axis"):
        FieldModel.prior(H).mean_grid([0.0], [np.nan])


def test_arrays_that_do_not_fit_together_are_refused():
    with pytest.raises(ValueError, match="one for each group"):
        FieldModel(H.kernel, 0.0, 1e-8, np.zeros((2, 2)), (), np.zeros(2), np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"factors\[0\]"):
        FieldModel(H.kernel, 0.0, 1e-8, np.zeros((2, 2)), (np.zeros((3, 3)),), np.zeros(2), np.zeros((2, 2)))
