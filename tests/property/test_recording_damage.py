"""Whatever happens to a recording's files, what is read again is what arrived, in order, without what was touched."""

from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.shore.recording import Limits, Recorded, Recorder, RecordingError, read_recording

payloads = st.lists(st.binary(max_size=400), min_size=1, max_size=30)
# Where in a file (as a share of it), how many bytes, and what stands there instead.
damages = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 60), st.binary(max_size=60)), min_size=1, max_size=5
)


def is_subsequence(part: list[Recorded], whole: list[Recorded]) -> bool:
    rest = iter(whole)
    return all(any(each == one for one in rest) for each in part)


@settings(max_examples=60, deadline=None)
@given(payloads, damages)
def test_damage_only_takes_away(contents: list[bytes], hits: list[tuple[float, int, bytes]]) -> None:
    arrived = [Recorded(float(i), f"usv/boat{i % 3}/log", "x", content) for i, content in enumerate(contents)]
    with TemporaryDirectory() as name:
        folder = Path(name)
        with Recorder(folder, Limits(file_bytes=2000)) as recorder:
            for one in arrived:
                recorder.write(one.received_utc_s, one.key, one.encoding, one.payload)
        files = sorted(folder.glob("*.recording"))
        for share, length, instead in hits:
            path = files[min(int(share * len(files)), len(files) - 1)]
            data = path.read_bytes()
            place = int((share * len(files)) % 1.0 * len(data))
            path.write_bytes(data[:place] + instead + data[place + length :])
        regrets: list[str] = []
        try:
            left = list(read_recording(folder, regret=regrets.append))
        except RecordingError:
            raise AssertionError("damage never looks like another version: headers have checksums") from None
        assert is_subsequence(left, arrived)
        # And the recorder goes on behind it.
        with Recorder(folder) as recorder:
            recorder.write(1e9, "usv/boat1/log", "x", b"after")
        assert list(read_recording(folder, regret=regrets.append))[-1].payload == b"after"
        assert is_subsequence(list(read_recording(folder, regret=regrets.append))[:-1], arrived)
