import math
import pickle

import numpy as np
import pytest

from autonomy.learning.history import History


def filled(n, seed=0, span=300.0, maximum=2000, extent=None):
    rng = np.random.default_rng(seed)
    history = History(span, maximum)
    rows = np.column_stack(
        [rng.uniform(0, extent or span, (n, 2)), rng.normal(33.5, 1, n), np.arange(n) * 2.0]
    )
    for x, y, value, time_s in rows:
        history.add((x, y), value, time_s)
    return history, rows


def totals(cells):
    weighted = np.column_stack([cells.points, cells.means, cells.times_s]) * cells.counts[:, None]
    return weighted.sum(axis=0)


def test_a_cell_averages_what_fell_into_it():
    history = History(300.0)
    history.add((1.0, 2.0), 10.0, 100.0)
    history.add((3.0, 8.0), 14.0, 102.0)
    history.add((11.0, 2.0), 50.0, 103.0)
    cells = history.cells()
    np.testing.assert_allclose(cells.points, [[2.0, 5.0], [11.0, 2.0]])
    np.testing.assert_allclose(cells.means, [12.0, 50.0])
    np.testing.assert_allclose(cells.counts, [2, 1])
    np.testing.assert_allclose(cells.times_s, [101.0, 103.0])


def test_a_place_revisited_fifty_samples_later_is_a_cell_of_its_own():
    history = History(300.0)
    for i in range(120):
        history.add((1.0, 1.0), float(i), float(i))
    np.testing.assert_allclose(history.cells().counts, [50, 50, 20])


def test_cells_on_both_sides_of_the_origin_are_kept_apart():
    history = History(300.0)
    history.add((-1.0, 1.0), 1.0, 0.0)
    history.add((1.0, 1.0), 2.0, 0.0)
    assert len(history) == 2


@pytest.mark.parametrize("maximum", [10, 150, 1000])
def test_it_stays_bounded_and_loses_no_reading(maximum):
    history, rows = filled(5000, maximum=maximum)
    cells = history.cells()
    assert len(cells) == len(history) <= maximum
    assert cells.counts.sum() == history.samples == 5000
    np.testing.assert_allclose(totals(cells), rows.sum(axis=0), rtol=1e-9)
    assert (np.diff(cells.times_s) >= 0).all()


def test_old_slices_are_merged_before_young_ones_and_places_stay():
    history = History(60.0, maximum_cells=100)
    assert history.side_m == 10.0
    for i in range(20_000):
        history.add((5.0 + 10 * (i % 4), 5.0), 1.0, float(i))
    cells = history.cells()
    assert len(cells) <= 100
    assert set(map(tuple, np.round(cells.points, 6))) == {(5.0 + 10 * k, 5.0) for k in range(4)}
    one_place = cells.times_s[np.abs(cells.points[:, 0] - 5.0) < 1]
    gaps, ages = np.diff(one_place), 20_000 - one_place[:-1]
    # Log-spaced: the gap between two slices grows with their age, none is far out of proportion.
    assert gaps[-3:].max() <= 100
    assert gaps[0] > 5 * gaps[-1]
    assert (gaps / ages).max() < 1.01


def test_more_places_than_cells_make_the_cells_wider():
    history, _ = filled(3000, span=270.0, maximum=200, extent=3000.0)
    assert len(history) <= 200
    assert history.side_m in [30.0 * 2**k for k in range(1, 8)]
    assert len(history) > 20


@pytest.mark.parametrize(
    ("maximum", "side"), [(10, 150.0), (100, 50.0), (1000, 300 / 21), (2000, 10), (20_000, 10)]
)
def test_with_little_memory_cells_are_wider_so_that_a_place_can_have_a_past(maximum, side):
    history = History(300.0, maximum)
    assert history.side_m == pytest.approx(side)
    assert (300.0 / history.side_m) ** 2 * 2 <= maximum


def test_a_state_is_a_copy_of_plain_numbers_and_arrays():
    history, _ = filled(300)
    state = history.state()
    assert {type(value) for value in state.values()} == {float, int, np.ndarray}
    before = history.cells()
    state["sums"][:] = -1
    np.testing.assert_array_equal(history.cells().means, before.means)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"sums": np.full((300, 5), np.nan)}, "finite rows"),
        ({"sums": np.zeros((300, 5))}, "n at least 1"),
        ({"keys": np.zeros((3, 3))}, "do not fit"),
        ({"maximum_cells": 20}, "do not fit"),
        ({"younger": np.full(300, 300)}, "a link must name"),
        ({"younger": np.full(300, 7)}, "no two the same"),
    ],
)
def test_a_damaged_state_is_refused_and_says_why(change, complaint):
    history = History(300.0)
    for i in range(300):
        history.add((300.0 * i, 0.0), 1.0, float(i))
    with pytest.raises(ValueError, match=complaint):
        History.restore(history.state() | change)


def test_a_place_beyond_all_seas_is_refused():
    history = History(300.0)
    with pytest.raises(ValueError, match="position must be within"):
        history.add((1e30, 0.0), 1.0, 0.0)
    assert history.samples == 0


def test_it_travels_by_pickle():
    history, _ = filled(300)
    other = pickle.loads(pickle.dumps(history))
    for h in (history, other):
        h.add((5.0, 5.0), 1.0, 1000.0)
    np.testing.assert_array_equal(history.cells().means, other.cells().means)


def test_an_empty_history_has_no_cells():
    assert History(300.0).cells().points.shape == (0, 2)
    assert len(History(300.0).cells()) == 0


@pytest.mark.parametrize(
    ("point", "value", "time_s"),
    [((math.nan, 0), 0, 0), ((0, 0), math.inf, 0), ((0, 0), 0, math.nan), ((0, 0, 0), 0, 0), (0.0, 0, 0)],
)
def test_bad_readings_are_refused_and_not_counted(point, value, time_s):
    history, _ = filled(20)
    with pytest.raises(ValueError, match="must"):
        history.add(point, value, time_s)
    assert history.samples == 20


def test_impossible_sizes_are_refused():
    with pytest.raises(ValueError, match="span_m"):
        History(0.0)
    with pytest.raises(ValueError, match="maximum_cells"):
        History(1.0, 3)
