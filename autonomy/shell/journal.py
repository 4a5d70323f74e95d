"""The journal of a run: every event that reaches the core, handed to the disk before it is handled.

The control loop never waits for the disk: records go through a bounded queue to a thread of their own, which
writes at once and syncs at least every second. What finds no room in the queue, or what the disk refuses, is
lost, counted, and told in health; the records' numbers show where.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from autonomy import __version__
from autonomy.config import Configuration, JournalSection
from autonomy.effects import Effect
from autonomy.events import Event, MessageReceived
from autonomy.frames import MAXIMUM_PAYLOAD_BYTES
from autonomy.planning.survey import SurveyArea
from autonomy.records import encode_effects, encode_event, encode_resumed
from autonomy.shell.files import cause
from autonomy.shell.journal_files import SCHEMA, SHAPES, VERSION, Position
from autonomy.shell.journal_store import Limits, Packet, Row, Store
from autonomy.shell.state_directory import state_directory

log = logging.getLogger(__name__)

QUEUE_BYTES = 64 * 2**20
"""Room for what the disk has not taken yet: minutes of a survey, with a re-estimate among them."""

# The thread takes what has gathered for so long: woken for each record of a burst it would fight with the loop.
_LINGER_S = 0.002
_ITEM_BYTES = 200  # what an item takes besides its payload


@dataclass(frozen=True)
class JournalStatus:
    """How the recording goes.

    Attributes:
        lost_records: records that are in no file, for want of room in the queue or on the disk.
        lost_packets: the same of the MAVLink stream.
        trouble: what is wrong at present, empty if nothing is.
        synced: every record up to here that was not lost is on the disk, whatever happens; None while nothing is.
        total_bytes: of all files of the journal.
    """

    lost_records: int
    lost_packets: int
    trouble: str
    synced: Position | None
    total_bytes: int

    def __str__(self) -> str:
        lost = f"{self.lost_records} records lost" if self.lost_records else ""
        return "; ".join(filter(None, (self.trouble, lost)))


class Journal:
    """Records one run; make it with `Journal.open`. For one thread; nothing waits but `flush` and `close`.

    Args:
        store: the files.
        sync_s: longest time between a record and its sync.
        utc_s: the wall clock, for the MAVLink stream.
        queue_bytes: room for what the disk has not taken yet.
    """

    def __init__(
        self,
        store: Store,
        sync_s: float = 1.0,
        utc_s: Callable[[], float] = time.time,
        queue_bytes: int = QUEUE_BYTES,
    ) -> None:
        self._store = store
        self._sync_s = sync_s
        self._utc_s = utc_s
        self._room = queue_bytes
        self._queue_bytes = queue_bytes
        self._sequence = 0
        self._waiting: deque[Row | Packet] = deque()
        self._changed = threading.Condition()
        self._in_hand: list[Row | Packet] = []
        self._closing = False
        self._sync_wanted = False
        self._refused_records = 0
        self._refused_packets = 0
        self._failure = ""
        self._thread = threading.Thread(target=self._work, name="journal", daemon=True)
        self._thread.start()

    @classmethod
    def open(
        cls,
        folder: Path,
        section: JournalSection,
        header: dict[str, Any],
        utc_s: Callable[[], float] = time.time,
    ) -> "Journal":
        """Begin a new run in a folder; the torn end of the last one is cut.

        Args:
            folder: made if it isn't there.
            section: limits.
            header: see `make_header`.
            utc_s: the wall clock.

        Raises:
            OSError: the folder can't be made, read or locked; BlockingIOError if another process records there.
        """
        limits = Limits(round(section.file_mb * 1e6), section.file_age_s, round(section.total_mb * 1e6))
        return cls(Store(folder, limits, header), section.sync_s, utc_s)

    @property
    def position(self) -> Position:
        """Just after the newest record: what a checkpoint made now refers to, see `journal_files.read_from`."""
        return Position(self._store.run, self._sequence)

    @property
    def status(self) -> JournalStatus:
        """How it goes; for health."""
        store = self._store
        return JournalStatus(
            self._refused_records + store.lost_records,
            self._refused_packets + store.lost_packets,
            self._failure or store.trouble,
            store.synced if store.synced.sequence else None,
            store.total_bytes,
        )

    @property
    def is_crowded(self) -> bool:
        """Whether half of the queue is taken: somebody who may wait should `flush`."""
        return self._room < self._queue_bytes // 2

    def event(self, now: float, event: Event) -> None:
        """Record an event that the core is about to handle at protocol time `now`."""
        self._record(encode_event, now, event)
        if isinstance(event, MessageReceived):
            self._packet(bytes(event.message.get_msgbuf()))

    def effects(self, effects: Sequence[Effect]) -> None:
        """Record what the core asked for in answer to the last event."""
        if effects:
            self._record(encode_effects, effects)

    def resumed(self, now: float, away_s: float) -> None:
        """Record that the core goes on after a restart, `Core.resume(now, away_s)`, before it does."""
        self._record(encode_resumed, now, away_s)

    def sent(self, packet: bytes) -> None:
        """Add a packet that goes to the vehicle to the MAVLink stream."""
        self._packet(packet)

    def flush(self) -> None:
        """Wait until everything recorded so far is written, or lost."""
        with self._changed:
            self._changed.wait_for(lambda: not (self._waiting or self._in_hand))

    def sync(self, at: Position, within_s: float) -> bool:
        """Have all before a position of this run put on the disk now; whether it was. For any thread.

        Not waited for while the disk refuses to record anything.
        """
        with self._changed:
            self._sync_wanted = True
            self._changed.notify_all()
            self._changed.wait_for(
                lambda: self._store.synced >= at or self._failure or self._store.is_refused, within_s
            )
            return self._store.synced >= at and not self._failure

    def close(self) -> None:
        """Write and sync what is left; nothing is recorded afterwards."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _record(self, encode: Callable[..., bytes], *content: Any) -> None:
        self._sequence += 1
        try:
            payload = encode(*content)
        except Exception as error:  # noqa: BLE001 -- what can't be written down must not end the survey
            log.error("a record can't be written: %s", error)
            self._refused_records += 1
            return
        too_large = len(payload) > MAXIMUM_PAYLOAD_BYTES
        if too_large or not self._put(Row(self._sequence, payload), len(payload)):
            self._refused_records += 1

    def _packet(self, data: bytes) -> None:
        if not self._put(Packet(round(self._utc_s() * 1e6), data), len(data)):
            self._refused_packets += 1

    def _put(self, item: Row | Packet, size: int) -> bool:
        with self._changed:
            if self._closing or self._failure or size + _ITEM_BYTES > self._room:
                return False
            self._room -= size + _ITEM_BYTES
            self._waiting.append(item)
            self._changed.notify_all()
            return True

    # The thread ----------------------------------------------------------------------------------------------

    def _work(self) -> None:
        try:
            self._serve()
        except Exception as error:
            # A bug: the survey goes on without a journal, and everybody hears of it.
            log.exception("the journal ends over an error of its own")
            with self._changed:
                self._failure = f"ended over an error of its own: {error}"
                lost = [*self._in_hand, *self._waiting]
                self._refused_records += sum(isinstance(item, Row) for item in lost)
                self._refused_packets += sum(isinstance(item, Packet) for item in lost)
                self._waiting.clear()
                self._in_hand = []
                self._changed.notify_all()
        finally:
            self._store.close()

    def _serve(self) -> None:
        sync_due = None
        while True:
            items, closing, wanted = self._take(sync_due)
            if items:
                self._store.write(items)
                sync_due = sync_due or time.monotonic() + self._sync_s
            if sync_due is not None and (closing or wanted or not items or time.monotonic() >= sync_due):
                self._store.sync()
                sync_due = None
            self._done(items)
            if items and not closing:
                time.sleep(_LINGER_S)
            if closing and not items:
                return

    def _take(self, sync_due: float | None) -> tuple[list[Row | Packet], bool, bool]:
        """What waits, as soon as there is any; nothing if a sync is due. Whether that is all; whether to sync now."""
        with self._changed:
            patience_s = None if sync_due is None else max(0.0, sync_due - time.monotonic())
            self._changed.wait_for(lambda: self._waiting or self._closing or self._sync_wanted, patience_s)
            wanted, self._sync_wanted = self._sync_wanted, False
            items = list(self._waiting)
            self._waiting.clear()
            self._in_hand = items
            return items, self._closing, wanted

    def _done(self, items: Sequence[Row | Packet]) -> None:
        with self._changed:
            for item in items:
                self._room += _ITEM_BYTES + len(item.payload if isinstance(item, Row) else item.data)
            self._in_hand = []
            self._changed.notify_all()


def open_journal(
    configuration: Configuration,
    survey: SurveyArea,
    environment: Mapping[str, str],
    resumed: Position | None = None,
    left_out: Sequence[Position] = (),
) -> tuple[Journal | None, str]:
    """Begin to record a run of the service, where configuration or environment say.

    `resumed` and `left_out`: see `make_header`.

    Returns:
        The journal, and why there is none although the configuration wants one: a survey without a journal is
        better than none.
    """
    section = configuration.journal
    if not section.enabled:
        log.warning("journal.enabled is false: nothing is recorded")
        return None, ""
    try:
        folder = section.directory or state_directory(configuration.vehicle.name, environment) / "journal"
        header = make_header(
            configuration,
            survey,
            now=time.monotonic(),
            utc_s=time.time(),
            resumed=resumed,
            left_out=left_out,
        )
        journal = Journal.open(folder, section, header)
    except BlockingIOError:
        problem = f"another service records in {folder}"
    except OSError as error:
        problem = cause(error, folder)
    except ValueError as error:
        problem = str(error)
    else:
        log.info("recording run %d in %s", journal.position.run, folder)
        return journal, ""
    log.error("journal: %s: nothing is recorded", problem)
    return None, f"{problem}: nothing is recorded"


def make_header(
    configuration: Configuration,
    survey: SurveyArea,
    *,
    now: float,
    utc_s: float,
    resumed: Position | None = None,
    left_out: Sequence[Position] = (),
) -> dict[str, Any]:
    """What every file of a run begins with: all that a replay needs besides the events.

    Args:
        configuration: all of it.
        survey: what its files of polygons said.
        now: protocol time at the start.
        utc_s: wall clock at the start, seconds since 1970.
        resumed: the record up to which an earlier run's events have made the core; None for a fresh core.
        left_out: positions just after records among these that were quarantined.
    """
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "software": __version__,
        "numpy": np.__version__,
        "now": now,
        "utc_s": utc_s,
        "seed": configuration.seed,
        "configuration": configuration.model_dump(mode="json"),
        "survey": {
            "origin_lat_deg": survey.frame.origin_lat_deg,
            "origin_lon_deg": survey.frame.origin_lon_deg,
            "standoff_m": survey.standoff_m,
            "passage_cells": survey.passage_cells,
            **{name: shapely.to_wkb(getattr(survey, name)) for name in SHAPES},
        },
        "resumed": None if resumed is None else [resumed.run, resumed.sequence],
        "left_out": [[at.run, at.sequence] for at in left_out],
    }
