"""What was told in order, kept on board: any piece of it can be had by its number, within bounds."""

import math
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.shell.backlog import Lines, Observations
from autonomy.wire import MAXIMUM_OBSERVATIONS, LogNotice, ObservationNotice
from autonomy.wire_rules import MAXIMUM_LINES

RUN = 77


def made(*numbers: int) -> list[ObservationNotice]:
    return [ObservationNotice(float(n), 33.5, -118.5, n / 3, 4, (1, 2, 3, 4, 9, 2, 1)) for n in numbers]


def test_what_is_put_in_comes_out_as_it_was() -> None:
    store = Observations(RUN, 10)
    given_ = [*made(1, 2), ObservationNotice(3.0, -33.5, 179.9, math.nan, 9, (9,) * 7)]
    store.add(given_)
    batch = store.batch(0, 10)
    assert (batch.run, batch.first, batch.oldest, batch.end) == (RUN, 0, 0, 3)
    assert batch.items[:2] == tuple(given_[:2])
    assert repr(batch.items[2]) == repr(given_[2])


def test_of_too_many_the_oldest_are_dropped_and_those_counted_that_nobody_had() -> None:
    store = Observations(RUN, 3)
    store.add(made(0, 1))
    assert store.batch(0, 1).items == tuple(made(0))
    store.add(made(2, 3, 4))
    assert store.dropped == 1, "0 had been handed out, 1 had not"
    batch = store.batch(0, 10)
    assert (batch.first, batch.oldest, batch.items) == (2, 2, tuple(made(2, 3, 4)))


def test_what_nobody_listens_to_is_not_sent_by_itself_and_can_be_asked_for() -> None:
    store = Lines(RUN, 10)
    store.add(LogNotice("info", "one"))
    store.skip()
    store.add(LogNotice("info", "two"))
    assert (store.sent, store.end) == (1, 2)
    assert [line.text for line in store.batch(store.sent, 9).items] == ["two"]
    assert [line.text for line in store.batch(0, 1).items] == ["one"]
    assert store.sent == 2


def test_a_batch_fits_a_payload() -> None:
    store, lines = Observations(RUN, 10_000), Lines(RUN, 10_000)
    store.add(made(*range(9000)))
    for _ in range(9000):
        lines.add(LogNotice("info", ""))
    assert len(store.batch(0, 10_000).items) == MAXIMUM_OBSERVATIONS
    assert len(lines.batch(0, 10_000).items) == MAXIMUM_LINES


@given(
    st.integers(1, 20),
    st.integers(0, 50),
    st.integers(-60, 60),
    st.integers(0, 60),
)
def test_any_piece_of_what_is_kept(capacity: int, count: int, first: int, most: int) -> None:
    numbers = list(range(count))
    store, lines = Observations(RUN, capacity), Lines(RUN, capacity)
    store.add(made(*numbers))
    for n in numbers:
        lines.add(LogNotice("info", str(n)))
    start = first if first >= 0 else count + first
    wanted = [n for n in numbers[-capacity:] if n >= start][:most]
    assert [one.model_time_s for one in store.batch(first, most).items] == wanted
    assert [line.text for line in lines.batch(first, most).items] == [str(n) for n in wanted]
    for batch in (store.batch(first, most), lines.batch(first, most)):
        assert batch.oldest == max(0, count - capacity)
        assert batch.oldest <= batch.first <= batch.first + len(batch.items) <= batch.end <= count


def test_a_week_at_a_reading_a_second_takes_little_memory() -> None:
    one = made(1)
    tracemalloc.start()
    try:
        store = Observations(RUN, 604_800)
        for _ in range(10_000):
            store.add(one)
        assert tracemalloc.get_traced_memory()[1] < 30e6
    finally:
        tracemalloc.stop()


def test_nothing_can_be_kept_in_no_room() -> None:
    for store in (Observations, Lines):
        with pytest.raises(ValueError, match="at least one"):
            store(RUN, 0)
