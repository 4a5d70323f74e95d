"""The frames of a journal: whatever happens to a file, exactly the records that were hit are lost."""

import io

from hypothesis import example, given
from hypothesis import strategies as st

from autonomy.frames import MARKER, OVERHEAD_BYTES, Damage, Frame, pack, scan

payloads = st.lists(
    st.one_of(st.binary(max_size=60), st.binary(max_size=20).map(lambda tail: MARKER + tail)),
    min_size=1,
    max_size=12,
)


def file_of(records: list[bytes]) -> bytes:
    content = b""
    for number, payload in enumerate(records, 1):
        content += pack(len(content), number, payload)
    return content


def spans(records: list[bytes]) -> list[tuple[int, int]]:
    """Where each record lies in its file."""
    found, offset = [], 0
    for payload in records:
        found.append((offset, offset + OVERHEAD_BYTES + len(payload)))
        offset = found[-1][1]
    return found


def read(content: bytes) -> list[Frame | Damage]:
    return list(scan(io.BytesIO(content)))


def frames(content: bytes) -> dict[int, bytes]:
    return {part.sequence: part.payload for part in read(content) if isinstance(part, Frame)}


@given(payloads)
def test_what_is_written_is_read(records: list[bytes]) -> None:
    assert frames(file_of(records)) == dict(enumerate(records, 1))


@given(payloads, st.data())
def test_truncated_anywhere_all_whole_records_are_read(records: list[bytes], data: st.DataObject) -> None:
    content = file_of(records)
    cut = data.draw(st.integers(0, len(content)))
    whole = [number for number, (_, end) in enumerate(spans(records), 1) if end <= cut]
    found = read(content[:cut])
    assert [part.sequence for part in found if isinstance(part, Frame)] == whole
    sound = spans(records)[len(whole) - 1][1] if whole else 0
    torn = [part for part in found if isinstance(part, Damage)]
    assert torn == ([Damage(sound, cut, torn=True)] if cut > sound else [])


@given(payloads, st.data())
def test_any_flipped_bits_cost_the_records_they_are_in(records: list[bytes], data: st.DataObject) -> None:
    content = bytearray(file_of(records))
    bits = data.draw(st.sets(st.integers(0, 8 * len(content) - 1), min_size=1, max_size=4))
    for bit in bits:
        content[bit // 8] ^= 1 << bit % 8
    hit = [any(start <= bit // 8 < end for bit in bits) for start, end in spans(records)]
    found = read(bytes(content))
    sound = {part.sequence: part.payload for part in found if isinstance(part, Frame)}
    assert sound == {n: payload for n, payload in enumerate(records, 1) if not hit[n - 1]}
    # And the place of each is told: every byte that was flipped lies in what is called damaged.
    damaged = [part for part in found if isinstance(part, Damage)]
    assert all(any(part.offset <= bit // 8 < part.end for part in damaged) for bit in bits)


@given(payloads, st.data())
def test_a_missing_piece_costs_the_records_it_was_in_and_those_moved(
    records: list[bytes], data: st.DataObject
) -> None:
    """Frames know their place: what a hole has moved is not trusted, and nothing false is read."""
    content = file_of(records)
    start = data.draw(st.integers(0, len(content)))
    end = data.draw(st.integers(start, len(content)))
    sound = frames(content[:start] + content[end:])
    assert all(records[number - 1] == payload for number, payload in sound.items())


@given(st.binary(max_size=300), st.lists(st.just(MARKER), max_size=8))
@example(MARKER * 40, [])
def test_any_bytes_are_read_without_an_error(noise: bytes, markers: list[bytes]) -> None:
    content = noise + b"".join(marker + noise for marker in markers)
    parts = read(content)
    assert all(isinstance(part, Damage) for part in parts)
    assert sum(part.end - part.offset for part in parts if isinstance(part, Damage)) == len(content)


def test_a_frame_quoted_in_a_damaged_record_is_not_taken_for_one() -> None:
    """A vehicle may send any bytes, a journal among them."""
    quoted = pack(0, 77, b"never happened")
    content = bytearray(file_of([b"first", quoted, b"last"]))
    content[spans([b"first", quoted])[1][0]] ^= 1
    assert frames(bytes(content)) == {1: b"first", 3: b"last"}


def test_a_file_of_false_beginnings_is_given_up_in_bounded_work() -> None:
    """Each of these claims a megabyte: checked one by one they would be hundreds of gigabytes."""
    fake = MARKER + (2**20).to_bytes(4, "big") + bytes(12)
    content = fake * (2**21 // len(fake))
    reads = CountingFile(content)
    parts = list(scan(reads))
    assert [type(part) for part in parts] == [Damage]
    assert reads.total <= 20 * len(content) + 100 * 2**20


class CountingFile(io.BytesIO):
    """Counts the bytes that are read."""

    total = 0

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        self.total += len(data)
        return data
