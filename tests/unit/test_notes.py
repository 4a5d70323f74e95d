"""What the autopilot writes to its operator, in our log."""

from autonomy.mavlink.vehicle import StatusText
from autonomy.notes import AutopilotWords, Note


def test_what_the_autopilot_says_is_told_with_its_weight():
    said = [StatusText(severity, f"line {severity}") for severity in range(8)]
    notes = AutopilotWords().notes(100.0, said)
    assert notes == [Note(f"autopilot: line {severity}", severity <= 4) for severity in range(8)]


def test_letters_that_would_break_a_line_of_the_log_do_not():
    (note,) = AutopilotWords().notes(100.0, [StatusText(6, "two\nlines\x1b[31m ")])
    assert note.text == "autopilot: two?lines?[31m"
    assert AutopilotWords().notes(100.0, [StatusText(6, "  ")]) == []


def test_the_same_line_is_told_once_a_minute():
    words = AutopilotWords()
    told = [now for now in range(180) if words.notes(float(now), [StatusText(2, "PreArm: compass")])]
    assert told == [0, 60, 120]


def test_an_autopilot_that_talks_without_end_is_cut_short():
    words = AutopilotWords()
    notes = [
        note for number in range(6000) for note in words.notes(number * 0.01, [StatusText(6, f"x {number}")])
    ]
    assert len(notes) == 20
    assert words.notes(61.0, [StatusText(6, "later")]) == [
        Note("autopilot: 5980 more lines were not shown", is_warning=True),
        Note("autopilot: later"),
    ]
