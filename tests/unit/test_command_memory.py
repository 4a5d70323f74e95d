"""Which commands are carried out: each once, none too late, whatever the clock does and however many there are."""

from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy import command_memory
from autonomy.command_memory import CAPACITY, CommandMemory
from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived


def command(
    number: int, issued_s: float = 1000.0, valid_s: float = 30.0, at_s: float | None = None
) -> CommandReceived:
    return CommandReceived(
        number.to_bytes(16, "big"), "pause", issued_s, valid_s, issued_s if at_s is None else at_s
    )


def answer(one: CommandReceived, outcome: Outcome = Outcome.DONE) -> Answer:
    return Answer(one.command_id, one.verb, outcome, "", "", "", "", armed=False, utc_s=one.received_utc_s)


def carried_out(memory: CommandMemory, one: CommandReceived) -> bool:
    """As the directives do it."""
    if memory.known(one) is not None:
        return False
    objection = memory.objection(one)
    outcome = Outcome.DONE if objection is None else objection[0]
    if outcome is not Outcome.BUSY:
        memory.remember(one, answer(one, outcome))
    return outcome is Outcome.DONE


def test_a_repetition_gets_the_same_answer() -> None:
    memory = CommandMemory()
    first = command(1)
    assert memory.objection(first) is None
    memory.remember(first, answer(first))
    assert memory.known(replace(first, received_utc_s=5000.0)) == answer(first)


@pytest.mark.parametrize(
    ("late_s", "says"),
    [(30.5, "issued 30 s ago and valid for 30 s"), (-5.5, "issued 6 s ahead of the clock on board")],
)
def test_too_late_and_too_early(late_s: float, says: str) -> None:
    memory = CommandMemory()
    assert memory.objection(command(1, at_s=1000.0 + late_s)) == (Outcome.EXPIRED, says)
    assert memory.objection(command(1, at_s=1000.0 + 0.9 * late_s)) is None


def test_an_id_stands_for_one_command() -> None:
    memory = CommandMemory()
    memory.remember(command(1), answer(command(1)))
    other = replace(command(1), verb="return")
    assert memory.known(other) is None
    objection = memory.objection(other)
    assert objection is not None
    assert objection[0] is Outcome.REFUSED
    assert memory.known(command(1)) == answer(command(1)), "and is not overwritten"


def test_of_too_many_at_once_further_ones_wait() -> None:
    memory = CommandMemory()
    assert all(carried_out(memory, command(k)) for k in range(CAPACITY))
    objection = memory.objection(command(CAPACITY))
    assert objection is not None
    assert objection[0] is Outcome.BUSY
    later = command(CAPACITY, issued_s=1031.0)
    assert carried_out(memory, later)
    assert len(memory) == CAPACITY


def test_what_was_forgotten_is_too_old_even_if_the_clock_is_set_back() -> None:
    memory = CommandMemory()
    commands = [command(k, issued_s=1000.0 + 31.0 * k) for k in range(CAPACITY + 50)]
    assert all(carried_out(memory, each) for each in commands)
    # Somebody has kept them, and the clock on board begins anew at the time of the first.
    assert not any(carried_out(memory, each) for each in commands)


@settings(deadline=None)
@given(st.data())
def test_each_command_is_carried_out_once_at_most(data: st.DataObject) -> None:
    """Clocks that jump, commands in any order and again and again, a memory that holds three."""
    known, command_memory.CAPACITY = command_memory.CAPACITY, 3
    try:
        memory = CommandMemory()
        times = st.floats(900.0, 1300.0)
        commands = [
            command(k, issued_s, valid_s)
            for k, (issued_s, valid_s) in enumerate(
                data.draw(st.lists(st.tuples(times, st.floats(1.0, 100.0)), min_size=4, max_size=10))
            )
        ]
        done: Counter[bytes] = Counter()
        for k, at_s in data.draw(st.lists(st.tuples(st.integers(0, len(commands) - 1), times), max_size=40)):
            one = replace(commands[k], received_utc_s=at_s)
            if carried_out(memory, one):
                done[one.command_id] += 1
                assert -5.0 <= at_s - one.issued_utc_s <= one.valid_s
            assert len(memory) <= 3
    finally:
        command_memory.CAPACITY = known
    assert max(done.values(), default=0) <= 1
