"""What a line says, in each of the three shapes; and that nothing hangs the bridge."""

import functools
import math
import operator
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.bridge.lines import LONGEST_LINE
from autonomy.bridge.patterns import (
    Columns,
    LineError,
    OtherSentenceError,
    Pattern,
    PatternError,
    Reader,
    Sentence,
    number,
    written_out,
)

SBE45 = Pattern(r"t1=\s*(?P<t>-?\d+\.\d{4}),\s*c1=\s*(?P<c>-?\d+\.\d{5}),\s*s1=\s*(?P<s>-?\d+\.\d{4})")
TEXT = st.text(st.characters(codec="latin-1"), max_size=80)


def sentence(body: str) -> str:
    """With its checksum, as the standard has it: the exclusive or of what is between $ and *."""
    return f"${body}*{functools.reduce(operator.xor, body.encode()):02X}"


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.text(st.characters(codec="ascii", exclude_characters=", \t\r\n\x0b\x0c"), max_size=6), min_size=1
    )
)
def test_columns_are_what_stands_between_separators(parts: list[str]) -> None:
    found = Columns(",", len(parts)).read(" , ".join(parts))
    assert found == {place: part.strip() for place, part in enumerate(parts, start=1)}


def test_a_separator_of_space_is_any_amount_of_it() -> None:
    assert Columns(" ", 3).read("  1.0\t 2.0   3.0") == {1: "1.0", 2: "2.0", 3: "3.0"}


@pytest.mark.parametrize("line", ["17.1, 4.2, 1.0", "17.1, 4.2, 1.0, 33.5, 9", ""])
def test_another_number_of_columns_is_no_whole_line(line: str) -> None:
    with pytest.raises(LineError, match="not 4 columns"):
        Columns(",", 4).read(line)


def test_a_thermosalinographs_line() -> None:
    found = SBE45.read("t1= 23.7658, c1= 0.00019, s1= 0.0084")
    assert found == {"t": "23.7658", "c": "0.00019", "s": "0.0084"}


@pytest.mark.parametrize(
    "line",
    ["t1= 23.7658, c1= 0.00019, s1= 0.00", "23.7658, c1= 0.00019, s1= 0.0084", "t1= 23.7658, c1= 0.0001"],
)
def test_all_of_a_line_must_match(line: str) -> None:
    with pytest.raises(LineError, match="does not match"):
        SBE45.read(line)


@pytest.mark.parametrize(
    ("pattern", "why"),
    [
        ("(?P<t>x", "not a regular expression"),
        (r"\d+", "no named groups"),
        # Each of them would take seconds and gigabytes to compile, some all that there is.
        (r"(?P<t>-?\d+\.\d{444444444})", "more than 200000 characters"),
        (r"(?P<t>\d{400000,})", "more than 200000 characters"),
        (r"(?P<t>(?:(?:a{1000}){1000}){1000})", "more than 200000 characters"),
        ("(?P<t>" + "(?:" * 90 + "a" + "){2}" * 90 + ")", "more than 200000 characters"),
        ("(?x)(?P<t>a{40#}\n0 0 0 0 0})", "more than 200000 characters"),
        ("(?P<t>" + "(" * 400 + ")" * 400 + ")", "nested too deeply"),
    ],
)
def test_patterns_that_can_not_be_used_say_why(pattern: str, why: str) -> None:
    with pytest.raises(PatternError, match=why):
        Pattern(pattern)


@pytest.mark.parametrize(
    ("pattern", "characters"),
    [(r"(?P<s>\d{4})", 16), (r"(?:[^,]*,){12}(?P<s>\d+)(?:,\w*){3}", 35 * 36), (r"(?P<s>\p{Nd}{2,4})", 23)],
)
def test_what_instruments_need_is_far_below_the_limit(pattern: str, characters: int) -> None:
    """The pattern's length and all counts, times those of groups."""
    assert written_out(pattern) == characters
    Pattern(pattern)


@pytest.mark.parametrize(
    ("pattern", "line"),
    [
        (r"(?P<a>(\w+\s?)+)!", "word " * (LONGEST_LINE // 5)),
        (r"(?P<a>(?:\d|\d\d|\w)+)[.!]", "1" * (LONGEST_LINE - 1) + "?"),
        (r"(?P<a>.*.*.*.*.*)[12]=[34]", "=" * LONGEST_LINE),
    ],
)
def test_no_pattern_can_hang_the_bridge(pattern: str, line: str) -> None:
    """CPU time, so that a busy machine does not matter; Python's own `re` takes hours and days for these."""
    reader, begun = Pattern(pattern), time.process_time()
    with pytest.raises(LineError):
        reader.read(line)
    assert time.process_time() - begun < 1.0


@pytest.mark.parametrize("wanted", ["GLL", "GPGLL"])
def test_a_sentence_of_any_talker_or_of_one(wanted: str) -> None:
    """One that is in print everywhere, with the checksum that it has there."""
    found = Sentence(wanted, checksum_required=True).read("$GPGLL,4916.45,N,12311.12,W,225444,A*31")
    assert found == {1: "4916.45", 2: "N", 3: "12311.12", 4: "W", 5: "225444", 6: "A"}


def test_a_proprietary_sentence() -> None:
    assert Sentence("PSBE21", checksum_required=True).read(sentence("PSBE21,17.1,33.5"))[2] == "33.5"


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (sentence("YXMTW,17.75,C")[:-2] + "00", "wrong checksum"),
        ("$YXMTW,17.75,C", "no checksum"),
        (sentence("YXMTW,17.75,C")[1:], "no NMEA sentence"),
        (sentence("YXMTW,17.75,C")[:-1], "no NMEA sentence"),
        ("$YXMT", "another sentence"),
        ("$GPGLL,4916.45,N,12311.12,W,225444,A*31", "another sentence"),
    ],
)
def test_sentences_that_are_not_read(line: str, why: str) -> None:
    with pytest.raises(LineError, match=why) as caught:
        Sentence("MTW", checksum_required=True).read(line)
    assert isinstance(caught.value, OtherSentenceError) == (why == "another sentence")


def test_a_checksum_may_be_missing_but_not_be_wrong() -> None:
    reader = Sentence("MTW", checksum_required=False)
    assert reader.read("$YXMTW,17.75,C")[1] == "17.75"
    with pytest.raises(LineError, match="wrong checksum"):
        reader.read("$YXMTW,17.75,C*00")


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.text("0123456789.ABC", max_size=8), min_size=1, max_size=8),
    st.integers(0, 400),
    st.integers(1, 127),
)
def test_no_flipped_character_gets_past_a_checksum(parts: list[str], place: int, flip: int) -> None:
    good = sentence(",".join(["YXMTW", *parts]))
    place %= len(good)
    bad = good[:place] + chr(ord(good[place]) ^ flip) + good[place + 1 :]
    if bad.upper() == good:  # hexadecimal digits may be small
        return
    with pytest.raises(LineError):
        Sentence("MTW", checksum_required=True).read(bad)


@settings(deadline=None, max_examples=60)
@given(st.floats(-1e30, 1e30))
def test_numbers_are_read_as_python_writes_them(value: float) -> None:
    assert number(repr(value)) == value
    assert number(repr(value).replace(".", ","), ",") == value


@pytest.mark.parametrize(
    "text", ["", "nan", "inf", "-", ".", "1_0", "0x1", "١", "1e", "1.2.3", "1,2", "4e38", "1e999"]
)
def test_what_is_no_number(text: str) -> None:
    with pytest.raises(LineError):
        number(text)


@pytest.mark.parametrize("text", ["1.5", "1.000,5"])
def test_with_a_decimal_comma_a_point_is_none(text: str) -> None:
    with pytest.raises(LineError):
        number(text, ",")


@pytest.mark.parametrize(
    "reader",
    [Columns(",", 3), Columns(" ", 2), SBE45, Sentence("MTW", checksum_required=False)],
    ids=["commas", "spaces", "pattern", "sentence"],
)
@settings(deadline=None, max_examples=60)
@given(line=TEXT)
def test_garbage_is_read_as_text_or_refused(reader: Reader, line: str) -> None:
    try:
        fields = reader.read(line)
    except LineError:
        return
    for text in fields.values():
        try:
            assert math.isfinite(number(text))
        except LineError:
            continue
