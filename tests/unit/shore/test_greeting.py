"""Whoever appears is asked until he answers, and not more often than makes sense."""

from autonomy.shore.greeting import LONGEST_S, PATIENCE_S, Greeting


def test_who_answers_is_not_asked_again() -> None:
    greeting = Greeting()
    assert not greeting.question(0.0), "nobody has appeared"
    greeting.begin()
    assert greeting.question(5.0)
    assert not greeting.question(6.0), "one question at a time"
    greeting.answered()
    greeting.closed()
    assert not any(greeting.question(float(now)) for now in range(7, 10_000))


def test_who_does_not_answer_is_asked_again_and_less_and_less_often() -> None:
    greeting = Greeting()
    greeting.begin()
    asked = []
    for tenth in range(36_000):
        if greeting.question(tenth / 10):
            asked.append(tenth / 10)
            greeting.closed()
    assert asked[:4] == [0.0, 1.0, 3.0, 7.0]
    assert asked[-1] - asked[-2] == PATIENCE_S[1]


def test_a_question_whose_end_is_never_told_is_given_up() -> None:
    greeting = Greeting()
    greeting.begin()
    assert greeting.question(0.0)
    assert not greeting.question(LONGEST_S - 0.1)
    assert greeting.question(LONGEST_S)


def test_who_appears_again_is_asked_at_once() -> None:
    greeting = Greeting()
    greeting.begin()
    assert greeting.question(0.0)
    greeting.begin()
    assert greeting.question(0.1)
