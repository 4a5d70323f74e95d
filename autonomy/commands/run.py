"""`autonomy run`: the service on board."""

import argparse
import asyncio
import faulthandler
import logging
import os
import signal
import sys

from autonomy.commands.configuration import add_override_argument, doubts, load_with_survey, tell
from autonomy.config import ConfigurationError

EXIT_ALREADY_RUNNING = 75
"""EX_TEMPFAIL of sysexits.h: systemd tries again."""

EXIT_SOFTWARE = 70
"""EX_SOFTWARE of sysexits.h; systemd restarts the service after it."""

_SYSLOG_PRIORITY = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}


class _JournalFormatter(logging.Formatter):
    """Lines with systemd's priority prefix; the journal adds the time itself."""

    def format(self, record: logging.LogRecord) -> str:
        """One record, its priority on every line."""
        priority = _SYSLOG_PRIORITY.get(record.levelno, 6)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration in YAML")
    parser.add_argument(
        "--afresh",
        action="store_true",
        help="put aside what an earlier run has learnt, and begin with nothing",
    )
    add_override_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run until SIGTERM; exit codes: 0 stopped, 70 a bug of ours, 75 another one runs already, 78 configuration."""
    try:
        loaded, survey = load_with_survey(arguments.config, arguments.overrides)
    except ConfigurationError as error:
        return tell(error)
    log_to_stderr(loaded.configuration.logging.level)
    # The hung line is what one wants to know when the watchdog strikes with SIGABRT.
    faulthandler.enable()
    # zenoh and the learner take a while to import: a wrong configuration is told before.
    from autonomy.shell.allocator import keep_compact
    from autonomy.shell.daemon import Daemon
    from autonomy.shell.journal import open_journal
    from autonomy.shell.resumption import AlreadyRunningError, open_continuity
    from autonomy.shell.signed_link import open_signed_link

    keep_compact()
    log = logging.getLogger("autonomy")
    for doubt in doubts(loaded, survey):
        log.warning("%s", doubt)
    configuration = loaded.configuration
    continuity = None
    # A stop while it is starting is no failure of what it goes on from; the loop has handlers of its own.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        continuity, unkept = open_continuity(configuration, survey, os.environ, afresh=arguments.afresh)
        past = (None, ()) if continuity is None else (continuity.resumed, continuity.left_out)
        journal, unrecorded = open_journal(configuration, survey, os.environ, *past)
        signed_link = open_signed_link(configuration, os.environ)
        daemon = Daemon(
            configuration,
            survey,
            journal=journal,
            unrecorded=unrecorded,
            continuity=continuity,
            unkept=unkept,
            signed_link=signed_link,
        )
        asyncio.run(daemon.run())
    except KeyboardInterrupt:
        if continuity is not None:
            continuity.stopped_early()
        log.info("stopped while it was starting")
        return 0
    except AlreadyRunningError as error:
        log.error("%s", error)
        return EXIT_ALREADY_RUNNING
    except Exception:
        log.exception("the service ends over an error of its own")
        return EXIT_SOFTWARE
    log.info("stopped")
    return 0


def log_to_stderr(level: str) -> None:
    """Have everything from this level on written to standard error, as the journal of systemd likes it."""
    handler = logging.StreamHandler(sys.stderr)
    in_journal = "JOURNAL_STREAM" in os.environ
    handler.setFormatter(
        _JournalFormatter("%(message)s")
        if in_journal
        else logging.Formatter("%(asctime)s %(levelname)-7s %(message)s", datefmt="%H:%M:%S")
    )
    logging.basicConfig(level=level.upper(), handlers=[handler])
