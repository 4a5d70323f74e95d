"""The recording of lines: complete, rotated, bounded; and read again."""

import json
import time
from pathlib import Path

import pytest

from autonomy.bridge.raw_log import RawLog, timestamp
from autonomy.bridge.recorded import Recorded, RecordingError, read_recorded

HEADER = {"bridge": "0.1", "configuration": {}}


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.ndjson"))


def test_what_is_recorded_can_be_played(tmp_path: Path) -> None:
    raw = RawLog(tmp_path, HEADER, 1e6, 1e7)
    lines = ["33.5, 1", "gärbage \x00\x85", '{"a": 1}', "33.6, 1"]
    for k, line in enumerate(lines):
        raw.add({"utc": timestamp(1e9 + k), "host_s": 50.0 + 0.25 * k, "line": line})
    raw.close()
    (file,) = files(tmp_path)
    assert list(read_recorded(file)) == [Recorded(0.25 if k else 0.0, line) for k, line in enumerate(lines)]
    assert json.loads(file.read_text().split("\n")[1])["utc"] == "2001-09-09T01:46:40.000Z"


def test_the_oldest_files_go_and_every_file_says_what_it_is(tmp_path: Path) -> None:
    raw = RawLog(tmp_path, HEADER, 2000, 10_000)
    for k in range(2000):
        raw.add({"host_s": float(k), "line": f"{k:020d}"})
    raw.close()
    assert raw.dropped == 0
    assert 4 <= len(files(tmp_path)) <= 6
    assert sum(each.stat().st_size for each in files(tmp_path)) < 12_000
    kept = [int(each.line) for file in files(tmp_path) for each in read_recorded(file)]
    assert kept == list(range(kept[0], 2000))


def test_another_run_goes_on_in_another_file(tmp_path: Path) -> None:
    for _ in range(3):
        RawLog(tmp_path, HEADER, 1e6, 1e7).close()
    assert [each.name[:10] for each in files(tmp_path)] == ["raw-000001", "raw-000002", "raw-000003"]


def test_many_short_runs_are_bounded_too(tmp_path: Path) -> None:
    for _ in range(20):
        raw = RawLog(tmp_path, HEADER, 2000, 5000)
        for k in range(10):
            raw.add({"host_s": float(k), "line": "x" * 80})
        raw.close()
    assert sum(each.stat().st_size for each in files(tmp_path)) < 7000


def test_a_folder_that_can_not_be_written_costs_lines_only_for_so_long(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The folder becomes a file, and a folder again."""
    caplog.set_level("INFO")
    folder, elsewhere = tmp_path / "raw", tmp_path / "elsewhere"
    raw = RawLog(folder, HEADER, 200, 1e4)

    def add(count: int) -> None:
        for k in range(count):
            raw.add({"host_s": float(k), "line": "x" * 50})

    folder.rename(elsewhere)
    folder.touch()
    add(20)
    deadline = time.monotonic() + 60.0
    while not raw.dropped:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    folder.unlink()
    add(20)
    raw.close()
    assert 0 < raw.dropped < 40
    assert files(folder)
    told = [each.message for each in caplog.records if "recorded" in each.message]
    assert told[0].startswith("lines are not recorded: ")
    assert told[-1] == "lines are recorded again"


def test_any_text_is_played_a_line_a_second_or_as_it_is_told(tmp_path: Path) -> None:
    file = tmp_path / "captured.txt"
    file.write_bytes(b"33.5, 1\r\n\r\n33.6, \xb0\r\n")
    assert list(read_recorded(file)) == [Recorded(1.0, "33.5, 1"), Recorded(1.0, "33.6, °")]
    assert [each.pause_s for each in read_recorded(file, 0.05)] == [0.05, 0.05]


@pytest.mark.parametrize("entry", ["{", "[]", '{"line": "x"}', '{"host_s": "1", "line": "x"}', "[" * 100_000])
def test_a_recording_that_is_damaged_says_where(tmp_path: Path, entry: str) -> None:
    file = tmp_path / "raw.ndjson"
    file.write_text(json.dumps(HEADER) + '\n{"host_s": 1.0, "line": "x"}\n' + entry + "\n")
    played = read_recorded(file)
    assert next(played).line == "x"
    with pytest.raises(RecordingError, match="line 3"):
        next(played)
