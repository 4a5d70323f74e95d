"""The service: one asyncio loop that brings events to the core and carries out its effects.

Nothing slow runs in the loop: jobs have a process of their own, zenoh has a thread.
"""

import asyncio
import logging
import os
import signal
from collections.abc import Hashable
from typing import Any

from autonomy.config import Configuration, ShoreSection
from autonomy.core import Core
from autonomy.effects import Answer, Effect, Log, Publish, SendMessage, StartJob
from autonomy.endpoints import Certificates
from autonomy.events import (
    CommandReceived,
    DeadlineReached,
    Event,
    JobFailed,
    JobFinished,
    LinkDown,
    LinkUp,
    MessageReceived,
    StopRequested,
)
from autonomy.mavlink.codec import Codec
from autonomy.planning.survey import SurveyArea
from autonomy.shell.allocator import GIVE_BACK_S, give_back
from autonomy.shell.command_desk import CommandDesk
from autonomy.shell.forethought import Forethought
from autonomy.shell.journal import Journal
from autonomy.shell.publisher import Publisher
from autonomy.shell.resumption import Continuity
from autonomy.shell.signed_link import SignedLink
from autonomy.shell.systemd import Notifier
from autonomy.shell.telling import Telling
from autonomy.shell.transport import Transport
from autonomy.shell.transports import open_transport
from autonomy.shell.worker import Worker
from autonomy.wire_commands import STATUS, read_token

log = logging.getLogger("autonomy")

_PROVISIONAL_SYSTEM_ID = 1
"""Our system id until the vehicle's own is known; we take over the vehicle's."""

_TEND_SIGNING_S = 1.0

DIGEST_EVERY = 60
"""Reports of health to one digest for satellite modems."""


class Daemon:
    """The shell around one core, for one run of the service.

    Args:
        configuration: all of it.
        survey: what `survey` in the configuration describes.
        job_runner: `package.module:function` that the worker process runs jobs with.
        journal: where the run is recorded; it is closed at the end. None: it is not.
        unrecorded: why there is no journal although there should be one; goes into health.
        continuity: what earlier runs have left, and what keeps what this one knows; None: it begins with nothing,
            and leaves nothing.
        unkept: why there is no continuity although there should be one; goes into health.
        signed_link: what signs and checks the packets of the link to the vehicle; None: nothing does.
    """

    def __init__(
        self,
        configuration: Configuration,
        survey: SurveyArea,
        job_runner: str = "autonomy.jobs:run",
        journal: Journal | None = None,
        unrecorded: str = "",
        continuity: Continuity | None = None,
        unkept: str = "",
        signed_link: SignedLink | None = None,
    ) -> None:
        self._configuration = configuration
        self._core = Core(configuration, survey) if continuity is None else continuity.core
        self._continuity = continuity
        self._milestones = self._core.milestones
        self._signed_link = signed_link
        signing = None if signed_link is None else signed_link.signing
        self._codec = Codec(_PROVISIONAL_SYSTEM_ID, configuration.mavlink.component_id, signing)
        shore = configuration.shore
        token_file = shore.commands.token_file
        self._desk = CommandDesk(
            configuration.vehicle.name,
            accepted=shore.commands.accepted,
            token=None if token_file is None else read_token(token_file, os.environ),
            journal=journal,
            fresh=continuity is None or continuity.resumed is None,
        )
        self._publisher = Publisher(
            configuration.vehicle.name,
            shore.connect,
            backlog=shore.backlog,
            certificates=_certificates(shore),
            precision=shore.precision,
            rate_limit_bytes_per_s=shore.rate_limit_bytes_per_s,
            digest_period_s=DIGEST_EVERY * shore.health_period_s,
            on_command=self._desk.take,
        )
        self._worker = Worker(survey, self._job_finished, self._job_failed, run=job_runner)
        self._journal = journal
        self._forethought = Forethought(continuity, self._conversation, self._send)
        self._notifier = Notifier(os.environ)
        self._telling = Telling(
            configuration,
            survey,
            self._publisher,
            self._notifier,
            desk=self._desk,
            signed_link=signed_link,
            journal=journal,
            unrecorded=unrecorded,
            continuity=continuity,
            unkept=unkept,
        )
        self._transport: Transport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._ended: asyncio.Future[None] | None = None

    async def run(self) -> None:
        """Run until SIGTERM or SIGINT.

        Raises:
            Exception: whatever the core raised, which is a bug: the service manager starts us again.
        """
        loop = asyncio.get_running_loop()
        self._ended = ended = loop.create_future()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stop)
        try:
            self._publisher.start()
            self._telling.begin()
            self._worker.start()
            if self._continuity is not None:
                self._continuity.begin(self._journal)
            self._transport = open_transport(
                self._configuration.mavlink.endpoint,
                on_bytes=self._received,
                on_up=lambda: self._happened(LinkUp()),
                on_down=lambda reason: self._happened(LinkDown(reason)),
            )
            self._notifier.ready()
            self._happened(DeadlineReached())
            self._desk.start(lambda command: loop.call_soon_threadsafe(self._commanded, command))
            self._feed_watchdog()
            self._keep_regularly(first=True)
            self._give_back_regularly()
            self._tend_signing()
            log.info("looking for the vehicle at %s", self._configuration.mavlink.endpoint)
            await self._until_the_end(ended)
        finally:
            await self._close()

    async def _until_the_end(self, ended: "asyncio.Future[None]") -> None:
        """Wait for the stop. What keeps worker and link never ends by itself: if one does, so does the run."""
        assert self._transport is not None
        watch = asyncio.create_task(self._telling.watch_certificate())
        keepers = [self._worker.keeper, self._transport.keeper, watch]
        try:
            await asyncio.wait([ended, *keepers], return_when=asyncio.FIRST_COMPLETED)
        finally:
            watch.cancel()
        for keeper in keepers:
            if keeper.done():
                keeper.result()
        ended.result()

    def _stop(self) -> None:
        if self._ended is None or self._ended.done():
            return
        self._notifier.stopping()
        self._happened(StopRequested())
        if not self._ended.done():
            if self._continuity is not None:
                self._continuity.keep(self._journal)
            self._ended.set_result(None)

    async def _close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._transport is not None:
            await self._transport.close()
        await self._worker.close()
        await asyncio.to_thread(self._desk.close)
        await asyncio.to_thread(self._publisher.stop)
        if self._continuity is not None:
            ended = self._ended
            in_order = ended is not None and ended.done() and ended.exception() is None
            await asyncio.to_thread(self._continuity.close, in_order=in_order)
        if self._journal is not None:
            await asyncio.to_thread(self._journal.close)
        if self._signed_link is not None:
            await asyncio.to_thread(self._signed_link.close)
        self._notifier.close()

    def _received(self, data: bytes, peer: Hashable) -> None:
        assert self._transport is not None
        messages = self._codec.decode(data, peer, stream=self._transport.is_stream)
        if self._signed_link is not None:
            if any(each.get_header().incompat_flags for each in messages):
                self._transport.vouch(peer)
            if self._signed_link.signing.is_due:
                self._signed_link.tend()
        for message in messages:
            self._happened(MessageReceived(message))

    def _tend_signing(self) -> None:
        if self._signed_link is not None and self._ended is not None and not self._ended.done():
            asyncio.get_running_loop().call_later(_TEND_SIGNING_S, self._tend_signing)
            self._signed_link.tend()

    def _job_finished(self, job_id: int, result: Any) -> None:
        self._happened(JobFinished(job_id, result))

    def _job_failed(self, job_id: int, reason: str) -> None:
        self._happened(JobFailed(job_id, reason))

    def _commanded(self, command: CommandReceived) -> None:
        """Somebody ashore who may wants something done, or only wants to know."""
        if command.verb == STATUS:
            self._desk.answered(self._core.report(command))
        else:
            self._happened(command)

    def _happened(self, event: Event) -> None:
        """Bring one event to the core and do what it asks; the end of this service if the core raises."""
        if self._ended is None or self._ended.done():
            return
        loop = asyncio.get_running_loop()
        try:
            effects = self._handle(loop.time(), event)
            # What is worth remembering is on its way to the disk before it has any consequence.
            if self._continuity is not None and self._core.milestones != self._milestones:
                self._milestones = self._core.milestones
                self._continuity.keep(self._journal)
            for effect in effects:
                self._carry_out(effect)
            self._telling.fence(self._core.safeguards)
            due = self._core.next_deadline()
        except Exception as error:  # noqa: BLE001 -- whatever it is, the run is over and says so
            self._ended.set_exception(error)
            if self._continuity is not None:
                self._continuity.crashed(self._journal)
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer = loop.call_at(due, self._happened, DeadlineReached())

    def _handle(self, now: float, event: Event) -> list[Effect]:
        """What the core asks for; event and effects are recorded, each before it has any consequence."""
        if self._journal is None:
            return self._core.handle(now, event)
        self._journal.event(now, event)
        if self._continuity is not None:
            self._continuity.handling(self._journal.position)
        effects = self._core.handle(now, event)
        if self._continuity is not None:
            self._continuity.handling(None)
        self._journal.effects(effects)
        return effects

    def _keep_regularly(self, *, first: bool = False) -> None:
        if self._continuity is None or self._ended is None or self._ended.done():
            return
        asyncio.get_running_loop().call_later(self._continuity.period_s, self._keep_regularly)
        if not first:
            self._continuity.keep(self._journal)

    def _give_back_regularly(self) -> None:
        give_back()
        asyncio.get_running_loop().call_later(GIVE_BACK_S, self._give_back_regularly)

    def _carry_out(self, effect: Effect) -> None:
        match effect:
            case SendMessage(message):
                self._forethought.send(message)
            case StartJob(job_id, name, request, deadline_s):
                self._worker.submit(job_id, name, request, deadline_s)
            case Publish(topic, payload):
                self._telling.publish(topic, payload, self._core.utc_s)
            case Answer():
                self._desk.answered(effect)
            case Log(level, text):
                log.log(level.value, "%s", text)

    def _send(self, message: Any) -> None:
        self._codec.system_id = self._core.system_id or _PROVISIONAL_SYSTEM_ID
        if self._transport is not None:
            packet = self._codec.encode(message)
            if self._journal is not None:
                self._journal.sent(packet)
            self._transport.send(packet)

    def _conversation(self) -> object | None:
        """The one about the mission that goes on; none once the run is over."""
        return None if self._ended is None or self._ended.done() else self._core.conversation

    def _feed_watchdog(self) -> None:
        """Tell the service manager that the loop turns: only a loop that runs its timers feeds it."""
        period_s = self._notifier.watchdog_period_s
        if period_s is not None and self._ended is not None and not self._ended.done():
            self._notifier.watchdog()
            asyncio.get_running_loop().call_later(period_s, self._feed_watchdog)


def _certificates(shore: ShoreSection) -> Certificates:
    """The files of the configuration as zenoh wants them."""
    tls = shore.tls
    return Certificates(tls.root_ca, tls.certificate, tls.private_key, tls.verify_name)
