"""What people ashore may ask for, and what becomes of it: `start`, `pause`, `resume`, `replan`, `finish`, `return`.

Theory of operation. A directive never takes the boat: it changes what we do with it while it is ours. Whether it is
ours the authority's table says alone, so that the boat's own mode switch goes before every directive:

    the operator or a failsafe has the boat    everything is refused, and he gives it back by selecting AUTO
    he has taken it and given it back          what stood (pause, finish, return) is over: he has decided otherwise
    the budget brings it home                  it stays so; nothing is paused or resumed

What lasts is a wish, which `step` sees carried out, again if need be: pause (no plans; the mission on board is cut to
the leg being sailed, or in `full` the boat told to hold), finish (no plans; at the end of the present path home),
return (home at once). The newest replaces the one before, `resume` ends it.
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
from autonomy.mavlink.rover import AUTO, mode_name
from autonomy.planning.passage import Unreachable
from autonomy.planning.plan import Plan
from autonomy.reporting import Reporter
from autonomy.seaway import Seaway
from autonomy.situation import Situation, Wish

START_S = 60.0
"""A boat that has not started so long after `start`, or gone on after `resume`, does not: nobody expects it by then."""

AGAIN_S = 30.0
"""Pause before a leg that did not come on board is sent again."""

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
        self._authority_section = configuration.authority
        self._helm, self._seaway, self._homeward = helm, seaway, homeward
        self._course, self._situation, self._reporter = course, situation, reporter
        self._memory = CommandMemory()
        self._answers: list[tuple[float, CommandReceived, Outcome, str]] = []
        self._repeated: list[Answer] = []
        self._away = self._holds = False
        self._not_before = 0.0
        self._start_until: float | None = None
        self._go_on_until: float | None = None
        self._words: list[str] = []
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
        words, self._words = self._words, []
        return words

    def step(self, now: float) -> Plan | None:
        """See that what was asked for is done; returns a plan to bring on board."""
        helm = self._helm
        if helm.authority.in_command and helm.position_m is not None:
            self._homeward.begins_at(helm.position_m)
        self._watch_start(now)
        self._watch_going_on(now)
        wish = self._situation.wish
        if wish is None:
            return None
        if not helm.authority.survey_started:
            # Its autopilot began anew, or its mission was cleared: another comes on board, and nobody has let it go on.
            if self._authority_section.mode == "full":
                helm.authority.allow_start(False)
            self._end("the survey has to be started again")
        elif self._was_taken():
            self._end("the operator has taken the boat and given it back")
        elif self._homeward.reason and not self._homeward.is_sent:
            if wish is not Wish.RETURN:
                self._end(self._homeward.reason)
        elif wish is Wish.FINISH and helm.path_finished:
            self._homeward.send(Wish.FINISH.value)
        elif wish is Wish.PAUSE:
            return self._cut(now)
        return None

    def _watch_start(self, now: float) -> None:
        """Told to start, a boat does so once, and not when nobody expects it any more."""
        authority = self._helm.authority
        if self._start_until is None or not (authority.survey_started or now >= self._start_until):
            return
        self._start_until = None
        authority.allow_start(False)
        if not authority.survey_started:
            self._warn(f"not started in {START_S:.0f} s", "it waits for another start")

    def _watch_going_on(self, now: float) -> None:
        """A boat that holds, and was told to go on, does so soon or not at all."""
        authority, vehicle = self._helm.authority, self._helm.state
        if self._go_on_until is None or vehicle is None:
            return
        if authority.command is not Command.HELD:
            self._go_on_until = None
            if not authority.survey_started:
                authority.allow_start(False)  # begun anew, or its mission was cleared: that was not asked for
        elif now >= self._go_on_until:
            self._go_on_until = None
            authority.hold_again(vehicle)
            self._wish(Wish.PAUSE)
            self._holds = True
            self._warn(f"not gone on in {START_S:.0f} s", "it holds again")

    def _warn(self, problem: str, consequence: str) -> None:
        self._reporter.log(Level.WARNING, f"the boat has {problem}: {consequence}")
        self._words.append(problem)

    def _was_taken(self) -> bool:
        """Whether somebody has taken the boat since the wish was uttered, or selected AUTO while it held."""
        authority, vehicle = self._helm.authority, self._helm.state
        ours = authority.in_command or authority.is_held
        if vehicle is not None and not ours and (vehicle.mode != AUTO or not vehicle.armed):
            self._away = True
        let_go = self._holds and self._situation.wish is Wish.PAUSE
        return authority.in_command and (self._away or let_go)

    def _cut(self, now: float) -> Plan | None:
        """The leg being sailed, if more than that is on board."""
        helm = self._helm
        if helm.dispatch.busy or now < self._not_before or not (helm.sailing_ours or helm.has_damaged_ours):
            return None
        leg = self._course.leg(Wish.PAUSE.value)
        if leg is not None:
            self._not_before = now + AGAIN_S
        return leg

    def _wish(self, wish: Wish | None) -> None:
        if self._situation.wish is not wish:
            self._homeward.call_off()
        self._situation.wish = wish
        self._away, self._holds, self._not_before = False, False, 0.0

    def _end(self, reason: str) -> None:
        assert self._situation.wish is not None
        text = f"{self._situation.wish.value}: that is over: {reason}"
        self._reporter.log(Level.INFO, text)
        self._wish(None)

    # The verbs ------------------------------------------------------------------------------------------------

    def _verdict(self, now: float, verb: str) -> _Verdict:
        hindrance = self._hindrance()
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

    def _hindrance(self) -> str | None:
        """Why nothing at all can be asked of the boat now."""
        authority = self._helm.authority
        if not self._situation.in_touch:
            return self._situation.reason
        if authority.command is Command.OBSERVED:
            return "we only look on: authority.mode is observe"
        if authority.command in (Command.YIELDED, Command.DISPLACED):
            return f"the boat is not ours: {authority.reason}"
        if authority.command is Command.STOPPING:
            return "the boat is being told to hold: ask again in a few seconds"
        if authority.command is Command.HELD and authority.action is Action.SELECT_AUTO:
            return "the boat is being set in motion again: ask again in a few seconds"
        return None

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
        if self._authority_section.mode != "full":
            return False, "authority.mode is missions: the operator arms the boat and selects AUTO"
        if authority.was_ever_taken:
            return False, "the operator has taken the boat: he starts it again himself"
        if vehicle is None or not authority.is_ready(vehicle):
            return False, f"it is not ready: {self._unready()}"
        if authority.waits_for_start or self._start_until is not None:
            self._start_until = now + START_S
        authority.allow_start(True)
        return True, "AUTO is selected and the boat armed"

    def _unready(self) -> str:
        if self._helm.authority.on_board is not OnBoard.OURS or not self._helm.authority.waits_on_board:
            return "no mission of ours is verified on board yet"
        return "the autopilot is not sure of its position yet"

    def _pause(self, _now: float) -> _Verdict:
        authority, vehicle = self._helm.authority, self._helm.state
        is_full = self._authority_section.mode == "full"
        if is_full and not authority.survey_started:
            authority.allow_start(False)
            self._start_until = None
            return True, "the boat does not start before it is told to"
        hindrance = self._not_under_way()
        if hindrance is not None:
            return False, hindrance
        if self._homeward.is_returning:
            return False, "the boat is on its way home as it was asked to: resume the survey first"
        if self._situation.wish is Wish.PAUSE:
            return True, "it is paused already"
        if is_full:
            if vehicle is None or not authority.hold(vehicle):
                return False, f"the boat can't be held: {authority.reason}"
            self._wish(Wish.PAUSE)
            self._holds = True
            return True, "nothing is planned any more; the boat is told to hold"
        self._wish(Wish.PAUSE)
        return True, "nothing is planned any more; the boat sails its leg to the end, and stays there"

    def _resume(self, now: float) -> _Verdict:
        hindrance = self._not_under_way()
        if hindrance is not None:
            return False, hindrance
        if self._situation.wish is None:
            return True, "the survey goes on already"
        ended = self._situation.wish.value
        self._let_go(now)
        self._wish(None)
        self._replan = True
        return True, f"the survey goes on, from where the boat is (it was {ended})"

    def _let_go(self, now: float) -> None:
        """A boat that holds is set in motion again."""
        authority, vehicle = self._helm.authority, self._helm.state
        if vehicle is not None and authority.command is Command.HELD:
            authority.release(vehicle)
            self._go_on_until = now + START_S

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
        self._let_go(now)
        self._wish(Wish.FINISH)
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
        self._let_go(now)
        self._wish(Wish.RETURN)
        self._homeward.send(Wish.RETURN.value)
        return True, "the boat goes home at once, over water"

    def _homeless(self) -> str | None:
        """Why there is no way home; None if there is one."""
        vehicle, here_m = self._helm.state, self._helm.position_m
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
