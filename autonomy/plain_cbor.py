"""CBOR from anybody: what reading it may cost is bounded, and its tags make no objects."""

from typing import Any, NoReturn

import cbor2

OBJECT_TAGS = (*range(6), 25, 28, 29, 30, 35, 36, 37, 52, 54, 100, 256, 258, 260, 261, 1004, 43000, 55799)
"""Every tag that cbor2 would turn into an object of its own: dates, regular expressions, shared references …"""

_LONGEST_TEXT_BYTES = 2**20
_BYTES, _TEXT, _LIST, _MAP = 2, 3, 4, 5


class CBORError(ValueError):
    """Bytes that are not CBOR, or cost more to read than they may; says why."""


def load(data: bytes, *, maximum_bytes: int, maximum_items: int, maximum_depth: int) -> Any:
    """The value in `data`; tags stay tags, and what hangs below one comes as tuples.

    Args:
        data: may come from anybody.
        maximum_bytes: of it.
        maximum_items: numbers, texts, lists, … in it, each of which takes up to a hundred bytes of memory, though
            one byte of `data` may be enough for it.
        maximum_depth: of lists and maps in each other.

    Raises:
        CBORError: it is anything else, has a length that is not told in advance, a key twice, a key that is no text
            or bytes, a text of more than a megabyte, or one of `OBJECT_TAGS`.
    """
    if len(data) > maximum_bytes:
        raise CBORError(f"must have at most {maximum_bytes} bytes (got {len(data)})")
    check_items(data, maximum_items)
    try:
        return cbor2.loads(
            data,
            semantic_decoders=_REFUSED,
            max_depth=maximum_depth,
            allow_indefinite=False,
            allow_duplicate_keys=False,
            strict_hashable_types=True,
        )
    except (cbor2.CBORDecodeError, ValueError, TypeError, OverflowError, MemoryError) as error:
        raise CBORError(f"is not CBOR: {error}") from None


def _refuse(*_decoder: Any) -> NoReturn:
    raise ValueError("this tag has no place here")


_REFUSED = dict.fromkeys(OBJECT_TAGS, _refuse)


def check_items(data: bytes, maximum: int) -> None:
    """See that there are at most so many items in it, and no text too long. CBORError otherwise.

    It walks from head to head (RFC 8949, section 3), which costs nothing but the time; text and bytes are skipped.
    """
    position, size, items = 0, len(data), 0
    while position < size:
        items += 1
        if items > maximum:
            raise CBORError(f"must have at most {maximum} items")
        kind, count = data[position] >> 5, data[position] & 31
        position += 1
        if count >= 24:
            if count > 27:
                raise CBORError("is not CBOR: a length is not told in advance, or makes no sense")
            width = 1 << (count - 24)
            count = int.from_bytes(data[position : position + width], "big")
            position += width
        if kind in (_BYTES, _TEXT):
            if kind == _TEXT and count > _LONGEST_TEXT_BYTES:
                # As text a byte may become four.
                raise CBORError(f"a text must have at most {_LONGEST_TEXT_BYTES} bytes (got {count})")
            position += count
        elif kind in (_LIST, _MAP) and count > size - position:
            raise CBORError("is not CBOR: it ends before a list or a map does")
