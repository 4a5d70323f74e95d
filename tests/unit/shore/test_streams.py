"""Numbered items put together: whatever is lost, doubled or out of order, they are given on once and in order."""

from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.shell.backlog import Lines
from autonomy.shore.greeting import PATIENCE_S
from autonomy.shore.streams import GRACE_S, Stream
from autonomy.wire import LogBatch, LogNotice


def batch(first: int, *texts: str, run: int = 1, oldest: int = 0, end: int | None = None) -> LogBatch:
    last = first + len(texts)
    return LogBatch(
        run, first, oldest, last if end is None else end, tuple(LogNotice("info", t) for t in texts)
    )


def texts(batches: list[LogBatch]) -> list[str]:
    return [line.text for each in batches for line in each.items]


def joined(stream: Stream[LogBatch], answer: LogBatch) -> list[str]:
    """The stream after its first question was answered."""
    stream.greet()
    piece = stream.question(0.0)
    assert piece is not None
    given_ = texts(stream.take(answer, asked=True))
    return given_ + texts(stream.closed(piece))


def test_who_comes_late_asks_for_as_much_as_he_wants() -> None:
    everything, newest = Stream[LogBatch](None), Stream[LogBatch](20)
    for stream in (everything, newest):
        stream.greet()
    assert everything.question(0.0).first == 0
    assert newest.question(0.0).first == -20


def test_what_comes_before_the_first_answer_waits_for_it() -> None:
    stream = Stream[LogBatch](None)
    assert stream.take(batch(2, "c")) == []
    assert joined(stream, batch(0, "a", "b")) == ["a", "b", "c"]


def test_a_gap_is_asked_for_after_a_moment_and_what_comes_meanwhile_is_kept() -> None:
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a"))
    assert stream.take(batch(3, "d")) == []
    assert stream.question(10.0) is None, "it may have been overtaken"
    piece = stream.question(10.0 + GRACE_S)
    assert (piece.first, piece.parameters) == (1, "from=1;count=4096")
    assert stream.question(100.0) is None, "one question at a time"
    assert stream.take(batch(4, "e")) == []
    assert texts(stream.take(batch(1, "b", "c", end=5), asked=True)) == ["b", "c", "d", "e"]
    assert stream.closed(piece) == []
    assert stream.question(200.0) is None


def test_the_last_of_a_burst_is_missed_too() -> None:
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a"))
    stream.told(1, 3)
    assert stream.question(1.0) is None
    assert stream.question(1.0 + GRACE_S).first == 1


def test_what_was_known_is_not_given_again() -> None:
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a", "b"))
    (given_,) = stream.take(batch(1, "b", "c", "d"))
    assert (given_.first, texts([given_])) == (2, ["c", "d"])
    assert stream.take(batch(0, "a", "b", end=4)) == []


def test_what_the_vehicle_has_no_more_is_passed_over_and_counted() -> None:
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a"))
    stream.greet()
    piece = stream.question(1.0)
    assert texts(stream.take(batch(7, "h", oldest=7), asked=True)) == ["h"]
    assert (stream.missed, stream.closed(piece)) == (6, [])


def test_another_run_begins_anew_and_the_old_one_is_not_doubled() -> None:
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a", "b"))
    assert stream.take(batch(0, "x", run=2)) == []
    piece = stream.question(5.0 + GRACE_S) or stream.question(5.0 + 2 * GRACE_S)
    assert piece.first == 0
    assert texts(stream.take(batch(0, "x", run=2), asked=True)) == ["x"]
    stream.closed(piece)
    assert stream.take(batch(0, "a", "b")) == [], "late mail of the old run"
    assert texts(stream.take(batch(1, "y", run=2))) == ["y"]


def test_an_answer_of_another_run_is_no_beginning() -> None:
    """We ask from number 2 on, and a vehicle that was restarted meanwhile answers: its 0 and 1 are still missing."""
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a", "b"))
    stream.greet()
    piece = stream.question(1.0)
    assert piece.first == 2
    assert stream.take(batch(2, "z", run=2, end=3), asked=True) == []
    stream.closed(piece)
    again = stream.question(10.0) or stream.question(10.0 + GRACE_S)
    assert again.first == 0
    assert texts(stream.take(batch(0, "x", "y", run=2, end=3), asked=True)) == ["x", "y", "z"]


def test_where_nobody_answers_what_comes_by_itself_has_to_do() -> None:
    stream = Stream[LogBatch](None)
    now, given_ = 0.0, []
    stream.greet()
    for number in range(20):
        now += PATIENCE_S[1]
        given_ += texts(stream.take(batch(5 + number, str(number))))
        piece = stream.question(now)
        if piece is not None:
            given_ += texts(stream.closed(piece))
    assert given_ == [str(number) for number in range(20)]


def test_batches_of_nothing_are_not_kept() -> None:
    """Anybody may send them without end: they wait for nothing, and no bound on items would ever let them go."""
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a"))
    for number in range(5, 10_000):
        assert stream.take(batch(number, end=10_000)) == []
    assert len(stream._early) == 0
    piece = stream.question(10.0) or stream.question(10.0 + GRACE_S)
    assert piece.first == 1, "that there is more is believed"


def test_questions_in_vain_become_rare() -> None:
    stream = Stream[LogBatch](None)
    joined(stream, batch(0, "a", end=9))
    asked = []
    for tenth in range(36_000):
        piece = stream.question(tenth / 10)
        if piece is not None:
            asked.append(tenth / 10)
            stream.closed(piece)
    assert 50 <= len(asked) <= 80, "about one a minute in an hour"


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_nothing_is_lost_doubled_or_out_of_order(data: st.DataObject) -> None:
    """A vehicle that makes lines, a link that loses, doubles and delays what comes by itself, and answers in vain."""
    store = Lines(1, 1000)
    stream = Stream[LogBatch](None)
    made, given_, mail, now = 0, [], [], 0.0
    stream.greet()
    for _ in range(data.draw(st.integers(1, 40))):
        now += data.draw(st.sampled_from([0.1, 1.0, 10.0]))
        for _ in range(data.draw(st.integers(0, 3))):
            store.add(LogNotice("info", str(made)))
            made += 1
        match data.draw(st.sampled_from(["send", "deliver", "lose", "twice", "ask", "restart of the link"])):
            case "send" if store.is_behind:
                mail.append(store.batch(store.sent, data.draw(st.integers(1, 4))))
            case "deliver" if mail:
                given_ += stream.take(mail.pop(data.draw(st.integers(0, len(mail) - 1))))
            case "lose" if mail:
                mail.pop()
            case "twice" if mail:
                mail.append(mail[0])
            case "restart of the link":
                store.skip()
                stream.greet()
            case "ask":
                piece = stream.question(now)
                if piece is not None:
                    if data.draw(st.booleans()):
                        given_ += stream.take(store.batch(piece.first, min(piece.count, 3)), asked=True)
                    given_ += stream.closed(piece)
    for _ in range(200):
        stream.told(1, store.end)
        now += PATIENCE_S[1]
        piece = stream.question(now)
        if piece is not None:
            given_ += stream.take(store.batch(piece.first, piece.count), asked=True)
            given_ += stream.closed(piece)
    begun = next((int(each.items[0].text) for each in given_), made)
    assert texts(given_) == [str(number) for number in range(begun, made)]
    assert stream.missed == 0
