"""Observations kept for the shore: all of them in order, at least once, within bounds."""

import math
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.shell.backlog import CONFIRMED_S, IN_FLIGHT, Backlog
from autonomy.wire import MAXIMUM_OBSERVATIONS, ObservationNotice


def notices(*numbers: int) -> list[ObservationNotice]:
    return [ObservationNotice(float(n), 33.5, -118.5, n / 3, 4, (1, 2, 3, 4, 9, 2, 1)) for n in numbers]


def times(batches: list[tuple[ObservationNotice, ...]]) -> list[float]:
    return [one.model_time_s for batch in batches for one in batch]


def test_what_is_put_in_comes_out_as_it_was() -> None:
    backlog = Backlog(10)
    given_ = [*notices(1, 2), ObservationNotice(3.0, -33.5, 179.9, math.nan, 9, (9,) * 7)]
    backlog.add(given_)
    (batch,) = backlog.take(0.0)
    assert batch[:2] == tuple(given_[:2])
    assert repr(batch[2]) == repr(given_[2])


def test_what_arrived_is_forgotten_and_what_may_not_have_is_not() -> None:
    backlog = Backlog(10)
    backlog.add(notices(1, 2))
    assert times(backlog.take(0.0)) == [1.0, 2.0]
    backlog.add(notices(3))
    assert times(backlog.take(CONFIRMED_S - 1.0)) == [3.0]
    assert len(backlog) == 3
    assert backlog.take(CONFIRMED_S) == []
    assert len(backlog) == 1, "the first two have arrived"
    backlog.lost()
    assert times(backlog.take(CONFIRMED_S + 1.0)) == [3.0]


def test_of_too_many_the_oldest_are_dropped_and_counted() -> None:
    backlog = Backlog(3)
    backlog.add(notices(1, 2))
    backlog.take(0.0)
    backlog.add(notices(3, 4, 5))
    assert backlog.dropped == 2
    backlog.lost()
    assert times(backlog.take(1.0)) == [3.0, 4.0, 5.0]


def test_a_weeks_worth_drains_in_bounded_pieces() -> None:
    backlog = Backlog(100_000)
    backlog.add(notices(*range(30_000)))
    got, now = times(backlog.take(0.0)), 0.0
    assert len(got) == IN_FLIGHT
    assert not backlog.is_ready(1.0)
    while len(backlog):
        now += CONFIRMED_S
        batches = backlog.take(now)
        assert all(len(batch) <= MAXIMUM_OBSERVATIONS for batch in batches)
        got += times(batches)
    assert got == list(range(30_000))
    assert now <= 5 * CONFIRMED_S


def test_a_week_at_a_reading_a_second_takes_little_memory() -> None:
    one = notices(1)
    tracemalloc.start()
    try:
        backlog = Backlog(604_800)
        for _ in range(10_000):
            backlog.add(one)
        assert tracemalloc.get_traced_memory()[1] < 30e6
    finally:
        tracemalloc.stop()


def test_nothing_kept_makes_no_sense() -> None:
    with pytest.raises(ValueError, match="at least one"):
        Backlog(0)


STEPS = st.lists(st.sampled_from(["add", "take", "lost", "later"]), max_size=60)


@given(STEPS, st.integers(1, 12))
def test_each_comes_in_order_and_none_is_missing_but_those_dropped(steps: list[str], capacity: int) -> None:
    backlog = Backlog(capacity)
    now, put, came = 0.0, 0, []
    for step in [*steps, "lost", "take"]:
        match step:
            case "add":
                backlog.add(notices(put, put + 1))
                put += 2
            case "take":
                batch = times(backlog.take(now))
                assert batch == sorted(batch)
                came += batch
            case "lost":
                backlog.lost()
            case "later":
                now += 6.0
    assert len(set(came) | set(range(put))) == put, "nothing that was not put in"
    assert put - len(set(came)) <= backlog.dropped
    assert len(backlog) <= capacity
