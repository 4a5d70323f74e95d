"""What people ashore may ask for, and what becomes of it: `start`, `pause`, `resume`, `replan`, `finish`, `return`.

Theory of operation. A directive never takes the boat: it changes what we do with it while it is ours. Whether it is
ours the authority's table says alone, so that the boat's own mode switch goes before every directive:

    the operator or a failsafe has the boat    everything is refused, and he gives it back by selecting AUTO
    he has taken it and given it back          what stood (pause, finish, return) is over: he has decided otherwise
    the budget brings it home                  it stays so; nothing is paused or resumed

What lasts is a wish: `Wishes` sees it carried out. `resume` ends it.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from autonomy.command_memory import CommandMemory
from autonomy.config import Configuration
from autonomy.course import Course
from autonomy.effects import Answer, Level, Outcome
from autonomy.events import CommandReceived
from autonomy.helm import Helm
from autonomy.homeward import Homeward
from autonomy.mavlink.authority import OnBoard
from autonomy.mavlink.authority_table import Action, Command
from autonomy.mavlink.rover import mode_name
from autonomy.planning.passage import Unreachable
from autonomy.planning.plan import Plan
from autonomy.reporting import Reporter
from autonomy.seaway import Seaway
from autonomy.situation import Situation, Wish
from autonomy.wishes import Wishes

_Verdict = tuple[bool, str]
"""Whether it is done, and what was done or why not."""


class Directives:
    """See the module's description. All that it is given belongs to the core."""

    def __init__(
        self,
        configuration: Configuration,
        helm: Helm,
        seaway: Seaway,
        homeward: Homeward,
        course: Course,
        situation: Situation,
        reporter: Reporter,
    ) -> None:
        self._is_full = configuration.authority.mode == "full"
        self._helm, self._seaway, self._homeward = helm, seaway, homeward
        self._situation, self._reporter = situation, reporter
        self._wishes = Wishes(configuration, helm, homeward, course, situation, reporter)
        self._memory = CommandMemory()
        self._answers: list[tuple[float, CommandReceived, Outcome, str]] = []
        self._repeated: list[Answer] = []
        self._replan = False
        self.milestones = 0
        """How many commands were answered for good: worth remembering at once."""

    def take(self, now: float, command: CommandReceived, *, stopping: bool) -> list[Any]:
        """Carry out a command, unless it was before; returns messages to send. The answer follows by `answers`."""
        known = self._memory.known(command)
        if known is not None:
            self._repeated.append(known)
            return []
        objection = self._memory.objection(now, command)
        if objection is not None:
            outcome, text = objection
        else:
            done, text = (False, "the service is stopping") if stopping else self._verdict(now, command.verb)
            outcome = Outcome.DONE if done else Outcome.REFUSED
        self._answers.append((now, command, outcome, text))
        level = Level.INFO if outcome is Outcome.DONE else Level.WARNING
        words = f"{command.verb} ({command.command_id.hex()[:8]}) is {outcome.value}: {text}"
        self._reporter.log(level, f"command from ashore: {words}")
        return self._helm.say(f"halocline: ashore: {command.verb}") if outcome is Outcome.DONE else []

    def answers(self) -> list[Answer]:
        """The answers to what was taken since the last call; they tell how things are now."""
        told, self._repeated = self._repeated, []
        for now, command, outcome, text in self._answers:
            utc_s = self._memory.clock_utc_s(now, command.received_utc_s)
            answer = replace(self.report(command), outcome=outcome, text=text, utc_s=utc_s)
            if outcome is not Outcome.BUSY:
                self._memory.remember(now, command, answer)
                self.milestones += 1
            told.append(answer)
        self._answers.clear()
        return told

    def report(self, command: CommandReceived) -> Answer:
        """How things are, as an answer to this; nothing changes."""
        vehicle = self._helm.state
        return Answer(
            command_id=command.command_id,
            verb=command.verb,
            outcome=Outcome.DONE,
            text="",
            state=self._situation.state.name.lower(),
            reason=self._situation.reason,
            mode="unknown" if vehicle is None else mode_name(vehicle.mode),
            armed=vehicle is not None and vehicle.armed,
            utc_s=command.received_utc_s,
        )

    def take_replan(self) -> bool:
        """Whether a new plan has been asked for since the last call."""
        wanted, self._replan = self._replan, False
        return wanted

    def take_words(self) -> list[str]:
        """What the operator at the boat must hear, since the last call."""
        return self._wishes.take_words()

    def step(self, now: float) -> Plan | None:
        """See that what was asked for is done; returns a plan to bring on board."""
        return self._wishes.step(now)

    # The verbs ------------------------------------------------------------------------------------------------

    def _verdict(self, now: float, verb: str) -> _Verdict:
        hindrance = self._hindrance(verb)
        if hindrance is not None:
            return False, hindrance
        verbs: dict[str, Callable[[float], _Verdict]] = {
            "start": self._start,
            "pause": self._pause,
            "resume": self._resume,
            "replan": self._plan_anew,
            "finish": self._finish,
            "return": self._return,
        }
        return verbs[verb](now)

    def _hindrance(self, verb: str) -> str | None:
        """Why nothing at all can be asked of the boat now, or not this."""
        authority = self._helm.authority
        if not self._situation.in_touch:
            return self._situation.reason
        if authority.command is Command.OBSERVED:
            return "we only look on: authority.mode is observe"
        if authority.command in (Command.YIELDED, Command.DISPLACED):
            return f"the boat is not ours: {authority.reason}"
        if authority.command is Command.STOPPING:
            return "the boat is being told to hold: ask again in a few seconds"
        if self._is_released and verb != "pause":
            return "the boat is being set in motion again: ask again in a few seconds"
        return None

    @property
    def _is_released(self) -> bool:
        """Whether the boat holds, and is being set in motion again."""
        authority = self._helm.authority
        return authority.command is Command.HELD and authority.action is Action.SELECT_AUTO

    def _not_under_way(self) -> str | None:
        """Why there is no survey to change."""
        authority = self._helm.authority
        if not authority.survey_started:
            return f"the survey has not begun: {authority.reason}"
        if self._homeward.is_finished:
            return "the survey has ended at home"
        if authority.command in (Command.SENT_HOME, Command.RETURNING):
            return f"the autopilot brings the boat home: {authority.reason}"
        if self._homeward.is_returning and not self._homeward.is_sent:
            return f"the boat goes home: {self._homeward.reason or 'the budget is sailed'}"
        return None

    def _start(self, now: float) -> _Verdict:
        authority, vehicle = self._helm.authority, self._helm.state
        if self._homeward.is_finished:
            return False, "the survey has ended at home: disarm the boat, and the next start begins another"
        if authority.survey_started:
            return True, "it has been started already"
        if not self._is_full:
            return False, "authority.mode is missions: the operator arms the boat and selects AUTO"
        if authority.was_ever_taken:
            return False, "the operator has taken the boat: he starts it again himself"
        if vehicle is None or not authority.is_ready(vehicle):
            return False, f"it is not ready: {self._unready()}"
        if self._situation.is_lost(now):
            return False, "it is not ready: it does not tell its position"
        self._wishes.let_start(now)
        return True, "AUTO is selected and the boat armed"

    def _unready(self) -> str:
        if self._helm.authority.on_board is not OnBoard.OURS or not self._helm.authority.waits_on_board:
            return "no mission of ours is verified on board yet"
        return "the autopilot is not sure of its position yet"

    def _pause(self, now: float) -> _Verdict:
        authority = self._helm.authority
        if self._is_full and not authority.survey_started:
            self._wishes.keep_from_starting(now)
            return True, "the boat does not start before it is told to"
        hindrance = self._not_under_way()
        if hindrance is not None:
            return False, hindrance
        if self._is_released and self._wishes.hold(now):
            return True, "the boat holds, and is not set in motion"
        if self._homeward.is_returning:
            return False, "the boat is on its way home as it was asked to: resume the survey first"
        if self._situation.wish is Wish.PAUSE:
            return True, "it is paused already"
        if self._is_full:
            if not self._wishes.hold(now):
                return False, f"the boat can't be held: {authority.reason}"
            return True, "nothing is planned any more; the boat is told to hold"
        self._wishes.utter(Wish.PAUSE)
        return True, "nothing is planned any more; the boat sails its leg to the end, and stays there"

    def _resume(self, now: float) -> _Verdict:
        hindrance = self._not_under_way()
        if hindrance is not None:
            return False, hindrance
        if self._situation.wish is None:
            return True, "the survey goes on already"
        ended = self._situation.wish.value
        self._wishes.let_go(now)
        self._wishes.utter(None)
        self._replan = True
        return True, f"the survey goes on, from where the boat is (it was {ended})"

    def _plan_anew(self, _now: float) -> _Verdict:
        authority = self._helm.authority
        if authority.waits_on_board:
            authority.ask_for_another()
            return True, "another mission is put on board in place of the one that waits there"
        hindrance = self._not_under_way()
        if hindrance is not None:
            return False, hindrance
        if self._situation.wish is not None:
            return False, f"nothing is planned: {self._situation.wish.value}; resume the survey first"
        self._replan = True
        return True, "a new plan is made"

    def _finish(self, now: float) -> _Verdict:
        if self._homeward.is_finished or self._homeward.is_returning:
            return True, f"it ends already: {self._homeward.reason or 'the boat is on its way home'}"
        hindrance = self._not_under_way() or self._homeless()
        if hindrance is not None:
            return False, hindrance
        self._wishes.let_go(now)
        self._wishes.utter(Wish.FINISH)
        return True, "the present path is sailed to its end, and then the way home"

    def _return(self, now: float) -> _Verdict:
        authority = self._helm.authority
        if self._homeward.is_finished:
            return True, "the boat is home"
        if self._homeward.is_returning or authority.command in (Command.SENT_HOME, Command.RETURNING):
            return True, f"the boat is on its way home: {self._homeward.reason or authority.reason}"
        hindrance = self._not_under_way() or self._homeless()
        if hindrance is not None:
            return False, hindrance
        self._wishes.let_go(now)
        self._wishes.utter(Wish.RETURN)
        self._homeward.send(Wish.RETURN.value)
        return True, "the boat goes home at once, over water"

    def _homeless(self) -> str | None:
        """Why there is no way home; None if there is one."""
        vehicle, here_m = self._helm.state, self._helm.headway.position_m
        if vehicle is None or here_m is None:
            return "nobody knows where the boat is"
        if vehicle.home_deg is not None:
            self._homeward.told_home(self._seaway.water.frame.to_local(*vehicle.home_deg))
        if not self._homeward.knows_home:
            return "nobody knows where home is: set budget.home"
        try:
            self._homeward.way(here_m, self._seaway.water)
        except Unreachable as error:
            return f"the way home is not known: {error}"
        return None
