"""Which commands are carried out: each once, none too late, whatever the clock does and however many there are."""

from collections import Counter
from dataclasses import replace
from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy import command_memory
from autonomy.command_memory import CAPACITY, EARLY_S, RESERVED, CommandMemory
from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived

HOUR_S, YEAR_S = 3600.0, 365.0 * 86400.0


def command(
    number: int,
    issued_s: float = 1000.0,
    valid_s: float = 30.0,
    at_s: float | None = None,
    verb: str = "replan",
) -> CommandReceived:
    return CommandReceived(
        number.to_bytes(16, "big"), verb, issued_s, valid_s, issued_s if at_s is None else at_s
    )


def answer(one: CommandReceived, outcome: Outcome = Outcome.DONE) -> Answer:
    return Answer(one.command_id, one.verb, outcome, "", "", "", "", armed=False, utc_s=one.received_utc_s)


def carried_out(memory: CommandMemory, one: CommandReceived, now: float = 0.0) -> Outcome | None:
    """As the directives do it; None for a repetition."""
    if memory.known(one) is not None:
        return None
    objection = memory.objection(now, one)
    outcome = Outcome.DONE if objection is None else objection[0]
    if outcome is not Outcome.BUSY:
        memory.remember(now, one, answer(one, outcome))
    return outcome


class Operator:
    """Commands as `autonomy ctl` does: by his own clock, and if that is another than the boat's, once more by that."""

    def __init__(self, memory: CommandMemory) -> None:
        self._memory = memory
        self._numbers = count()

    def asks(
        self, now: float, ours_s: float, theirs_s: float, verb: str, valid_s: float = 30.0
    ) -> Outcome | None:
        first = command(next(self._numbers), ours_s, valid_s, theirs_s, verb)
        outcome = carried_out(self._memory, first, now)
        if outcome is not Outcome.EXPIRED:
            return outcome
        issued_s = self._memory.clock_utc_s(now, theirs_s)
        anew = command(next(self._numbers), issued_s, valid_s, theirs_s, verb)
        return carried_out(self._memory, anew, now)


def test_a_repetition_gets_the_same_answer() -> None:
    memory = CommandMemory()
    first = command(1)
    assert memory.objection(0.0, first) is None
    memory.remember(0.0, first, answer(first))
    assert memory.known(replace(first, received_utc_s=5000.0)) == answer(first)


@pytest.mark.parametrize(
    ("late_s", "says"),
    [(30.5, "issued 30 s ago and valid for 30 s"), (-5.5, "issued 6 s ahead of the clock on board")],
)
def test_too_late_and_too_early(late_s: float, says: str) -> None:
    memory = CommandMemory()
    assert memory.objection(0.0, command(1, at_s=1000.0 + late_s)) == (Outcome.EXPIRED, says)
    assert memory.objection(0.0, command(1, at_s=1000.0 + 0.9 * late_s)) is None


def test_an_id_stands_for_one_command() -> None:
    memory = CommandMemory()
    memory.remember(0.0, command(1), answer(command(1)))
    other = replace(command(1), verb="return")
    assert memory.known(other) is None
    objection = memory.objection(0.0, other)
    assert objection is not None
    assert objection[0] is Outcome.REFUSED
    assert memory.known(command(1)) == answer(command(1)), "and is not overwritten"


def test_of_too_many_at_once_further_ones_wait_but_not_those_that_stop_the_boat() -> None:
    memory = CommandMemory()
    numbers = count()
    assert all(carried_out(memory, command(next(numbers))) is Outcome.DONE for _ in range(CAPACITY))
    assert carried_out(memory, command(next(numbers))) is Outcome.BUSY
    verbs = ("pause", "finish", "return")
    stops = [command(next(numbers), verb=verbs[k % 3]) for k in range(RESERVED)]
    assert all(carried_out(memory, each) is Outcome.DONE for each in stops)
    assert carried_out(memory, command(next(numbers), verb="pause")) is Outcome.BUSY
    assert all(memory.known(each) for each in stops), "each of them may still be repeated"
    assert carried_out(memory, command(next(numbers), issued_s=1031.0), now=31.0) is Outcome.DONE
    assert len(memory) == 1


def test_what_was_forgotten_is_too_old_even_if_the_clock_is_set_back() -> None:
    memory = CommandMemory()
    commands = [command(k, issued_s=1000.0 + 31.0 * k) for k in range(CAPACITY + 50)]
    assert all(carried_out(memory, each, 31.0 * k) is Outcome.DONE for k, each in enumerate(commands))
    assert memory.known(commands[0]) is None
    # Somebody has kept them, and the clock on board begins anew at the time of the first.
    assert not any(carried_out(memory, each, 1e4) is Outcome.DONE for each in commands)


@pytest.mark.parametrize("wrong_s", [-5.0 * HOUR_S, -20.0 * YEAR_S, -40.0, 40.0, 5.0 * HOUR_S, 20.0 * YEAR_S])
def test_a_wrong_clock_does_not_keep_the_operator_out(wrong_s: float) -> None:
    """Ten hours, then the clock is set right, and ten hours more."""
    memory = CommandMemory()
    operator = Operator(memory)
    for k in range(2000):
        now, utc_s = 36.0 * k, 1.7e9 + 36.0 * k
        theirs_s = utc_s + (wrong_s if k < 1000 else 0.0)
        assert operator.asks(now, utc_s, theirs_s, "replan") is Outcome.DONE, k
        assert len(memory) <= CAPACITY


def test_two_operators_one_with_a_wrong_clock_do_not_keep_each_other_out() -> None:
    memory = CommandMemory()
    operator = Operator(memory)
    for k in range(1500):
        now, utc_s = 20.0 * k, 1.7e9 + 20.0 * k
        assert operator.asks(now, utc_s, utc_s, "replan") is Outcome.DONE
        assert operator.asks(now, utc_s + 3.0 * YEAR_S, utc_s, "replan") is Outcome.DONE


def test_who_gives_too_many_commands_keeps_nobody_from_stopping_the_boat() -> None:
    """A script that has gone mad, once a second and each valid for as long as may be."""
    memory = CommandMemory()
    mad, operator = Operator(memory), Operator(memory)
    operator._numbers = count(10**6)
    outcomes: Counter[Outcome | None] = Counter()
    for k in range(3000):
        utc_s = 1.7e9 + k
        outcomes[mad.asks(float(k), utc_s, utc_s, "resume", 600.0)] += 1
        if k % 30 == 0:
            assert operator.asks(float(k), utc_s, utc_s, "pause") is Outcome.DONE
    assert set(outcomes) == {Outcome.DONE, Outcome.BUSY}
    assert outcomes[Outcome.DONE] > CAPACITY, "places come free as time goes by"


@settings(deadline=None, max_examples=200)
@given(st.data())
def test_each_command_is_carried_out_once_at_most(data: st.DataObject) -> None:
    """Clocks that jump, commands in any order and again and again, a memory that holds three and one."""
    known = command_memory.CAPACITY, command_memory.RESERVED
    command_memory.CAPACITY, command_memory.RESERVED = 3, 1
    try:
        memory = CommandMemory()
        times = st.floats(900.0, 1300.0)
        verbs = st.sampled_from(["pause", "replan"])
        commands = [
            command(k, issued_s, valid_s, verb=verb)
            for k, (issued_s, valid_s, verb) in enumerate(
                data.draw(st.lists(st.tuples(times, st.floats(1.0, 100.0), verbs), min_size=4, max_size=10))
            )
        ]
        done: Counter[bytes] = Counter()
        answers: dict[bytes, tuple[float, Outcome]] = {}
        now = 0.0
        steps = st.tuples(st.integers(0, len(commands) - 1), times, st.floats(0.0, 60.0))
        for k, at_s, passed_s in data.draw(st.lists(steps, max_size=40)):
            now += passed_s
            one = replace(commands[k], received_utc_s=at_s)
            outcome = carried_out(memory, one, now)
            if outcome is Outcome.DONE:
                done[one.command_id] += 1
                age_s = memory.clock_utc_s(now, at_s) - one.issued_utc_s
                assert -EARLY_S <= age_s <= one.valid_s
            if outcome in (Outcome.DONE, Outcome.EXPIRED):
                first_at, first = answers.setdefault(one.command_id, (now, outcome))
                # Nobody asks for longer than it is valid: until then it must not look as if nothing had been done.
                assert outcome is first or now > first_at + one.valid_s
            assert len(memory) <= 4
    finally:
        command_memory.CAPACITY, command_memory.RESERVED = known
    assert max(done.values(), default=0) <= 1
