"""What people are told: ashore, with what the core does not know itself, and in the service manager's status line."""

import asyncio
import logging
from dataclasses import replace
from typing import Any

from autonomy.charting import CORNERS, fence_rings, survey_notice
from autonomy.config import Configuration, ShoreSection
from autonomy.effects import Topic
from autonomy.mavlink.safeguards import Safeguards
from autonomy.planning.survey import SurveyArea
from autonomy.shell.certificate import doubt
from autonomy.shell.command_desk import CommandDesk
from autonomy.shell.journal import Journal
from autonomy.shell.publisher import Publisher
from autonomy.shell.resumption import Continuity
from autonomy.shell.signed_link import SignedLink
from autonomy.shell.systemd import Notifier
from autonomy.wire import HealthNotice, PlanNotice
from autonomy.wire_rules import MAXIMUM_REASON

log = logging.getLogger("autonomy")

CERTIFICATE_S = 3600.0
"""How often our own certificate is looked at: it may expire at sea, or only seem wrong until the clock is set."""


class Telling:
    """See the module's description.

    Args:
        configuration: all of it.
        survey: what `survey` in the configuration describes.
        publisher: who tells the shore.
        notifier: who tells the service manager.
        desk: of commands; what it has refused goes into health.
        signed_link: the same of packets; None: nothing is signed.
        journal: its trouble goes into health, and into the log when it changes. None: nothing is recorded.
        unrecorded: why, if something should be.
        continuity: its trouble goes into health. None: nothing is kept.
        unkept: why, if something should be.
    """

    def __init__(
        self,
        configuration: Configuration,
        survey: SurveyArea,
        publisher: Publisher,
        notifier: Notifier,
        *,
        desk: CommandDesk,
        signed_link: SignedLink | None,
        journal: Journal | None,
        unrecorded: str,
        continuity: Continuity | None,
        unkept: str,
    ) -> None:
        self._publisher, self._notifier = publisher, notifier
        self._desk, self._signed_link = desk, signed_link
        self._journal, self._unrecorded = journal, unrecorded
        self._continuity, self._unkept = continuity, unkept
        shore = configuration.shore
        self._certificate = (configuration.vehicle.name, shore.tls.certificate, shore.tls.private_key)
        self._certificate_doubt = doubt(*self._certificate)
        self._frame = survey.frame
        self._chart = survey_notice(configuration, survey, _corners(shore))
        self._safeguards: Safeguards | None = None
        self._journal_told = ""
        self._status = ""

    def begin(self) -> None:
        """Tell the survey's area."""
        self._publisher.publish(Topic.SURVEY, self._chart)

    def publish(self, topic: Topic, payload: Any, utc_s: float | None) -> None:
        """Tell what the core has to say, at this time by the vehicle's clock."""
        match payload:
            case HealthNotice() as health:
                health = self._completed(health, utc_s)
                self._publisher.publish(topic, health)
                doubts = "".join(f"; {each}" for each in (health.security, health.shore) if each)
                self._tell_manager(f"{health.state}: {health.reason}{doubts}")
            case PlanNotice() as plan:
                self._publisher.publish(topic, replace(plan, utc_s=utc_s))
            case _:
                self._publisher.publish(topic, payload)

    def fence(self, safeguards: Safeguards | None) -> None:
        """Tell the survey's area again, if the autopilot's fence has become known."""
        if safeguards is not self._safeguards and safeguards is not None:
            self._safeguards = safeguards
            self._chart = replace(self._chart, fence=fence_rings(self._frame, safeguards))
            self._publisher.publish(Topic.SURVEY, self._chart)

    async def watch_certificate(self) -> None:
        """Look at our own certificate again and again, for ever."""
        while True:
            await asyncio.sleep(CERTIFICATE_S)
            self._certificate_doubt = await asyncio.to_thread(doubt, *self._certificate)

    def _completed(self, health: HealthNotice, utc_s: float | None) -> HealthNotice:
        """With what the core doesn't tell: UTC, and how the links and the recording are."""
        ashore = self._publisher.status
        signed = "" if self._signed_link is None else self._signed_link.report
        return replace(
            health,
            utc_s=utc_s,
            dropped=sum(ashore.dropped.values()),
            journal=_together(self._recording_trouble(), self._keeping_trouble()),
            security=_together(signed, self._desk.report),
            shore=_together(ashore.trouble, self._certificate_doubt),
        )

    def _recording_trouble(self) -> str:
        if self._journal is None:
            return self._unrecorded
        status = self._journal.status
        if status.trouble != self._journal_told:
            self._journal_told = status.trouble
            if status.trouble:
                log.error("journal: %s", status)
            else:
                log.info("journal: runs are recorded again")
        return str(status)

    def _keeping_trouble(self) -> str:
        kept = self._unkept if self._continuity is None else self._continuity.trouble
        return kept and f"checkpoint: {kept}"

    def _tell_manager(self, status: str) -> None:
        if status != self._status:
            self._status = status
            self._notifier.status(status)


def _together(*said: str) -> str:
    """What there is to say, cut to what health has room for: else it could not be told at all."""
    return "; ".join(filter(None, said))[:MAXIMUM_REASON]


def _corners(shore: ShoreSection) -> int:
    """Corners of outlines, in eight bytes each, that go ashore within ten seconds on a thin link."""
    rate = shore.rate_limit_bytes_per_s
    return CORNERS if rate is None else min(CORNERS, int(10.0 * rate / 8.0))
