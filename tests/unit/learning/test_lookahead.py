"""Predictions ahead of the track: the forecast against the model's own, and what they tell that the stream does not."""

import math
import pickle

import numpy as np
import pytest

from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.lookahead import Lookahead
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static, TemporalKernel


def model_under(*times: TemporalKernel) -> FieldModel:
    parts = [Component(1.0 + i, Matern32((100.0 - 20 * i,) * 2), time) for i, time in enumerate(times)]
    gp = SparseOnlineGP(Kernel(tuple(parts), 0.01), 30, prior_mean=3.0)
    for point in np.random.default_rng(2).uniform(0, 400, (120, 2)):
        gp.advance(2.0)
        gp.update(point, 3.0 + math.sin(point[0] / 60))
    return gp.model()


@pytest.mark.parametrize(
    "times",
    [(Static(),), (OrnsteinUhlenbeck(200.0),), (MaternMotion(150.0),), (Static(), MaternMotion(90.0))],
    ids=repr,
)
@pytest.mark.parametrize("dt_s", [0.0, 60.0])
def test_a_residual_is_that_of_the_advanced_model(times: tuple[TemporalKernel, ...], dt_s: float) -> None:
    model = model_under(*times)
    later = np.array([230.0, 140.0])
    looking = Lookahead(100.0)
    looking.look(np.array([130.0, 100.0]), 0.0, 50.0, lambda: model)
    looking.look(later, 4.2, 50.0 + dt_s, lambda: model)
    expected = model.advanced(dt_s).predict(later[None])
    spread = expected.variance[0] + 0.01
    figures = looking.figures
    assert figures.count == 1
    assert figures.mean_square == pytest.approx((4.2 - expected.mean[0]) ** 2 / spread, rel=1e-9)
    score = -0.5 * (figures.mean_square + math.log(2 * math.pi * spread))
    assert figures.log_score == pytest.approx(score, rel=1e-9)


def test_the_model_is_asked_for_once_in_a_distance() -> None:
    model, asked = model_under(Static()), []

    def believed() -> FieldModel:
        asked.append(1)
        return model

    looking = Lookahead(50.0)
    for metres in range(0, 401, 4):
        looking.look(np.array([float(metres), 0.0]), 3.0, float(metres), believed)
    # Put aside at 0, 52, 104, … 364: the first reading 50 m away is 52 m away.
    assert len(asked) == 8
    assert looking.figures.count == 7


def test_before_anything_is_known_the_prior_is_tested() -> None:
    prior = FieldModel.prior(Kernel((Component(4.0, SquaredExponential((10.0, 10.0))),), 0.5), 1.0)
    looking = Lookahead(5.0)
    looking.look(np.zeros(2), 1.0, 0.0, lambda: prior)
    looking.look(np.array([6.0, 0.0]), 4.0, 1.0, lambda: prior)
    assert looking.figures.mean_square == pytest.approx(9.0 / 4.5)


def wavy(seed: int, length_m: float) -> "tuple[np.ndarray, np.ndarray]":
    """Random Fourier features of a squared-exponential field of unit variance."""
    rng = np.random.default_rng(seed)
    return rng.normal(0, 1 / length_m, (300, 2)), rng.uniform(0, 2 * np.pi, 300)


def survey(signal_variance: float) -> tuple[float, float, float]:
    """Mean z² one step ahead, ahead of the track, and over the map, for a model that believes `signal_variance`."""
    near, ahead, over = [], [], []
    for seed in range(3):
        frequencies, phases = wavy(seed, 1250.0)

        def truth(points: np.ndarray, f: np.ndarray = frequencies, b: np.ndarray = phases) -> np.ndarray:
            values: np.ndarray = np.sqrt(2 / 300) * np.cos(points @ f.T + b).sum(axis=1)
            return values

        rng = np.random.default_rng(seed + 50)
        lanes = np.linspace(500, 9500, 7)
        east = np.arange(0.0, 10_000.0, 60.0)
        track = np.vstack([np.c_[east[:: (-1) ** i], np.full(len(east), y)] for i, y in enumerate(lanes)])
        kernel = Kernel((Component(signal_variance, SquaredExponential((1250.0, 1250.0))),), 0.01)
        gp, looking = SparseOnlineGP(kernel, 100), Lookahead(250.0, 1000)
        for point, value in zip(track, truth(track) + 0.1 * rng.normal(size=len(track)), strict=True):
            looking.look(point, float(value), 0.0, gp.model)
            gp.update(point, float(value))
            residual = gp.residual
            assert residual is not None
            near.append(residual.innovation**2 / residual.variance)
        ahead.append(looking.figures.mean_square)
        places = rng.uniform(0, 10_000, (500, 2))
        told = gp.predict(places)
        held_out = truth(places) + 0.1 * rng.normal(size=500)
        over.append(np.mean((held_out - told.mean) ** 2 / (told.variance + 0.01)))
    return float(np.mean(near)), float(np.mean(ahead)), float(np.mean(over))


def test_ahead_of_the_track_an_overconfident_map_shows_where_the_stream_is_blind() -> None:
    near, ahead, over = survey(0.3)
    print(f"believed variance .3 of the true one: near {near:.2f}, ahead {ahead:.2f}, map {over:.2f}")
    assert near < 1.2
    assert ahead > 1.3
    assert over > 1.2


def test_under_the_true_kernel_all_three_are_right() -> None:
    near, ahead, over = survey(1.0)
    print(f"the true variance: near {near:.2f}, ahead {ahead:.2f}, map {over:.2f}")
    assert near == pytest.approx(1.0, abs=0.12)
    # About 3 × 260 residuals, whose squares have a variance of 2, and a basis that is bounded.
    assert ahead == pytest.approx(1.0, abs=0.3)
    assert over == pytest.approx(1.0, abs=0.3)


def test_after_a_restart_the_old_model_is_not_asked_again() -> None:
    looking = Lookahead(10.0)
    old, new = model_under(Static()), model_under(OrnsteinUhlenbeck(200.0))
    for place in (0.0, 20.0):
        looking.look(np.array([place, 0.0]), 3.0, 0.0, lambda: old)
    looking.restart()
    looking.look(np.array([40.0, 0.0]), 3.0, 0.0, lambda: new)
    assert looking.figures.count == 0
    looking.look(np.array([60.0, 0.0]), 3.0, 0.0, lambda: new)
    there = new.predict([[60.0, 0.0]])
    square = (3.0 - there.mean[0]) ** 2 / (there.variance[0] + 0.01)
    assert looking.figures.mean_square == pytest.approx(square)


def test_a_pickled_copy_goes_on_alike() -> None:
    model = model_under(Static())
    looking = Lookahead(100.0)
    looking.look(np.zeros(2), 3.0, 0.0, lambda: model)
    copy = pickle.loads(pickle.dumps(looking))
    for one in (looking, copy):
        one.look(np.array([150.0, 0.0]), 3.3, 9.0, lambda: model)
    assert copy.figures == looking.figures


@pytest.mark.parametrize("distance_m", [0.0, -1.0, math.nan])
def test_a_distance_is_positive(distance_m: float) -> None:
    with pytest.raises(ValueError, match="distance_m must be positive"):
        Lookahead(distance_m)
