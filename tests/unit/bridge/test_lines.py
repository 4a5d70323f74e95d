"""Bytes into whole lines: none lost, none made up, nothing without bounds."""

import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.bridge.lines import LONGEST_LINE, LineSplitter

LINES = st.lists(
    st.text(st.characters(codec="latin-1", exclude_categories=["Cc", "Zs"]), min_size=1), max_size=8
)
ENDS = st.sampled_from([b"\n", b"\r", b"\r\n", b"\n\n"])


@settings(deadline=None, max_examples=60)
@given(LINES, ENDS, st.data())
def test_a_stream_may_be_cut_anywhere(lines: list[str], end: bytes, data: st.DataObject) -> None:
    """The truth is the list that the stream was made of; \\x85 and the like are no ends of lines."""
    stream = b"".join(line.encode("latin-1") + end for line in ["first", *lines])
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    splitter = LineSplitter(is_stream=True)
    found = []
    for begin, stop in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += splitter.add(stream[begin:stop])
    assert found == [line.strip() for line in lines if line.strip()]


def test_what_a_stream_begins_with_may_be_half_a_line() -> None:
    splitter = LineSplitter(is_stream=True)
    assert splitter.add(b"3.512\n33.513\n33.5") == ["33.513"]
    splitter.restart()
    assert splitter.add(b"14\n33.515\n") == ["33.515"]
    assert splitter.counters.fragments == 3


def test_a_datagram_is_whole_even_without_an_end() -> None:
    splitter = LineSplitter(is_stream=False)
    assert splitter.add(b"33.512") == ["33.512"]
    assert splitter.add(b"33.513\r\n33.514\r\n") == ["33.513", "33.514"]


@pytest.mark.parametrize("noise", [b"x" * 10_000, b"x" * (LONGEST_LINE + 1) + b"\n"])
def test_what_never_ends_is_given_up(noise: bytes) -> None:
    splitter = LineSplitter(is_stream=True)
    splitter.add(b"\n")
    for _ in range(100):
        assert splitter.add(noise) == []
    assert sys.getsizeof(splitter._tail) < 2 * LONGEST_LINE + 100
    assert splitter.counters.too_long >= 1
    assert splitter.add(b"rest\n33.5\n")[-1] == "33.5"


def test_seven_bits_and_even_parity_are_read_as_eight() -> None:
    sent = bytes(byte | (0x80 if byte.bit_count() % 2 else 0) for byte in b"33.512\r\n")
    assert LineSplitter(is_stream=False, data_bits=7).add(sent) == ["33.512"]
    assert LineSplitter(is_stream=False).add(sent) != ["33.512"]


@settings(deadline=None, max_examples=60)
@given(st.lists(st.binary(max_size=300)))
def test_whatever_comes_is_cut_into_lines(pieces: list[bytes]) -> None:
    splitter = LineSplitter(is_stream=True)
    for piece in pieces:
        for line in splitter.add(piece):
            assert 0 < len(line) <= LONGEST_LINE
            assert "\n" not in line
    assert splitter.counters.bytes_in == sum(map(len, pieces))
