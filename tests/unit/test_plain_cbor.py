"""CBOR from anybody: what it may cost is bounded before any of it is paid."""

import tracemalloc

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.plain_cbor import OBJECT_TAGS, CBORError, load

LIMITS = {"maximum_bytes": 2**24, "maximum_items": 1000, "maximum_depth": 5}
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary(),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=5), inner, max_size=5),
    max_leaves=20,
)


def depth_of(value: object) -> int:
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else None
    return 0 if inside is None else 1 + max(map(depth_of, inside), default=0)


@given(VALUES)
def test_what_is_within_the_bounds_comes_back(value: object) -> None:
    if depth_of(value) < 5:
        assert load(cbor2.dumps(value), **LIMITS) == value


@given(st.binary(max_size=200))
def test_any_bytes_are_a_value_or_an_error_of_ours(data: bytes) -> None:
    try:
        load(data, **LIMITS)
    except CBORError:
        return


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "is not CBOR"),
        (bytes(2**24 + 1), "must have at most 16777216 bytes"),
        (b"\x99\x03\xe8" + b"\x00" * 1000, "must have at most 1000 items"),
        (b"\x9a\x00\xff\xff\xff" + b"\x80" * 0xFFFFFF, "bytes"),
        (b"\x9b" + b"\xff" * 8, "ends before a list or a map does"),
        (b"\xbb" + b"\x7f" * 8 + b"\x00", "ends before a list or a map does"),
        (b"\x5b" + b"\x7f" * 8, "is not CBOR"),
        (b"\x9f\x00\xff", "not told in advance"),
        (b"\x5f\x41a\xff", "not told in advance"),
        (b"\x1c", "makes no sense"),
        (b"\x81" * 100 + b"\x01", "is not CBOR"),
        (b"\xa2\x61a\x00\x61a\x00", "is not CBOR"),
        (b"\xa1\x00\x00", "is not CBOR"),
        (b"\x62\xc3\x28", "is not CBOR"),
        (cbor2.dumps("x" * (2**20 + 1)), "a text must have at most 1048576 bytes"),
        *((cbor2.dumps(cbor2.CBORTag(tag, "1")), "is not CBOR") for tag in (0, 35, 37, 100)),
        *((cbor2.dumps(cbor2.CBORTag(tag, b"1")), "is not CBOR") for tag in (2, 3)),
    ],
)
def test_what_is_not_is_refused_with_the_reason(data: bytes, why: str) -> None:
    with pytest.raises(CBORError, match=why):
        load(data, **LIMITS)


def test_none_of_the_tags_becomes_an_object() -> None:
    for tag in OBJECT_TAGS:
        head = b"\xd9" + tag.to_bytes(2, "big")
        for content in (b"\x01", b"\x61a", b"\x41a", b"\x82\x01\x02", b"\xa0"):
            with pytest.raises(CBORError):
                load(head + content, **LIMITS)
    assert load(cbor2.dumps(cbor2.CBORTag(86, b"12345678")), **LIMITS) == cbor2.CBORTag(86, b"12345678")


def test_a_byte_does_not_become_a_list() -> None:
    """Fourteen megabytes of empty lists are a gigabyte of memory, if anybody makes them."""
    count = 14 * 2**20
    bomb = b"\x9a" + count.to_bytes(4, "big") + b"\x80" * count
    tracemalloc.start()
    try:
        with pytest.raises(CBORError, match="items"):
            load(bomb, maximum_bytes=2**24, maximum_items=200_000, maximum_depth=5)
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()
