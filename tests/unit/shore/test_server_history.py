"""Histories that stay within their bounds, and what they keep."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.shore.server.thinning import Rows, Stops


@given(
    arrivals=st.lists(st.tuples(st.floats(0, 1e9), st.integers(0, 300)), min_size=1, max_size=60),
    bound=st.integers(1, 2000),
)
def test_stops_stay_within_their_bytes_and_in_order(arrivals, bound):
    stops = Stops(bound)
    for time_s, size in arrivals:
        stops.add(time_s, bytes(size))
        assert stops.times_s == sorted(set(stops.times_s))
        assert stops.size_bytes <= bound or len(stops) == 1
        assert stops.size_bytes == sum(len(stops.at(each)[1]) for each in stops.times_s)


def test_the_older_the_thinner():
    stops = Stops(100 * 50)
    for k in range(5000):
        stops.add(10.0 * k, bytes(50))
    times = np.array(stops.times_s)
    assert len(times) == 100
    assert (times[0], times[-1]) == (0.0, 49_990.0)
    gaps, ages = np.diff(times), times[-1] - times[:-1]
    # No gap is more than a small share of its age, or the slider would jump over what one looks for; and what is new
    # is all there.
    assert (gaps <= 0.12 * ages + 20.0).all()
    assert gaps[-5:].max() == 10.0


def test_the_stop_of_a_moment_is_the_last_before_it():
    stops = Stops(10_000)
    for time_s in (10.0, 20.0, 30.0):
        stops.add(time_s, str(time_s).encode())
    asked = {5.0: 10.0, 10.0: 10.0, 19.9: 10.0, 20.0: 20.0, 1e9: 30.0}
    assert {time_s: stops.at(time_s)[0] for time_s in asked} == asked
    stops.add(20.0, b"again")
    assert stops.at(25.0) == (20.0, b"again")
    assert len(stops) == 3


def test_a_tighter_bound_holds_at_once():
    stops = Stops(1000)
    for k in range(10):
        stops.add(float(k), bytes(100))
    stops.limit(250)
    assert stops.size_bytes <= 250
    assert stops.times_s[-1] == 9.0
    stops.limit(1)
    assert stops.times_s == [9.0]


def test_no_stop_is_no_moment():
    with pytest.raises(IndexError):
        Stops(10).at(0.0)


@given(count=st.integers(1, 400), limit=st.integers(2, 50))
def test_rows_keep_an_even_choice_and_the_newest(count, limit):
    rows = Rows(2, limit)
    for k in range(count):
        rows.add((k, -k))
    kept = rows.all()
    assert len(kept) <= limit + 1
    assert (kept[:, 1] == -kept[:, 0]).all()
    numbers = kept[:, 0].astype(int).tolist()
    assert numbers[0] == 0
    assert numbers[-1] == count - 1
    strides = {b - a for a, b in itertools.pairwise(numbers[:-1])}
    assert len(strides) <= 1
    # At least half of what there is room for is used: nothing is thrown away before there is need.
    assert len(kept) >= min(count, limit // 2)
