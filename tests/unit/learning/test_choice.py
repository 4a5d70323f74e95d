import math
import pickle

import numpy as np
import pytest

from autonomy.learning.choice import choose, readings_of, stilled
from autonomy.learning.fitting import Method, fit
from autonomy.learning.history import HistoryCells
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.likelihood import Readings, log_parameters
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.structures import STRUCTURES, structure_named
from autonomy.learning.temporal import OrnsteinUhlenbeck, Static

SPAN = 1000.0
SMOOTH = Component(2.0, SquaredExponential((250.0, 250.0)))
STILL = Kernel((SMOOTH,), 0.02)
ROUGH = Kernel((SMOOTH, Component(0.8, Matern32((70.0, 70.0)))), 0.02)
FORGETTING = Kernel((Component(2.0, SquaredExponential((200.0, 200.0)), OrnsteinUhlenbeck(1500.0)),), 0.02)


def draw(kernel, n=120, seed=0):
    rng = np.random.default_rng(seed)
    x, t = rng.uniform(0, SPAN, (n, 2)), np.sort(rng.uniform(0, 4000, n))
    K = kernel.covariance(x, x, np.abs(np.subtract.outer(t, t))) + kernel.noise_variance * np.eye(n)
    return x, 33.5 + np.linalg.cholesky(K) @ rng.normal(size=n), t


def readings(kernel, n=120, seed=0):
    x, y, t = draw(kernel, n, seed)
    return Readings.of(x, y, None, t, "gls")


def test_a_smooth_still_field_stays_one_still_component():
    choice = choose(readings(STILL), list(STRUCTURES), SPAN)
    assert choice.fit.structure == "squared_exponential"
    assert choice.fit.kernel.is_static
    assert set(choice.scores) == set(choice.starts) == set(STRUCTURES)


def test_roughness_and_motion_are_found():
    rough = choose(readings(ROUGH, 200), list(STRUCTURES), SPAN).fit
    assert rough.structure in ("long_short", "matern32")
    assert rough.kernel.is_static
    moving = choose(readings(FORGETTING, 200), list(STRUCTURES), SPAN).fit
    assert not moving.kernel.is_static
    alone = choose(readings(FORGETTING, 200), ["ou"], SPAN).fit
    assert 500 < alone.kernel.components[0].time.timescale_s < 4500


def test_the_incumbent_needs_less():
    r = readings(STILL, 60)
    plain = choose(r, ["squared_exponential", "matern32"], SPAN)
    held = choose(r, ["squared_exponential", "matern32"], SPAN, incumbent="matern32")
    assert held.scores["matern32"] == pytest.approx(plain.scores["matern32"] + 2.0)
    assert held.scores["squared_exponential"] == plain.scores["squared_exponential"]


def test_starts_of_the_last_choice_are_where_the_next_begins():
    names = list(STRUCTURES)
    r = readings(FORGETTING, 150)
    first = choose(r, names, SPAN)
    again = choose(r, names, SPAN, first.fit.structure, first.starts)
    assert again.fit.structure == first.fit.structure
    assert again.fit.iterations <= 3
    for name in names:
        bonus = 2.0 * (name == first.fit.structure)
        assert again.scores[name] >= first.scores[name] + bonus - 1e-3
    assert pickle.loads(pickle.dumps(first)) == first


def test_few_readings_get_simple_structures():
    x, y, t = draw(FORGETTING, 39)
    choice = choose(Readings.of(x, y, None, t, "gls"), list(STRUCTURES), SPAN)
    able = {name for name, s in STRUCTURES.items() if s.minimum_points <= 39}
    assert set(choice.scores) == able < set(STRUCTURES)
    few = choose(Readings.of(x[:10], y[:10], None, t[:10], "gls"), ["static_moving", "long_short"], SPAN)
    assert few.fit.kept_start
    assert np.isfinite(log_parameters(few.fit.kernel)).all()
    assert few.starts == {}


def test_without_times_nothing_moves():
    x, y, _ = draw(STILL, 60)
    choice = choose(Readings.of(x, y, None, None, "gls"), list(STRUCTURES), SPAN)
    assert not any(STRUCTURES[name].moves for name in choice.scores)
    at_once = choose(Readings.of(x, y, None, np.zeros(60), "gls"), ["ou", "matern32"], SPAN)
    assert set(at_once.scores) == {"matern32"}


def lawnmower(lanes, n):
    """n places along lanes that cover the square once."""
    along = np.linspace(0, lanes, n, endpoint=False)
    lane = np.floor(along)
    across = np.where(lane % 2 == 0, along - lane, 1 - along + lane)
    return SPAN * np.column_stack([across, (lane + 0.5) / lanes])


def test_on_a_track_that_comes_nowhere_twice_nothing_moves():
    x, t = lawnmower(8, 200), 20.0 * np.arange(200)
    # Quiet in the south, rough in the north: what is seen late has nothing in common with what was seen early.
    y = np.where(x[:, 1] > 500, np.sin(x[:, 0] / 30) + np.sin(x[:, 1] / 40), 0.05 * np.sin(x[:, 0] / 30))
    names = ["long_short", "ou", "smooth_motion", "static_moving"]
    assert set(choose(Readings.of(x, y, None, t, "gls"), names, SPAN).scores) == {"long_short"}
    twice = Readings.of(np.tile(x, (2, 1)), np.tile(y, 2), None, np.arange(400.0), "gls")
    choice = choose(twice, names, SPAN)
    assert set(choice.scores) == set(names)
    assert choice.fit.kernel.is_static


def test_motion_that_readings_do_not_ask_for_is_taken_out():
    slow = Component(1.0, SquaredExponential((100.0, 100.0)), OrnsteinUhlenbeck(21_000.0))
    assert stilled(Kernel((SMOOTH, slow), 0.1), 1000.0).is_static
    assert stilled(Kernel((slow,), 0.1), 1000.0) == Kernel((Component(1.0, slow.space, Static()),), 0.1)
    assert not stilled(Kernel((SMOOTH, slow), 0.1), 1100.0).is_static
    tiny = Component(0.01, SquaredExponential((100.0, 100.0)), OrnsteinUhlenbeck(500.0))
    assert stilled(Kernel((SMOOTH, tiny), 0.1), 1000.0) == Kernel((SMOOTH,), 0.1)
    quick = Kernel(
        (SMOOTH, Component(0.1, SquaredExponential((100.0, 100.0)), OrnsteinUhlenbeck(500.0))), 0.1
    )
    assert stilled(quick, 1000.0) == quick


@pytest.mark.parametrize("case", ["none", "constant", "one place", "one time", "outlier"])
def test_degenerate_readings_never_break_a_choice(case):
    rng = np.random.default_rng(5)
    x, y, t = rng.uniform(0, SPAN, (60, 2)), rng.normal(size=60), np.arange(60.0)
    match case:
        case "none":
            x, y, t = x[:0], y[:0], t[:0]
        case "constant":
            y[:] = 33.5
        case "one place":
            x[:] = 5.0
        case "one time":
            t[:] = 7.0
        case "outlier":
            y[3] = 1e30
    found = choose(Readings.of(x, y, None, t, "gls"), list(STRUCTURES), SPAN).fit
    assert np.isfinite([*log_parameters(found.kernel), found.prior_mean]).all()
    assert not math.isnan(found.score)


def test_random_cells_are_the_readings_and_all_of_them_while_they_are_few():
    x, y, t = draw(STILL, 80)
    cells = HistoryCells(x, y, np.arange(1.0, 81.0), t)
    everything = readings_of(cells, 300, np.random.default_rng(0))
    np.testing.assert_array_equal(everything.y, y)
    np.testing.assert_array_equal(everything.noise_scale, 1.0 / cells.counts)
    assert everything.unknown_mean
    some = readings_of(cells, 30, np.random.default_rng(0), mean=33.5)
    assert some.n == 30
    assert len(np.unique(some.times_s)) == 30
    assert some.fixed_mean == 33.5
    assert np.ptp(some.times_s) > 2000


def test_the_method_reaches_every_fit():
    r = readings(STILL, 50)
    choice = choose(r, ["matern32"], SPAN, method=Method("loo", iterations=5))
    assert choice.fit == fit(r, STRUCTURES["matern32"], SPAN, method=Method("loo", iterations=5))


def test_unknown_structures_are_refused():
    with pytest.raises(ValueError, match=r"nonsense.*squared_exponential"):
        structure_named("nonsense")
    with pytest.raises(ValueError, match="candidates"):
        choose(readings(STILL, 30), [], SPAN)
