"""What a recording of earlier runs holds, for the slider: thinned while it is read, for it may be long."""

import logging
import threading
from collections import deque
from pathlib import Path

from autonomy.effects import Topic
from autonomy.shore.recording import Recorded, read_recording
from autonomy.shore.recording_files import recording_files
from autonomy.shore.server.fleet import Fleet
from autonomy.shore.subscriber import Update
from autonomy.wire import VEHICLE_NAME, WireError, decode

log = logging.getLogger(__name__)

_KEPT = {Topic.LOG: 200, Topic.PLAN: 300, Topic.HEALTH: 1, Topic.SURVEY: 1}
"""Of these only the newest count."""
_THINNED = (Topic.MODEL, Topic.OBSERVATIONS)
_FINEST, _COARSEST, _TOGETHER = 500.0, 20.0, 2000.0
"""Of what is thinned, one is wanted in a 500th of its age; fewer where there are many vehicles."""


class Past:
    """Brings a recording into a fleet.

    Args:
        folder: of the recording.
        fleet: that is told, without news for the pages.
    """

    def __init__(self, folder: Path, fleet: Fleet) -> None:
        self._folder = folder
        self._fleet = fleet
        self._taken_s: dict[tuple[str, Topic], float] = {}
        self._newest: dict[tuple[str, Topic], deque[Recorded]] = {}
        self._vehicles: set[str] = set()
        self._refused = 0

    def read(self, stopping: threading.Event) -> int:
        """Read it all; the number of records that could not be understood.

        Raises:
            RecordingError: there is none.
            OSError: it can't be read.
        """
        end_s = max((file.stat().st_mtime for file in recording_files(self._folder)), default=0.0)
        for record in read_recording(self._folder):
            if stopping.is_set():
                return self._refused
            self._consider(record, end_s)
        for (_, topic), records in self._newest.items():
            for record in records:
                self._take(record, topic)
        return self._refused

    def _consider(self, record: Recorded, end_s: float) -> None:
        try:
            topic = Topic(record.topic)
        except ValueError:
            return
        if not VEHICLE_NAME.fullmatch(record.vehicle):
            return
        self._vehicles.add(record.vehicle)
        where = record.vehicle, topic
        if topic in _KEPT:
            self._newest.setdefault(where, deque(maxlen=_KEPT[topic])).append(record)
        elif topic in _THINNED:
            fineness = min(_FINEST, max(_COARSEST, _TOGETHER / len(self._vehicles)))
            spacing_s = max(0.0, end_s - record.received_utc_s) / fineness
            if abs(record.received_utc_s - self._taken_s.get(where, -1e12)) >= spacing_s:
                self._taken_s[where] = record.received_utc_s
                self._take(record, topic)

    def _take(self, record: Recorded, topic: Topic) -> None:
        try:
            value = decode(topic, record.payload)
        except WireError as error:
            # Of another version, for instance.
            self._refused += 1
            log.debug("%s: %s", record.key, error)
            return
        update = Update(record.vehicle, value)
        self._fleet.take(update, record.payload, record.received_utc_s, is_news=False)
