"""`autonomy shore record`: keep all that vehicles send, exactly as it arrives, for exports and the page's past."""

import argparse
import sys
import time
from pathlib import Path

from autonomy.option_types import above_zero, vehicle_or_all
from autonomy.shore import way
from autonomy.shore.recording import Limits, Recorder, RecorderStatus
from autonomy.shore.stopping import stop_on_signals
from autonomy.shore.subscriber import Counters, Subscriber

EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2
_LOOK_S = 0.5
_REPORT_S = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    defaults = Limits()
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="made if need be; what it holds is added to"
    )
    parser.add_argument(
        "--vehicle", default="*", type=vehicle_or_all, metavar="V", help="whose; * for all (default)"
    )
    way.add_arguments(parser)
    parser.add_argument(
        "--file-mb",
        type=above_zero("megabytes"),
        default=defaults.file_bytes / 1e6,
        metavar="MB",
        help=f"size at which a new file is begun ({defaults.file_bytes / 1e6:g})",
    )
    parser.add_argument(
        "--total-mb",
        type=above_zero("megabytes"),
        default=defaults.total_bytes / 1e6,
        metavar="MB",
        help=f"size of all files together above which the oldest are removed ({defaults.total_bytes / 1e6:g})",
    )


def run(args: argparse.Namespace) -> int:
    """Record until told to stop: 0; 1 if folder or address can't be had or following failed; 2 for bad usage."""
    limits = Limits(file_bytes=round(args.file_mb * 1e6), total_bytes=round(args.total_mb * 1e6))
    if limits.file_bytes > limits.total_bytes:
        return _complain(EXIT_USAGE, "--file-mb must be at most --total-mb")
    try:
        certificates = way.certificates(args)
    except ValueError as error:
        return _complain(EXIT_USAGE, str(error))
    try:
        recorder = Recorder(args.folder, limits)
    except BlockingIOError:
        return _complain(EXIT_FAILED, f"another process records in {args.folder}")
    except OSError as error:
        return _complain(EXIT_FAILED, f"{error.filename or args.folder}: {error.strerror}")
    with stop_on_signals() as stopping, recorder:
        subscriber = Subscriber(
            args.vehicle,
            args.connect or (),
            args.listen or (),
            on_arrival=recorder.write,
            history=None,
            log_history=None,
            certificates=certificates,
        )
        try:
            subscriber.start()
        except OSError as error:
            return _complain(EXIT_FAILED, str(error))
        _say(f"recording in {args.folder}")
        account = _Account()
        while subscriber.failed is None and not stopping.wait(_LOOK_S):
            account.look(recorder.status, subscriber.counters)
        subscriber.close()
    account.finish(recorder.status, subscriber.counters)
    if subscriber.failed is not None:
        return _complain(EXIT_FAILED, f"vehicles are not followed any more: {subscriber.failed!r}")
    return EXIT_OK


class _Account:
    """What there is to say of a recording as it goes on: troubles at once, all else once a minute."""

    def __init__(self) -> None:
        self._trouble = ""
        self._due = time.monotonic() + _REPORT_S

    def look(self, status: RecorderStatus, heard: Counters) -> None:
        """Say what is new."""
        if status.trouble != self._trouble:
            _say(status.trouble or "recording again")
            self._trouble = status.trouble
        if time.monotonic() >= self._due:
            self._due += _REPORT_S
            _say(_summary(status, heard))

    def finish(self, status: RecorderStatus, heard: Counters) -> None:
        """The last words."""
        self.look(status, heard)
        _say(_summary(status, heard))


def _summary(status: RecorderStatus, heard: Counters) -> str:
    figures = {
        "lost": status.lost,
        "refused": heard.refused,
        "dropped on arrival": heard.dropped,
        "no vehicle had any more": heard.missed,
        "old files removed": status.removed,
    }
    wrong = "".join(f", {count} {what}" for what, count in figures.items() if count)
    return f"{status.recorded} records, {status.total_bytes / 1e6:.1f} MB in all{wrong}"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _complain(code: int, text: str) -> int:
    _say(f"autonomy shore record: {text}")
    return code
