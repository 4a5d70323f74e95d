import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from autonomy.config import EstimationSection
from autonomy.learning.first_guess import FirstGuess
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.learner import Learner
from autonomy.learning.positions import coarsest_step_m, grid_step_m, snapped
from autonomy.learning.rebuild import reestimate
from autonomy.learning.sparse_gp import SparseOnlineGP, Update

SPAN = 1000.0
TRUE = Hyperparameters(1.0, 0.01, (SPAN / 6, SPAN / 6))
OPTIONS = EstimationSection()
SMOOTH = EstimationSection(candidates=("squared_exponential",))


def field(rng, h=TRUE, features=1500):
    """A sample of the Gaussian process, by random Fourier features."""
    frequency = rng.normal(size=(features, 2)) / h.lengthscales_m
    phase, weight = rng.uniform(0, 2 * math.pi, features), rng.normal(size=features)
    amplitude = math.sqrt(2 * h.signal_variance / features)
    return lambda points: 33.5 + amplitude * np.cos(points @ frequency.T + phase) @ weight


def legs(rng, n, step=10.0):
    """A track of straight legs between random waypoints, a reading every `step` metres."""
    points = [np.full(2, SPAN / 2)]
    while len(points) <= n:
        start, goal = points[-1], rng.uniform(0, SPAN, 2)
        length = math.hypot(*(goal - start))
        points += [start + (goal - start) * (i + 1) * step / length for i in range(int(length / step))]
    return np.array(points[1 : n + 1])


def survey(seed, n, noise=0.1):
    rng = np.random.default_rng(seed)
    truth, x = field(rng), snapped(legs(rng, n), grid_step_m(SPAN))
    return truth, x, truth(x) + noise * rng.normal(size=n)


def taught(learner, x, y, start=0):
    for i, (point, value) in enumerate(zip(x, y, strict=True)):
        learner.add(point, value, float(start + i))
    return learner


def grid():
    axis = np.linspace(0, SPAN, 31)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def rmse(mean, truth):
    return math.sqrt(np.mean((mean - truth(grid())) ** 2))


def test_before_birth_it_believes_a_prior_good_enough_for_a_first_plan():
    learner = Learner(SPAN)
    assert not learner.born
    assert [learner.add((i, 0.0), 33.5, float(i)) for i in range(19)] == [None] * 19
    model = learner.model()
    assert len(model) == len(learner.basis) == learner.fresh_count == 0
    assert model.kernel.hyperparameters.signal_variance == pytest.approx(1.0)
    assert model.kernel.hyperparameters.lengthscales_m == pytest.approx((SPAN / 6, SPAN / 6))
    with pytest.raises(RuntimeError, match="19 of 20"):
        _ = learner.gp
    with pytest.raises(RuntimeError, match="not born"):
        learner.reestimate_request(0, OPTIONS)


def test_at_birth_the_first_readings_tell_offset_and_scale_and_are_all_learnt():
    _, x, y = survey(0, 39)
    learner = taught(Learner(SPAN), x, y)
    guess = FirstGuess(SPAN)
    for point, value in zip(x[:20], y[:20], strict=True):
        guess.add(point, value)
    kernel = learner.gp.kernel
    assert kernel == guess.kernel()
    assert learner.gp.prior_mean == pytest.approx(y[:20].mean())
    novelty = kernel.noise_variance / kernel.signal_variance
    by_hand = SparseOnlineGP(kernel, learner.capacity, min(novelty, 1e-3), prior_mean=float(y[:20].mean()))
    for point, value in zip(x, y, strict=True):
        by_hand.update(point, value)
    np.testing.assert_allclose(learner.model().predict(x).mean, by_hand.predict(x).mean, atol=1e-12)
    assert learner.samples == 39
    assert learner.history.cells().counts.sum() == 39


def test_the_first_guess_is_made_anew_when_the_readings_have_doubled_until_a_fit_is_adopted():
    _, x, y = survey(17, 400)
    learner, changes, before = Learner(SPAN), [], None
    for i, (point, value) in enumerate(zip(x, y, strict=True), start=1):
        learner.add(point, value, float(i))
        if i == 200:
            learner.adopt(reestimate(learner.reestimate_request(0, SMOOTH)))
        if learner.born and learner.gp.kernel != before:
            changes.append(i)
            before = learner.gp.kernel
            # Whatever the guess is, rho counts from the last fit, and there was none.
            assert learner.fresh_count == (0 if i == 200 else len(learner.basis))
    assert changes == [20, 40, 80, 160, 200]


def test_given_hyperparameters_apply_to_centred_readings():
    _, x, y = survey(1, 25)
    learner = taught(Learner(SPAN, hyperparameters=TRUE), x, y)
    assert learner.gp.kernel.hyperparameters == TRUE
    assert learner.gp.prior_mean == pytest.approx(y[:20].mean())


def test_without_centring_it_is_born_at_once_and_needs_hyperparameters():
    learner = Learner(SPAN, centring_samples=0, hyperparameters=TRUE)
    assert learner.born
    assert learner.add((0.0, 0.0), 1.0, 0.0) is Update.ADDED
    assert learner.gp.prior_mean == 0.0
    with pytest.raises(ValueError, match="give hyperparameters"):
        Learner(SPAN, centring_samples=0)


def test_it_does_not_care_for_the_sensors_offset_and_unit():
    _, x, y = survey(2, 300)
    plain = taught(Learner(SPAN), x, y)
    scaled = taught(Learner(SPAN), x, 1e-6 * (y + 400))
    for learner in (plain, scaled):
        learner.adopt(reestimate(learner.reestimate_request(0, OPTIONS)))
    one, other = plain.model().predict(grid()), scaled.model().predict(grid())
    np.testing.assert_allclose(other.mean * 1e6 - 400, one.mean, atol=5e-3)
    np.testing.assert_allclose(np.sqrt(other.variance) * 1e6, np.sqrt(one.variance), atol=5e-3)


def test_fresh_basis_vectors_are_those_added_since_the_mark():
    _, x, y = survey(3, 400)
    learner = taught(Learner(SPAN, capacity=30, hyperparameters=TRUE), x[:100], y[:100])
    assert learner.fresh_count == len(learner.basis)
    learner.mark()
    assert learner.fresh_count == learner.replaced_since_mark == 0
    before = learner.basis
    outcomes = [learner.add(p, v, 100.0 + i) for i, (p, v) in enumerate(zip(x[100:], y[100:], strict=True))]
    new = sum(not (before == point).all(axis=1).any() for point in learner.basis)
    assert learner.fresh_count == new > 0
    assert learner.replaced_since_mark == outcomes.count(Update.REPLACED) > 0


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_rebuild_is_nearly_as_good_as_the_exact_process_on_all_readings(factor):
    """2000 readings, 100 basis vectors, from length-scales ten times off; tests/accuracy has ten seas."""
    for seed in range(2):
        truth, x, y = survey(seed, 2000)
        wrong = replace(TRUE, lengthscales_m=(SPAN / 6 * factor,) * 2)
        learner = taught(Learner(SPAN, capacity=100, hyperparameters=wrong), x, y)
        result = reestimate(learner.reestimate_request(seed, OPTIONS))
        learner.adopt(result)
        assert result.points == 600
        rebuilt = rmse(learner.model().predict(grid()).mean, truth)
        assert rebuilt <= 1.10 * rmse(dense_mean(x, y, TRUE, 33.5), truth)


def dense_mean(x, y, h, prior_mean):
    K = h.kernel.covariance(x, x)
    K[np.diag_indices(len(x))] += h.noise_variance
    return prior_mean + h.kernel.covariance(grid(), x) @ np.linalg.solve(K, y - prior_mean)


def test_readings_that_come_during_a_job_are_not_lost():
    _, x, y = survey(5, 500)
    learner = taught(Learner(SPAN), x[:400], y[:400])
    request = pickle.loads(pickle.dumps(learner.reestimate_request(0, OPTIONS)))
    taught(learner, x[400:], y[400:], start=400)
    result = pickle.loads(pickle.dumps(reestimate(request)))
    by_hand = pickle.loads(pickle.dumps(result.gp))
    for point, value in zip(x[400:], y[400:], strict=True):
        by_hand.update(point, value)
    learner.adopt(result)
    caught_up(learner)
    np.testing.assert_allclose(learner.model().predict(x).mean, by_hand.predict(x).mean, atol=1e-12)
    assert learner.samples == 500


class Counted(SparseOnlineGP):
    """Keeps what it was taught, in order."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.taught = []

    def update(self, x, y, noise_variance=None):
        self.taught.append(y)
        return super().update(x, y, noise_variance)


def caught_up(learner):
    """How many slices it took."""
    slices = 0
    while learner.behind:
        slices += 1
        assert learner.catch_up() == (learner.behind > 0)
    return slices


def late_by(n, capacity=300):
    """A learner to which an answer has come after `n` more readings, those readings, and what it learns."""
    _, x, y = survey(5, 100 + n)
    learner = taught(Learner(SPAN, capacity=capacity), x[:100], y[:100])
    result = reestimate(learner.reestimate_request(0, SMOOTH))
    taught(learner, x[100:], y[100:], start=100)
    gp = Counted(result.kernel, capacity, 1e-3, 1e-8, result.prior_mean)
    gp.start_basis(result.gp.basis, result.gp.basis_readings, result.gp.basis_counts)
    learner.adopt(replace(result, gp=gp))
    return learner, x[100:], y[100:], gp


def test_a_late_answer_does_not_make_one_call_learn_all_that_came_meanwhile():
    learner, _, y, gp = late_by(600)
    assert learner.behind == 600
    assert gp.taught == []
    assert learner.fresh_count == 0
    np.testing.assert_array_equal(learner.model().basis, gp.basis)
    learner.catch_up()
    assert 1 <= len(gp.taught) == 600 - learner.behind <= 10
    caught_up(learner)
    assert gp.taught == y.tolist()
    assert learner.behind == 0
    assert not learner.catch_up()


@pytest.mark.parametrize("capacity", [2, 30, 100, 300, 1000])
def test_a_slice_is_shorter_the_larger_the_model(capacity):
    learner = Learner(SPAN, capacity=capacity, centring_samples=1000)
    for i in range(1000):
        learner.add((0.0, float(i)), 33.5, float(i))
    learnt = 1000 - learner.behind
    assert learner.born
    assert learnt >= 1
    # Each costs a few passes over a matrix of capacity², or the fixed price of some calls.
    assert learnt * max(capacity**2, 4000) <= 1e6


def test_readings_that_come_while_others_wait_keep_their_place_in_time():
    learner, _, y, gp = late_by(50)
    _, more_x, more_y = survey(13, 100)
    outcomes = [learner.add(p, v, 150.0 + i) for i, (p, v) in enumerate(zip(more_x, more_y, strict=True))]
    # Two of those that wait are learnt with each reading: it catches up even if nobody asks for it.
    assert [outcome is None for outcome in outcomes] == [True] * 49 + [False] * 51
    assert gp.taught == [*y, *more_y]
    assert learner.behind == 0
    assert learner.samples == 250


def test_how_it_catches_up_makes_no_difference():
    learner, *_ = late_by(120, capacity=30)
    other = pickle.loads(pickle.dumps(learner))
    caught_up(learner)
    _, x, y = survey(14, 200)
    taught(other, x, y, start=300)
    taught(learner, x, y, start=300)
    assert other.behind == learner.behind == 0
    np.testing.assert_array_equal(learner.model().predict(x).mean, other.model().predict(x).mean)


@pytest.mark.parametrize("timescale_s", [math.inf, 100.0])
def test_a_request_made_while_readings_wait_covers_them(timescale_s):
    """Its answer holds all of them, at the time of the last: none is learnt twice, none is lost."""
    h = replace(TRUE, timescale_s=timescale_s)
    _, x, y = survey(15, 400)
    prompt, late = (Learner(SPAN, hyperparameters=h) for _ in range(2))
    for learner in (prompt, late):
        taught(learner, x[:100], y[:100])
        result = reestimate(learner.reestimate_request(0, OPTIONS))
        taught(learner, x[100:300], y[100:300], start=100)
        learner.adopt(result)
    caught_up(prompt)
    results = [reestimate(learner.reestimate_request(1, OPTIONS)) for learner in (prompt, late)]
    assert late.behind == 200
    for learner, result in zip((prompt, late), results, strict=True):
        taught(learner, x[300:], y[300:], start=300)
        learner.adopt(result)
        assert learner.behind == 100
        caught_up(learner)
    one, two = (learner.model().predict(grid()) for learner in (prompt, late))
    np.testing.assert_array_equal(one.mean, two.mean)
    np.testing.assert_array_equal(one.variance, two.variance)


def test_a_withdrawn_request_leaves_those_that_wait():
    learner, _, y, gp = late_by(50)
    learner.reestimate_request(1, OPTIONS)
    learner.withdraw_request()
    caught_up(learner)
    assert gp.taught == y.tolist()


def test_birth_from_many_readings_is_spread_over_slices():
    _, x, y = survey(16, 520)
    learner = Learner(SPAN, capacity=300, centring_samples=500)
    taught(learner, x[:500], y[:500])
    assert learner.born
    assert learner.behind >= 480
    taught(learner, x[500:], y[500:], start=500)
    caught_up(learner)
    kernel = learner.gp.kernel
    novelty = min(kernel.noise_variance / kernel.signal_variance, 1e-3)
    by_hand = SparseOnlineGP(kernel, 300, novelty, prior_mean=float(y[:500].mean()))
    for point, value in zip(x, y, strict=True):
        by_hand.update(point, value)
    np.testing.assert_allclose(learner.model().predict(x).mean, by_hand.predict(x).mean, atol=1e-12)


def test_a_re_estimate_is_a_function_of_its_request():
    _, x, y = survey(6, 600)
    request = taught(Learner(SPAN), x, y).reestimate_request(3, EstimationSection(maximum_points=50))
    one, two = reestimate(request), reestimate(request)
    assert one.kernel == two.kernel
    assert one.points == 100
    assert reestimate(replace(request, seed=4)).kernel != one.kernel


def test_only_the_answer_to_the_open_request_is_adopted():
    _, x, y = survey(7, 300)
    learner = taught(Learner(SPAN), x[:100], y[:100])
    stale = reestimate(learner.reestimate_request(0, OPTIONS))
    taught(learner, x[100:], y[100:], start=100)
    learner.reestimate_request(0, OPTIONS)
    with pytest.raises(ValueError, match="at 100 samples does not answer"):
        learner.adopt(stale)
    learner.withdraw_request()
    with pytest.raises(ValueError, match="no request is open"):
        learner.adopt(stale)


@pytest.mark.parametrize("data", ["history", "basis"])
@pytest.mark.parametrize("optimiser", ["lbfgs", "gradient_ascent"])
@pytest.mark.parametrize("objective", ["loo", "marginal"])
def test_every_way_to_estimate_improves_a_bad_start(objective, optimiser, data):
    truth, x, y = survey(8, 800)
    wrong = replace(TRUE, lengthscales_m=(SPAN / 30,) * 2)
    learner = taught(Learner(SPAN, capacity=100, hyperparameters=wrong), x, y)
    before = rmse(learner.model().predict(grid()).mean, truth)
    options = EstimationSection(
        candidates=SMOOTH.candidates, objective=objective, optimiser=optimiser, data=data, iterations=200
    )
    request = learner.reestimate_request(0, options)
    result = reestimate(request)
    learner.adopt(result)
    assert rmse(learner.model().predict(grid()).mean, truth) < 0.7 * before
    assert result.points == (100 if data == "basis" else min(600, len(request.cells)))
    assert learner.fresh_count == 0


def test_a_fit_of_the_rebuilt_basis_knows_that_its_readings_are_means():
    """Two re-estimates in a row: after a rebuild the reading of a basis vector is the mean of about ten."""
    options = EstimationSection(
        objective="marginal",
        data="basis",
        priors=False,
        candidates=("squared_exponential_ard",),
        iterations=200,
    )
    h = Hyperparameters(1.0, 0.09, (SPAN / 9, SPAN / 9))
    ratios = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        truth, x = field(rng, h), legs(rng, 3000, step=3.0)
        learner = taught(Learner(SPAN, hyperparameters=h), x, truth(x) + 0.3 * rng.normal(size=3000))
        assert (learner.gp.basis_counts == 1).all()
        learner.adopt(reestimate(learner.reestimate_request(1, options)))
        assert learner.gp.basis_counts.mean() > 5
        again = reestimate(learner.reestimate_request(2, options))
        ratios.append(again.kernel.noise_variance / h.noise_variance)
    # One fit scatters by a factor of 1.25, the geometric mean of four by 1.12: 1.5 leaves room for over
    # three deviations. Means taken for single readings say a quarter. (Leave-one-out without priors now
    # and then finds no noise at all in a hundred points, whatever their counts.)
    assert 1 / 1.5 < math.exp(np.mean(np.log(ratios))) < 1.5


def test_the_mean_is_refreshed_only_where_readings_were_centred():
    _, x, y = survey(9, 300)
    centred = taught(Learner(SPAN), x, y)
    assert reestimate(centred.reestimate_request(0, OPTIONS)).prior_mean != centred.gp.prior_mean
    uncentred = taught(Learner(SPAN, centring_samples=0, hyperparameters=TRUE), x, y - 33.5)
    assert reestimate(uncentred.reestimate_request(0, OPTIONS)).prior_mean == 0.0


def test_too_few_points_keep_the_hyperparameters_and_say_so():
    learner = Learner(SPAN, centring_samples=5)
    for i in range(10):
        learner.add((100.0 * i, 50.0), float(i), float(i))
    before = learner.gp.kernel, learner.gp.prior_mean
    result = reestimate(learner.reestimate_request(0, OPTIONS))
    assert (result.kernel, result.prior_mean) == before
    assert result.fit.kept_start
    assert "10 points are too few" in result.fit.message
    learner.adopt(result)
    assert learner.add((0.0, 0.0), 1.0, 11.0) is not None


@pytest.mark.parametrize("data", ["history", "basis"])
def test_no_readings_at_all_keep_everything_as_it_is(data):
    learner = Learner(SPAN, centring_samples=0, hyperparameters=TRUE)
    result = reestimate(
        learner.reestimate_request(0, EstimationSection(data=data, candidates=SMOOTH.candidates))
    )
    assert result.kernel == TRUE.kernel
    learner.adopt(result)
    assert learner.add((0.0, 0.0), 1.0, 5.0) is Update.ADDED


@pytest.mark.parametrize("data", ["history", "basis"])
@pytest.mark.parametrize("case", ["constant", "zero", "one place", "all the same", "a line"])
def test_degenerate_readings_break_nothing(case, data):
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, SPAN, (200, 2)), rng.normal(33.5, 1, 200)
    match case:
        case "constant":
            y[:] = 33.5
        case "zero":
            y[:] = 0.0
        case "one place":
            x[:] = 7.0
        case "all the same":
            x[:], y[:] = 7.0, 33.5
        case "a line":
            x[:, 1] = 0.0
    learner = taught(Learner(SPAN), x, y)
    learner.adopt(
        reestimate(learner.reestimate_request(0, EstimationSection(data=data, candidates=SMOOTH.candidates)))
    )
    taught(learner, x, y, start=200)
    prediction = learner.model().predict(grid())
    assert np.isfinite(prediction.mean).all()
    assert (prediction.variance >= -1e-6 * learner.gp.kernel.signal_variance).all()
    assert learner.model().predict([[7.0, 7.0]]).mean[0] == pytest.approx(y.mean(), abs=4)


def test_bad_readings_are_refused_and_change_nothing():
    _, x, y = survey(11, 30)
    learner = taught(Learner(SPAN), x, y)
    before = pickle.dumps(learner)
    for point, value, time_s in [
        ((0, math.nan), 1, 0),
        ((0, 0), math.nan, 0),
        ((0, 0), 1, math.inf),
        ((0,), 1, 0),
    ]:
        with pytest.raises(ValueError, match=r"must|finite"):
            learner.add(point, value, time_s)
    assert pickle.dumps(learner) == before


def test_it_travels_by_pickle():
    _, x, y = survey(12, 60)
    learner = taught(Learner(SPAN), x[:30], y[:30])
    other = pickle.loads(pickle.dumps(learner))
    for one in (learner, other):
        taught(one, x[30:], y[30:], start=30)
    np.testing.assert_array_equal(learner.model().predict(x).mean, other.model().predict(x).mean)


@pytest.mark.parametrize(
    ("keywords", "complaint"),
    [
        ({"centring_samples": -1}, "centring_samples"),
        ({"capacity": 0}, "capacity"),
        ({"novelty": 2.0}, "novelty"),
        ({"jitter": 0.0}, "jitter"),
        ({"hyperparameters": Hyperparameters(1, 1, (1.0,))}, "2 entries"),
    ],
)
def test_impossible_settings_are_refused_at_once(keywords, complaint):
    with pytest.raises(ValueError, match=complaint):
        Learner(SPAN, **keywords)


def test_places_teach_from_a_grid_and_the_basis_stays_on_it_when_it_is_rebuilt():
    learner = Learner(1000.0, capacity=30, centring_samples=5)
    rng = np.random.default_rng(0)
    for number, point in enumerate(rng.uniform(0, 1000, (80, 2))):
        learner.add(point, float(np.sin(point[0] / 150) + 0.01 * rng.normal()), 10.0 * number)
    step = grid_step_m(1000.0)
    assert step == 2.0**-6
    assert len(learner.basis) > 10
    assert coarsest_step_m(learner.basis) >= step
    learner.adopt(reestimate(learner.reestimate_request(0, EstimationSection())))
    while learner.catch_up():
        pass
    assert len(learner.basis) > 10
    assert coarsest_step_m(learner.basis) >= step
