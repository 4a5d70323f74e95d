"""Core and vessel in one process without sleeping: time jumps from deadline to deadline.

Every byte between the two is real MAVLink, packed and parsed; only sockets and the wall clock are missing.
Protocol time and the vessel's own time are the same here, as on a real boat, unless `speedup` says otherwise.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import jobs
from autonomy.core import Core
from autonomy.effects import Answer, Effect, Log, Publish, SendMessage, StartJob, Topic
from autonomy.events import DeadlineReached, Event, JobFailed, JobFinished, LinkDown, LinkUp, MessageReceived
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import Signing, SigningKey
from autonomy.planning.survey import SurveyArea
from autonomy.shell.journal import Journal
from sim.autopilot import Autopilot, Mode
from sim.router import Router

_CORE, _OPERATOR, _STRANGER = "core", "operator", "stranger"
_LONGEST_STEP_S = 1.0
_SHORTEST_STEP_S = 1e-3
_START_S = 1000.0
_MOST_CALLS = 1000
_START_UTC_S = 1_700_000_000.0

JobRunner = Callable[[str, Any, SurveyArea], Any]


@dataclass
class DiscreteRun:
    """One survey, driven as fast as it computes.

    Attributes:
        core: the decisions.
        autopilot: the vessel's half of MAVLink.
        survey: the area, for the jobs.
        job_s: seconds of protocol time that a job takes.
        run_job: does the jobs; a JobFailed follows if it raises.
        now: protocol time. It does not start at 0, since nothing may depend on that.
        speedup: seconds of the vessel's time in one of protocol time. What is said once a second costs most of
            a run, so at 20 it is over much sooner, at the price of decisions that are twenty times as rare.
        linked: whether the link between the two carries anything; see `cut_link`.
        passes: which messages of the core the link carries.
        key: what all sign with; None: nobody does.
        journal: where the run is recorded; whoever opened it closes it.
        log: lines of the core's log, with their time.
        published: what went ashore, by topic, in order.
        sent: what the core sent to the vehicle, with its time.
        answers: to commands from ashore, in order.
    """

    core: Core
    autopilot: Autopilot
    survey: SurveyArea
    job_s: float = 2.0
    run_job: JobRunner = jobs.run
    now: float = _START_S
    speedup: float = 1.0
    linked: bool = True
    passes: Callable[[Any], bool] = lambda message: True
    key: SigningKey | None = None
    journal: Journal | None = None
    log: list[tuple[float, str]] = field(default_factory=list)
    published: dict[Topic, list[Any]] = field(default_factory=lambda: {topic: [] for topic in Topic})
    sent: list[tuple[float, Any]] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._router = Router(self.autopilot, self._new_signing())
        self.signing = self._new_signing()
        self._own = Codec(self.autopilot.system_id, 191, self.signing)
        self._operator = Codec(255, mavlink.MAV_COMP_ID_MISSIONPLANNER, self._new_signing())
        self._pending: list[tuple[float, Event]] = []
        self._arrived: deque[bytes] = deque()
        self._delivering = False
        self.happened(LinkUp())
        self._router.join(self.now, _CORE)

    def advance(self, duration_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Sail for `duration_s` of protocol time, or until `until()` holds; returns whether it does.

        Raises:
            RuntimeError: the core wants to be called at a time that has passed, which would hang a service.
        """
        end = self.now + duration_s
        while self.now < end and not until():
            due = [time for time, _ in self._pending]
            target = min([self.core.next_deadline(), self.now + _LONGEST_STEP_S, end, *due])
            step_s = max(target - self.now, _SHORTEST_STEP_S)
            self.now += step_s
            self._arrive(self._router.advance(self.now, step_s * self.speedup))
            for time, event in list(self._pending):
                if time <= self.now:
                    self._pending.remove((time, event))
                    self.happened(event)
            self._call_when_due()
        return until()

    def _call_when_due(self) -> None:
        """Call the core, again as long as it wants to be: it learns in small portions what came during a job."""
        for _ in range(_MOST_CALLS):
            if self.core.next_deadline() > self.now:
                return
            self.happened(DeadlineReached())
        raise RuntimeError(f"at {self.now} the core asks for {self.core.next_deadline()} again and again")

    def happened(self, event: Event) -> None:
        """Bring an event to the core, carry out what it asks, and bring it the answers."""
        if self.journal is not None:
            self.journal.event(self.now, event)
        effects = self.core.handle(self.now, event)
        if self.journal is not None:
            self.journal.effects(effects)
            if self.journal.is_crowded:
                self.journal.flush()
        for effect in effects:
            self._carry_out(effect)
        self._deliver()

    def cut_link(self, reason: str = "unplugged") -> None:
        """The link is gone, and both ends notice: nothing passes until `restore_link`."""
        self.linked = False
        self.happened(LinkDown(reason))

    def restore_link(self) -> None:
        """The link is back."""
        self.linked = True
        self.happened(LinkUp())

    def replace_autopilot(self, autopilot: Autopilot) -> None:
        """The autopilot starts again, as another object; it has forgotten every stream that was asked of it."""
        self.autopilot = autopilot
        self._router = Router(autopilot, self._new_signing())
        self._router.join(self.now, _CORE)

    def operate(self, message: Any) -> None:
        """The operator's ground station sends a message to the vessel."""
        self._arrive(self._router.receive(self.now, _OPERATOR, self._operator.encode(message)))

    def intrude(self, packet: bytes) -> None:
        """A stranger on the link sends bytes to the core and to the vessel."""
        self._arrived.append(packet)
        self._arrive(self._router.receive(self.now, _STRANGER, packet))

    def arm(self, *, armed: bool = True) -> None:
        """The operator arms the boat or disarms it."""
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, float(armed))

    def select(self, mode: Mode) -> None:
        """The operator selects a mode."""
        self._command(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, float(mode))

    def start_survey(self, patience_s: float = 60.0) -> None:
        """Wait for a mission on board, then arm and select AUTO, as the operator would.

        Raises:
            RuntimeError: no mission came on board in time.
        """
        if not self.advance(patience_s, until=lambda: any("verified" in text for _, text in self.log)):
            raise RuntimeError(f"no mission on board after {patience_s:g} s: {self.log[-3:]}")
        self.arm()
        self.select(Mode.AUTO)

    def _new_signing(self) -> Signing | None:
        return None if self.key is None else Signing(self.key, lambda: _START_UTC_S + self.now)

    def _command(self, command: int, *parameters: float) -> None:
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        self.operate(mavlink.MAVLink_command_long_message(self.autopilot.system_id, 1, command, 0, *padded))

    def _arrive(self, packets: list[tuple[Any, bytes]]) -> None:
        self._take(packets)
        self._deliver()

    def _take(self, packets: list[tuple[Any, bytes]]) -> None:
        """What the vessel sends to the core, while the link carries it."""
        if self.linked:
            self._arrived.extend(packet for client, packet in packets if client == _CORE)

    def _deliver(self) -> None:
        """Bring the core what has arrived, in order; what it is answered meanwhile queues up behind."""
        if self._delivering:
            return
        self._delivering = True
        while self._arrived:
            for message in self._own.decode(self._arrived.popleft(), _CORE):
                self.happened(MessageReceived(message))
        self._delivering = False

    def _carry_out(self, effect: Effect) -> None:
        match effect:
            case SendMessage(message):
                self.sent.append((self.now, message))
                packet = self._own.encode(message)
                if self.journal is not None:
                    self.journal.sent(packet)
                if self.linked and self.passes(message):
                    self._take(self._router.receive(self.now, _CORE, packet))
            case StartJob(job_id, name, request, _):
                self._pending.append((self.now + self.job_s, self._done(job_id, name, request)))
            case Publish(topic, payload):
                self.published[topic].append(payload)
            case Log(_, text):
                self.log.append((self.now, text))
            case Answer():
                self.answers.append(effect)

    def _done(self, job_id: int, name: str, request: Any) -> Event:
        try:
            return JobFinished(job_id, self.run_job(name, request, self.survey))
        except Exception as error:  # noqa: BLE001 -- as in the worker: whatever a job raises is its answer
            return JobFailed(job_id, f"{type(error).__name__}: {error}")
