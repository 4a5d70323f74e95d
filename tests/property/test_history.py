"""What holds of the history for any stream of readings."""

import math
import pickle

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.learning.history import SAMPLES_PER_SLICE, History

SPAN = 300.0


@st.composite
def streams(draw):
    """(x, y, value, time) rows: a few places or many, times that mostly rise; and a small memory."""
    n = draw(st.integers(1, 600))
    seed = draw(st.integers(0, 2**32 - 1))
    extent = draw(st.sampled_from([1.0, 40.0, 300.0, 5000.0]))
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.exponential(2.0, n)) + rng.choice([0.0, 1e6])
    if draw(st.booleans()):
        times[rng.integers(0, n, n // 10)] = times[0]
    rows = np.column_stack([rng.uniform(-extent, extent, (n, 2)), rng.normal(33.5, 1.0, n), times])
    return rows, draw(st.integers(10, 200))


def fed(rows, maximum):
    history = History(SPAN, maximum)
    for x, y, value, time_s in rows:
        history.add((x, y), value, time_s)
    return history


@settings(max_examples=60, deadline=None)
@given(streams())
def test_it_is_never_over_its_bound_and_every_reading_is_in_its_sums(stream):
    rows, maximum = stream
    history = History(SPAN, maximum)
    for i, (x, y, value, time_s) in enumerate(rows):
        history.add((x, y), value, time_s)
        assert 0 < len(history) <= maximum
        assert history.samples == i + 1
    cells = history.cells()
    sums = np.column_stack([cells.points, cells.means, cells.times_s]) * cells.counts[:, None]
    assert len(cells) == len(history)
    assert cells.counts.sum() == len(rows)
    np.testing.assert_allclose(sums.sum(axis=0), rows.sum(axis=0), rtol=1e-9, atol=1e-6)
    assert (np.diff(cells.times_s) >= 0).all()


@settings(max_examples=60, deadline=None)
@given(streams())
def test_a_cell_lies_within_its_place(stream):
    """The mean of what fell into a square is in the square: no merging reaches beyond."""
    state = fed(*stream).state()
    low = state["keys"][:, :2] * state["side_m"]
    means = state["sums"][:, :2] / state["sums"][:, -1:]
    assert (means >= low - 1e-6).all()
    assert (means <= low + state["side_m"] + 1e-6).all()


@settings(max_examples=40, deadline=None)
@given(streams(), st.integers(0, 2**32 - 1))
def test_within_a_slice_the_order_of_arrival_is_irrelevant(stream, seed):
    rows, _ = stream
    rng = np.random.default_rng(seed)
    mixed = rows.copy()
    for start in range(0, len(rows), SAMPLES_PER_SLICE):
        part = slice(start, start + SAMPLES_PER_SLICE)
        mixed[part] = rng.permutation(rows[part])
    one, two = (fed(r, 10_000).cells() for r in (rows, mixed))
    order = [
        np.lexsort((c.means, c.points[:, 1], c.points[:, 0], np.round(c.times_s, 6))) for c in (one, two)
    ]
    for name in ("points", "means", "counts", "times_s"):
        a, b = getattr(one, name)[order[0]], getattr(two, name)[order[1]]
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(streams(), st.floats(0, 1))
def test_a_history_restored_is_the_same_and_goes_on_the_same(stream, share):
    rows, maximum = stream
    cut = math.floor(share * len(rows))
    history = fed(rows[:cut], maximum)
    for copy in (History.restore(history.state()), pickle.loads(pickle.dumps(history))):
        original = History.restore(history.state())
        for x, y, value, time_s in rows[cut:]:
            original.add((x, y), value, time_s)
            copy.add((x, y), value, time_s)
        for key, value in original.state().items():
            np.testing.assert_array_equal(copy.state()[key], value, err_msg=key)


@settings(max_examples=25, deadline=None)
@given(st.integers(12, 60), st.integers(500, 4000), st.sampled_from([1, 2, 4]))
def test_the_ages_of_a_place_are_log_spaced(maximum, n, places):
    """Steady readings, so that nothing but the age tells cells apart.

    Criterion: c cells of one place, evenly spaced in the logarithm of their age from one slice to all of the
    time there was, would differ by the factor (all/slice)^(1/c). No step is over three times that one in the
    logarithm (merging two makes one of twice the step, and the pair beside it may have been merged before).
    """
    history = History(SPAN, maximum)
    for i in range(n):
        history.add((5.0 + 10.0 * (i % places), 5.0), 1.0, float(i))
    cells = history.cells()
    for place in range(places):
        times = cells.times_s[np.floor(cells.points[:, 0] / 10.0) == place]
        ages = n - times
        # Of the youngest slices ages differ by more, as nothing is finer than a slice.
        old = ages[ages > 3 * SAMPLES_PER_SLICE]
        if len(old) < 2:
            continue
        even = math.log(n / SAMPLES_PER_SLICE) / (maximum // places)
        steps = -np.diff(np.log(old))
        assert steps.max() <= max(3.0 * even, math.log(2.0)), (steps, even)
