"""The recording of what an instrument said, line by line, and of what was made of it: NDJSON, rotated and bounded.

The first line of a file says what it is, with the whole configuration; each further line is

    {"utc": "2026-07-01T12:00:00.250Z", "host_s": 1234.5, "line": "23.7658, …", "sent": {"TEMP": [23.7658, 61250]}}

where `sent` has, by name, value and `time_boot_ms`. Of what was sharpened these belong to earlier lines. In place of it
there may be `unreadable`, `withheld` or `unsent`, with the reason. Files are written by a thread of their own.
"""

import json
import logging
import queue
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from autonomy.shell.state_directory import state_directory

log = logging.getLogger(__name__)

SUFFIX = ".ndjson"
_WAITING = 10_000
_FLUSH_S = 1.0


class RawLog:
    """Records into files of a folder, which is made if need be.

    Args:
        folder: for this instrument alone: the oldest of the files in it are removed.
        header: what each file begins with.
        file_bytes: size at which a new file is begun.
        total_bytes: size of all files above which the oldest are removed.

    Raises:
        OSError: nothing can be written there.
    """

    def __init__(
        self, folder: Path, header: Mapping[str, Any], file_bytes: float, total_bytes: float
    ) -> None:
        self._folder = folder
        self._header = json.dumps(dict(header), ensure_ascii=False)
        self._file_bytes = file_bytes
        self._total_bytes = total_bytes
        self._queue: queue.Queue[str | None] = queue.Queue(_WAITING)
        self._trouble = ""
        self._written = 0
        self.dropped = 0
        """Lines that were not recorded, because the disk did not keep up or failed."""
        self._file = self._begin()
        self._thread = threading.Thread(target=self._work, name="raw-log", daemon=True)
        self._thread.start()

    def add(self, record: Mapping[str, Any]) -> None:
        """Record a line; never waits."""
        try:
            self._queue.put_nowait(json.dumps(dict(record), ensure_ascii=False))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Write what waits, and end."""
        self._queue.put(None)
        self._thread.join()
        self._file.close()

    def _begin(self) -> TextIO:
        """Begin another file: numbered on, so that names are in order even if the clock is set back."""
        self._folder.mkdir(parents=True, exist_ok=True)
        self._remove_oldest()
        numbers = [int(path.stem.split("-")[1]) for path in self._files()]
        date = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        path = self._folder / f"raw-{max(numbers, default=0) + 1:06d}-{date}{SUFFIX}"
        file = path.open("x", encoding="utf-8")
        file.write(self._header + "\n")
        self._written = len(self._header) + 1
        return file

    def _remove_oldest(self) -> None:
        """Make room before a file is begun: runs may end long before their file is full."""
        files = self._files()
        sizes = [path.stat().st_size for path in files]
        while len(files) > 1 and sum(sizes) > self._total_bytes:
            files.pop(0).unlink()
            sizes.pop(0)

    def _files(self) -> list[Path]:
        return sorted(self._folder.glob(f"raw-[0-9]*-*{SUFFIX}"))

    def _work(self) -> None:
        while True:
            try:
                text = self._queue.get(timeout=_FLUSH_S)
            except queue.Empty:
                self._try(self._file.flush)
                continue
            if text is None:
                self._try(self._file.flush)
                return
            self._try(partial(self._write, text))

    def _write(self, text: str) -> None:
        if self._file.closed:  # another could not be begun
            self._file = self._begin()
        self._file.write(text + "\n")
        self._written += len(text.encode()) + 1
        if self._written < self._file_bytes:
            return
        self._file.close()
        self._file = self._begin()

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except (OSError, ValueError) as error:
            self.dropped += 1
            if str(error) != self._trouble:
                log.error("lines are not recorded: %s", error)
            self._trouble = str(error)
        else:
            if self._trouble:
                log.info("lines are recorded again")
            self._trouble = ""


def timestamp(utc_s: float) -> str:
    """UTC as it is written in a record, to the millisecond."""
    return datetime.fromtimestamp(utc_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def raw_folder(directory: Path | None, instrument: str, environment: Mapping[str, str]) -> Path:
    """Where lines are recorded; ValueError if the environment names no place for what must outlive a program."""
    return directory or state_directory(f"bridge-{instrument}", environment) / "raw"
