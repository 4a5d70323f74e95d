"""The journal's writer: what is written can be read, is bounded, survives a bad disk, and nothing is lost silently."""

import errno
import os
import shutil
import threading
from pathlib import Path
from typing import Any

import pytest
import shapely
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration, JournalSection
from autonomy.effects import Level, Log
from autonomy.events import DeadlineReached, JobFailed, LinkDown, MessageReceived
from autonomy.geometry import LocalFrame
from autonomy.mavlink.codec import Codec
from autonomy.planning.survey import SurveyArea
from autonomy.records import Happened, encode_event
from autonomy.shell.journal import Journal, make_header, open_journal
from autonomy.shell.journal_files import (
    Entry,
    JournalError,
    Position,
    Trouble,
    journal_files,
    read_entries,
    read_from,
    read_header,
)
from autonomy.shell.journal_room import RETRY_S
from autonomy.shell.journal_store import Limits, Packet, Row, Store, cut_torn_tail

LARGE = Limits(file_bytes=10**9, file_age_s=1e9, total_bytes=10**10)
FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    area = [(33.9, -118.9), (33.9, -118.8), (34.0, -118.8), (34.0, -118.9)]
    return Configuration.model_validate({"survey": {"area": area}, "vehicle": {"name": "tester"}})


@pytest.fixture(scope="module")
def header(configuration: Configuration) -> dict[str, Any]:
    survey = SurveyArea.from_geometry(LocalFrame(33.95, -118.85), shapely.box(0, 0, 1000, 1000))
    return make_header(configuration, survey, now=5.0, utc_s=1.7e9)


def row(number: int, size: int = 0) -> Row:
    return Row(number, encode_event(float(number), LinkDown("x" * size)))


def numbers(folder: Path, run: int = 1) -> list[int]:
    """The numbers of a run's sound records."""
    parts = read_entries(folder, Position(run, 0), run)
    return [part.position.sequence for part in parts if isinstance(part, Entry)]


def troubles(folder: Path) -> list[str]:
    return [part.text for part in read_entries(folder, Position(1, 0)) if isinstance(part, Trouble)]


def heartbeat() -> MessageReceived:
    packet = Codec(7, 1).encode(mavlink.MAVLink_heartbeat_message(11, 3, 81, 4, 4, 3))
    return MessageReceived(Codec(7, 191).decode(packet)[0])


class Disk:
    """`os.write` on a disk with room for so many bytes; files that are removed or cut give theirs back."""

    def __init__(self, folder: Path, room: int) -> None:
        self.folder, self.room = folder, room
        self.error: OSError | None = None

    def write(self, descriptor: int, data: bytes) -> int:
        if self.error is not None:
            raise self.error
        if self.free <= 0:
            raise FULL
        return os.write(descriptor, data[: self.free])

    @property
    def free(self) -> int:
        return self.room - sum(path.stat().st_size for path in self.folder.iterdir())


# Writing and reading again -----------------------------------------------------------------------------------


def test_events_come_back_as_they_were(tmp_path: Path, configuration, header) -> None:
    journal = Journal.open(tmp_path, configuration.journal, header)
    message = heartbeat()
    events = [message, DeadlineReached(), LinkDown("gone: ü"), JobFailed(3, "killed")]
    for now, event in enumerate(events):
        journal.event(now + 0.25, event)
        journal.effects([Log(Level.INFO, "a line")] if now == 1 else [])
    assert journal.position == Position(1, 5)
    journal.close()
    back = list(read_from(tmp_path, Position(1, 0)))
    assert [record.now for record in back] == [0.25, 1.25, 2.25, 3.25]
    assert [record.position for record in back] == [Position(1, n) for n in (1, 2, 4, 5)]
    assert [record.event for record in back[1:]] == events[1:]
    assert back[0].event.message.to_dict() == message.message.to_dict()
    assert back[0].event.message.get_srcSystem() == 7


def test_reading_goes_on_from_any_position(tmp_path: Path, header) -> None:
    store = Store(tmp_path, Limits(400, 1e9, 10**9), header)
    for number in range(1, 41):
        store.write([row(number)])
    store.close()
    store = Store(tmp_path, LARGE, header)
    store.write([row(1), row(2)])
    store.close()
    assert len(journal_files(tmp_path)) > 5
    everything = [(1, n) for n in range(1, 41)] + [(2, 1), (2, 2)]
    for after in (0, 1, 17, 39, 40):
        found = [
            (each.position.run, each.position.sequence) for each in read_from(tmp_path, Position(1, after))
        ]
        assert found == everything[after:]
    assert [each.position for each in read_from(tmp_path, Position(2, 1))] == [Position(2, 2)]


def test_the_header_says_what_a_replay_needs(tmp_path: Path, configuration, header) -> None:
    Journal.open(tmp_path, configuration.journal, header).close()
    journal = Journal.open(tmp_path, configuration.journal, header)
    journal.event(0.0, DeadlineReached())
    journal.close()
    found = read_header(journal_files(tmp_path)[-1].path)
    assert (found["schema"], found["version"], found["seed"]) == ("halocline/journal", 1, 0)
    assert (found["run"], found["file"], found["first_record"], found["resumed"]) == (1, 1, 1, None)
    assert Configuration.model_validate(found["configuration"]) == configuration


def test_the_stream_is_one_that_ground_stations_read(tmp_path: Path, configuration, header) -> None:
    times = iter([1.7e9, 1.7e9 + 1.5, 1.7e9 + 2.0])
    journal = Journal.open(tmp_path, configuration.journal, header, utc_s=lambda: next(times))
    journal.event(0.0, heartbeat())
    journal.sent(Codec(7, 191).encode(mavlink.MAVLink_mission_count_message(7, 1, 12, 0)))
    journal.event(0.5, heartbeat())
    journal.close()
    recording = mavutil.mavlink_connection(str(journal_files(tmp_path)[0].stream))
    found = []
    while (message := recording.recv_msg()) is not None:
        found.append((message.get_type(), message.get_srcComponent(), message._timestamp))
    recording.close()
    assert [kind for kind, *_ in found] == ["HEARTBEAT", "MISSION_COUNT", "HEARTBEAT"]
    assert [component for _, component, _ in found] == [1, 191, 1]
    assert [stamp for *_, stamp in found] == pytest.approx([1.7e9, 1.7e9 + 1.5, 1.7e9 + 2.0])


# Files and their bounds --------------------------------------------------------------------------------------


def test_files_are_begun_anew_by_size_and_by_age(tmp_path: Path, header) -> None:
    clock = [0.0]
    header_bytes = 3000
    store = Store(tmp_path, Limits(header_bytes + 5000, 60.0, 10**9), header, clock=lambda: clock[0])
    for number in range(1, 21):
        store.write([row(number, 900)])
    by_size = len(journal_files(tmp_path))
    assert by_size >= 3
    clock[0] = 61.0
    store.write([row(21), Packet(0, b"abc")])
    store.close()
    files = journal_files(tmp_path)
    assert len(files) == by_size + 1
    assert all(file.path.stat().st_size <= header_bytes + 5000 + 1000 for file in files)
    assert files[-1].stream.read_bytes() == bytes(8) + b"abc"
    assert [file.number for file in files] == list(range(1, len(files) + 1))
    assert numbers(tmp_path) == list(range(1, 22))


def test_all_files_together_stay_below_the_bound(tmp_path: Path, header) -> None:
    """The runs before count too, and the streams."""
    bound = 60_000
    for run in range(1, 4):
        store = Store(tmp_path, Limits(10_000, 1e9, bound), header)
        for number in range(1, 61):
            store.write([row(number, 500), Packet(number, bytes(300))])
            used = sum(path.stat().st_size for path in tmp_path.iterdir())
            assert used == store.total_bytes <= bound
        store.close()
        assert numbers(tmp_path, run)[-1] == 60
    assert {file.run for file in journal_files(tmp_path)} < {2, 3}
    # What is left ends where it ended, and says what is missing before.
    assert numbers(tmp_path, 3) == list(range(61 - len(numbers(tmp_path, 3)), 61))


def test_a_second_writer_is_refused(tmp_path: Path, configuration, header) -> None:
    store = Store(tmp_path, LARGE, header)
    with pytest.raises(BlockingIOError):
        Store(tmp_path, LARGE, header)
    store.close()
    Store(tmp_path, LARGE, header).close()


# Torn and damaged --------------------------------------------------------------------------------------------


def test_a_torn_tail_is_cut_when_the_next_run_begins(tmp_path: Path, header) -> None:
    store = Store(tmp_path, LARGE, header)
    store.write([row(1), row(2), row(3)])
    store.close()
    path = journal_files(tmp_path)[0].path
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    Store(tmp_path, LARGE, header).close()
    assert numbers(tmp_path) == [1, 2]
    assert troubles(tmp_path) == []
    assert path.stat().st_size < len(whole) - 5
    assert cut_torn_tail(path) == 0


def test_two_runs_have_records_of_the_same_numbers(tmp_path: Path, header) -> None:
    """In several files each: what comes before a position in its own run does not in another."""
    for run in (1, 2):
        store = Store(tmp_path, Limits(file_bytes=600, file_age_s=1e9, total_bytes=10**9), header)
        for number in range(1, 13):
            store.write([row(number)])
        store.close()
        assert len([file for file in journal_files(tmp_path) if file.run == run]) > 2
    everything = [Position(run, number) for run in (1, 2) for number in range(1, 13)]
    for at in (Position(1, 0), *everything):
        parts = list(read_entries(tmp_path, at))
        assert [part.position for part in parts if isinstance(part, Entry)] == [
            each for each in everything if each > at
        ]


@pytest.mark.parametrize("makes", [os.mkfifo, os.mkdir])
@pytest.mark.parametrize("suffix", [".journal", ".tlog"])
def test_what_is_no_file_is_neither_read_nor_written(tmp_path: Path, header, makes, suffix: str) -> None:
    journal = Journal.open(tmp_path, JournalSection(), header)
    journal.event(1.0, LinkDown("one"))
    journal.close()
    makes(tmp_path / f"run000002-0001{suffix}")
    journal = Journal.open(tmp_path, JournalSection(), header)
    assert journal.position == Position(3, 0)
    journal.event(2.0, LinkDown("two"))
    journal.close()
    reasons = [each.event.reason for each in read_from(tmp_path, Position(1, 0))]
    assert reasons == ["one", "two"]


def test_damage_in_the_middle_is_told_with_file_and_place(tmp_path: Path, header) -> None:
    store = Store(tmp_path, LARGE, header)
    store.write([row(number) for number in range(1, 6)])
    store.close()
    path = journal_files(tmp_path)[0].path
    content = bytearray(path.read_bytes())
    place = content.rindex(encode_event(3.0, LinkDown("")))
    content[place] ^= 0x10
    path.write_bytes(content)
    assert cut_torn_tail(path) == 0
    assert numbers(tmp_path) == [1, 2, 4, 5]
    damaged, gap = troubles(tmp_path)
    assert damaged.startswith(f"{path} bytes {place - 20} to ")
    assert gap.endswith("1 records before it are missing")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is no journal"),
        (b"PK\x03\x04 something else entirely", "is no journal"),
    ],
)
def test_other_files_are_no_journal(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "run000001-0001.journal"
    path.write_bytes(content)
    with pytest.raises(JournalError, match=said):
        read_header(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"version": 2}, "is of a newer version, 2; this software reads 1"),
        ({"version": 0}, "is of another version, 0; this software reads 1"),
        ({"schema": "somebody/else"}, "is no journal of this software: its schema is 'somebody/else'"),
    ],
)
def test_newer_and_foreign_journals_are_refused(
    tmp_path: Path, header, change: dict[str, Any], said: str
) -> None:
    store = Store(tmp_path, LARGE, {**header, **change})
    store.write([row(1)])
    store.close()
    with pytest.raises(JournalError, match=said):
        read_header(journal_files(tmp_path)[0].path)
    with pytest.raises(JournalError, match=said):
        list(read_from(tmp_path, Position(1, 0)))


# A disk that fails -------------------------------------------------------------------------------------------


def test_a_full_disk_costs_the_oldest_files(tmp_path: Path, header) -> None:
    disk = Disk(tmp_path, 40_000)
    store = Store(tmp_path, Limits(8000, 1e9, 10**9), header, write=disk.write)
    seen = set()
    for number in range(1, 201):
        store.write([row(number, 500), Packet(number, bytes(100))])
        seen.add(store.trouble)
    assert seen == {"", "the disk is full: the oldest files are given up"}
    assert (store.lost_records, store.lost_packets) == (0, 0)
    store.close()
    kept = numbers(tmp_path)
    assert kept == list(range(kept[0], 201))
    assert len(kept) > 20
    assert [text for text in troubles(tmp_path) if "damaged" in text] == []


@pytest.mark.parametrize("room_is_minded", [False, True])
def test_a_full_disk_is_told_until_a_file_was_filled_without_giving_one_up(
    tmp_path: Path, header, room_is_minded: bool
) -> None:
    """Health does not say at each new file that all is well, and the log not that runs are recorded again."""
    disk = Disk(tmp_path, 40_000)
    free = (lambda _folder: disk.free) if room_is_minded else (lambda _folder: 10**9)
    store = Store(tmp_path, Limits(8000, 1e9, 10**9), header, write=disk.write, free=free)
    told = []
    for number in range(1, 201):
        store.write([row(number, 500), Packet(number, bytes(100))])
        told.append(store.trouble)
    full = "the disk is full: the oldest files are given up"
    assert set(told[told.index(full) :]) == {full}
    disk.room = 10**9
    begun = journal_files(tmp_path)[-1].number
    for number in range(201, 241):
        store.write([row(number, 500), Packet(number, bytes(100))])
        if not store.trouble:
            break
    # Whether an old file had been given up for the one at hand yet decides if the next must be filled too.
    # Where the disk tells how much is free it need not be filled at all.
    assert journal_files(tmp_path)[-1].number - begun in ({0} if room_is_minded else {1, 2})
    assert store.lost_records == 0
    store.close()


def test_the_last_of_the_disk_is_left_to_checkpoints(tmp_path: Path, header) -> None:
    disk = Disk(tmp_path, 40_000)
    store = Store(
        tmp_path, Limits(8000, 1e9, 10**9), header, write=disk.write, free=lambda _folder: disk.free
    )
    told = set()
    for number in range(1, 201):
        store.write([row(number, 500), Packet(number, bytes(100))])
        assert disk.free >= 8000
        told.add(store.trouble)
    assert told == {"", "the disk is full: the oldest files are given up"}
    assert store.lost_records == 0
    store.close()
    assert numbers(tmp_path)[0] > 100


def test_a_disk_that_frees_nothing_does_not_cost_the_whole_journal(tmp_path: Path, header) -> None:
    """Snapshots hold what was removed, or somebody else takes it at once."""
    clock = [0.0]
    store = Store(
        tmp_path, Limits(8000, 1e9, 10**9), header, clock=lambda: clock[0], free=lambda _folder: 100
    )
    for number in range(1, 101):
        store.write([row(number, 500)])
    assert [file.number for file in journal_files(tmp_path)][:2] == [2, 3]
    clock[0] += RETRY_S
    store.write([row(101, 500)])
    assert [file.number for file in journal_files(tmp_path)][:2] == [3, 4]
    store.close()


def test_a_disk_filled_by_others_loses_and_counts_and_goes_on_later(tmp_path: Path, header) -> None:
    clock = [0.0]
    disk = Disk(tmp_path, 10**9)
    store = Store(tmp_path, LARGE, header, clock=lambda: clock[0], write=disk.write)
    store.write([row(1), row(2)])
    disk.room = 0
    store.write([row(3), Packet(0, b"lost")])
    store.write([row(4)])
    assert store.trouble == "No space left on device: nothing is recorded"
    # The file of this run is the oldest by now: it is given up last, for a new one that has no room either.
    assert store.lost_records == 2
    assert store.lost_packets == 1
    disk.room = 10**9
    store.write([row(5)])
    assert store.lost_records == 3, "no attempt before the pause is over"
    clock[0] += RETRY_S
    store.write([row(6)])
    assert store.trouble == ""
    store.close()
    assert numbers(tmp_path)[-1] == 6
    assert 6 - len(numbers(tmp_path)) >= store.lost_records


def test_while_the_disk_refuses_all_the_newest_file_is_kept_and_it_is_said(tmp_path: Path, header) -> None:
    """It may hold what no checkpoint knows; and health does not say that older files make room."""
    disk = Disk(tmp_path, 10**9)
    store = Store(
        tmp_path, LARGE, header, clock=lambda: 0.0, write=disk.write, free=lambda _folder: disk.free
    )
    store.write([row(1), row(2)])
    disk.room = 0
    for number in (3, 4):
        store.write([row(number)])
        assert store.trouble == "No space left on device: nothing is recorded"
    assert numbers(tmp_path) == [1, 2]
    assert store.lost_records == 2
    store.close()


def test_a_disk_with_ample_room_again_is_not_called_full(tmp_path: Path, header) -> None:
    """A file of the journal takes an hour and more to fill: nobody shall be sent to a full disk until then."""
    disk = Disk(tmp_path, 40_000)
    store = Store(
        tmp_path, Limits(8000, 1e9, 10**9), header, write=disk.write, free=lambda _folder: disk.free
    )
    number = 0
    while not store.trouble:
        number += 1
        store.write([row(number, 500)])
    disk.room += 4000
    store.write([row(number + 1)])
    assert store.trouble == "the disk is full: the oldest files are given up"
    disk.room += 100_000
    store.write([row(number + 2)])
    assert store.trouble == ""
    store.close()


def test_a_folder_that_is_removed_under_way_is_told_and_made_again(tmp_path: Path, header) -> None:
    """Its open files could be written on and on, and nobody would ever read them."""
    clock = [0.0]
    folder = tmp_path / "journal"
    store = Store(folder, LARGE, header, clock=lambda: clock[0])
    store.write([row(1)])
    store.sync()
    shutil.rmtree(folder)
    store.write([row(2)])
    store.sync()
    assert store.trouble == "its files were removed: nothing is recorded"
    assert store.synced == Position(1, 1)
    store.write([row(3)])
    assert store.lost_records == 2
    clock[0] += RETRY_S
    store.write([row(4)])
    store.sync()
    assert (store.trouble, store.synced) == ("", Position(1, 4))
    assert numbers(folder) == [4]
    with pytest.raises(BlockingIOError):
        Store(folder, LARGE, header)
    store.close()


def test_a_folder_that_another_service_has_made_meanwhile_is_left_to_it(tmp_path: Path, header) -> None:
    clock = [0.0]
    folder = tmp_path / "journal"
    store = Store(folder, LARGE, header, clock=lambda: clock[0])
    store.write([row(1)])
    shutil.rmtree(folder)
    other = Store(folder, LARGE, header)
    other.write([row(1)])
    store.sync()
    clock[0] += RETRY_S
    store.write([row(2)])
    assert store.trouble == "another process uses it: nothing is recorded"
    other.sync()
    clock[0] += RETRY_S
    store.write([row(3)])
    other.close()
    assert numbers(folder) == [1]
    store.close()


@pytest.mark.parametrize("number", [errno.EIO, errno.EROFS, errno.EDQUOT])
def test_any_error_of_the_disk_is_survived(tmp_path: Path, header, number: int) -> None:
    clock = [0.0]
    disk = Disk(tmp_path, 10**9)
    store = Store(tmp_path, LARGE, header, clock=lambda: clock[0], write=disk.write)
    store.write([row(1)])
    disk.error = OSError(number, os.strerror(number))
    store.write([row(2)])
    assert os.strerror(number) in store.trouble
    assert store.lost_records == 1
    disk.error = None
    clock[0] += RETRY_S
    store.write([row(3)])
    store.close()
    assert numbers(tmp_path)[-1] == 3


def test_who_cannot_wait_for_the_next_sync_asks_for_one(tmp_path: Path, header) -> None:
    journal = Journal(Store(tmp_path, LARGE, header), sync_s=1e9)
    for number in range(1, 4):
        journal.event(float(number), DeadlineReached())
        journal.flush()
        assert journal.status.synced == (None if number == 1 else Position(1, number - 1))
        assert journal.sync(journal.position, 60.0)
        assert journal.status.synced == Position(1, number)
    assert journal.sync(journal.position, 60.0), "again, with nothing to do"
    assert not journal.sync(Position(1, 4), 0.01), "that is not recorded yet"
    journal.close()


def test_a_sync_that_fails_is_trouble(tmp_path: Path, header, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path, LARGE, header)
    store.write([row(1)])
    store.sync()
    assert store.synced == Position(1, 1)
    store.write([row(2)])

    def failing(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", failing)
    store.sync()
    assert store.synced == Position(1, 1), "a failed sync promises nothing"
    assert "Input/output error" in store.trouble
    assert store.lost_records == 1, "nor will the next one, for what this one could not"
    monkeypatch.undo()
    store.close()


def test_a_disk_that_refuses_is_not_waited_for(
    tmp_path: Path, header, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A checkpoint would have to wait as long; an hour here, which ends the test."""
    journal = Journal(Store(tmp_path, LARGE, header), sync_s=1e9)
    journal.event(1.0, DeadlineReached())

    def failing(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", failing)
    assert not journal.sync(journal.position, 3600.0), "it fails"
    assert not journal.sync(journal.position, 3600.0), "it has failed"
    monkeypatch.undo()
    journal.close()


def test_a_file_given_up_is_synced_first(tmp_path: Path, header, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next file's sync says that all before it is on the disk; so what the last one holds has to be."""
    lengths: dict[int, int] = {}
    monkeypatch.setattr(
        os, "fsync", lambda descriptor: lengths.update({_inode(descriptor): _length(descriptor)})
    )
    clock = [0.0]
    disk = Disk(tmp_path, 10**9)
    store = Store(tmp_path, LARGE, header, clock=lambda: clock[0], write=disk.write)
    store.write([row(1)])
    disk.error = OSError(errno.EIO, os.strerror(errno.EIO))
    store.write([row(2)])
    disk.error = None
    clock[0] += RETRY_S
    store.write([row(3)])
    store.sync()
    assert store.synced == Position(1, 3)
    assert store.lost_records == 1
    first, second = sorted(tmp_path.glob("*.journal"))
    assert [lengths[path.stat().st_ino] for path in (first, second)] == [
        path.stat().st_size for path in (first, second)
    ]
    store.close()


def test_the_number_of_a_run_that_is_gone_is_not_given_again(tmp_path: Path, header) -> None:
    """A checkpoint of run 57 is older than all that comes, though somebody has removed the journal since."""
    store = Store(tmp_path, LARGE, {**header, "resumed": [57, 1200]})
    store.write([row(1), row(2)])
    store.close()
    assert store.run == 58
    entries = [
        part.position for part in read_entries(tmp_path, Position(57, 1200)) if isinstance(part, Entry)
    ]
    assert entries == [Position(58, 1), Position(58, 2)]


def test_what_was_synced_survives_a_power_cut(
    tmp_path: Path, header, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cut leaves of each file at least what had been synced; here, exactly that."""
    lengths: dict[int, int] = {}
    monkeypatch.setattr(
        os, "fsync", lambda descriptor: lengths.update({_inode(descriptor): _length(descriptor)})
    )
    store = Store(tmp_path, Limits(9000, 1e9, 10**9), header)
    for number in range(1, 30):
        store.write([row(number, 700)])
        if number % 4 == 0:
            store.sync()
        promised = store.synced.sequence
        left = tmp_path.parent / "left"
        left.mkdir(exist_ok=True)
        for file in journal_files(tmp_path):
            content = file.path.read_bytes()[: lengths.get(file.path.stat().st_ino, 0)]
            (left / file.path.name).write_bytes(content)
        assert set(range(1, promised + 1)) <= set(numbers(left))
    assert promised == 28
    store.close()


def _inode(descriptor: int) -> int:
    return os.fstat(descriptor).st_ino


def _length(descriptor: int) -> int:
    return os.fstat(descriptor).st_size


# The loop's side ---------------------------------------------------------------------------------------------


class Stuck:
    """A disk on which a write waits until it is let go."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.entered = threading.Event()

    def write(self, descriptor: int, data: bytes) -> int:
        self.entered.set()
        assert self.go.wait(30.0)
        return os.write(descriptor, data)


def test_a_stuck_disk_holds_nobody_up_and_what_finds_no_room_is_counted(tmp_path: Path, header) -> None:
    stuck = Stuck()
    journal = Journal(Store(tmp_path, LARGE, header, write=stuck.write), queue_bytes=10_000)
    journal.event(0.0, DeadlineReached())
    assert stuck.entered.wait(10.0)
    for now in range(1, 101):
        journal.event(float(now), LinkDown("x" * 100))
    lost = journal.status.lost_records
    assert 60 < lost < 80
    assert str(journal.status) == f"{lost} records lost"
    assert journal.position == Position(1, 101)
    assert journal.status.synced is None
    stuck.go.set()
    journal.flush()
    journal.event(101.0, DeadlineReached())
    journal.close()
    assert journal.status.lost_records == lost
    assert numbers(tmp_path) == [*range(1, 102 - lost), 102]
    assert f"{lost} records before it are missing" in troubles(tmp_path)[0]


def test_what_is_recorded_is_synced_within_the_second(tmp_path: Path, header) -> None:
    journal = Journal(Store(tmp_path, LARGE, header), sync_s=0.05)
    journal.event(0.0, DeadlineReached())
    for _ in range(1000):
        if journal.status.synced == Position(1, 1):
            break
        threading.Event().wait(0.01)
    assert journal.status.synced == Position(1, 1)
    journal.close()


def test_a_record_that_cannot_be_written_down_is_counted(tmp_path: Path, header, caplog) -> None:
    journal = Journal(Store(tmp_path, LARGE, header))
    journal.event(0.0, JobFailed(1, object()))  # type: ignore[arg-type]
    journal.event(1.0, LinkDown("x" * (33 * 2**20)))
    journal.event(2.0, DeadlineReached())
    journal.close()
    assert "has no form here" in caplog.text
    assert journal.status.lost_records == 2
    assert numbers(tmp_path) == [3]


def test_an_error_of_its_own_ends_the_recording_and_nothing_else(tmp_path: Path, header, caplog) -> None:
    store = Store(tmp_path, LARGE, header)

    def broken(items: object) -> None:
        raise RuntimeError("a bug")

    store.write = broken  # type: ignore[method-assign,assignment]
    journal = Journal(store)
    journal.event(0.0, DeadlineReached())
    journal.flush()
    journal.event(1.0, DeadlineReached())
    assert journal.status.trouble == "ended over an error of its own: a bug"
    assert journal.status.lost_records == 2
    journal.close()


def test_the_service_records_where_it_is_told_to(
    tmp_path: Path, configuration: Configuration, header, caplog
) -> None:
    survey = SurveyArea.from_geometry(LocalFrame(33.95, -118.85), shapely.box(0, 0, 1000, 1000))

    def opened(environment: dict[str, str], **section: Any) -> tuple[list[Path], str]:
        changed = configuration.model_copy(
            update={"journal": configuration.journal.model_copy(update=section)}
        )
        before = set(tmp_path.rglob("*.journal"))
        journal, problem = open_journal(changed, survey, environment)
        if journal is not None:
            journal.event(0.0, DeadlineReached())
            journal.close()
        return sorted({path.parent for path in set(tmp_path.rglob("*.journal")) - before}), problem

    home, given = str(tmp_path / "home"), str(tmp_path / "given")
    assert opened({"STATE_DIRECTORY": given, "HOME": home}) == ([Path(given) / "journal"], "")
    expected = Path(home) / ".local" / "state" / "halocline" / "tester" / "journal"
    assert opened({"HOME": home}) == ([expected], "")
    assert opened({"HOME": home}, directory=tmp_path / "own") == ([tmp_path / "own"], "")
    assert opened({"HOME": home}, enabled=False) == ([], "")
    folders, problem = opened({})
    assert folders == []
    assert problem.endswith("says where to keep anything: nothing is recorded")
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    assert opened({}, directory=blocked / "journal")[1].endswith("Not a directory: nothing is recorded")


def test_entries_are_the_events(tmp_path: Path, header) -> None:
    store = Store(tmp_path, LARGE, header)
    store.write([row(1)])
    store.close()
    (entry,) = read_entries(tmp_path, Position(1, 0))
    assert isinstance(entry, Entry)
    assert entry.record == Happened(1.0, LinkDown(""))
