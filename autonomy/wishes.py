"""What people ashore want of the boat and what lasts, seen carried out as long as it is wanted.

Theory of operation. A wish is one of three, and `step` sees to it, again if need be: pause (no plans; the mission on
board is cut to the leg being sailed, or in `full` the boat is told to hold), finish (no plans; at the end of the
present path home), return (home at once). The newest replaces the one before. It is over when

    the operator has taken the boat and given it back    he has decided otherwise
    the budget brings it home
    the autopilot began anew, or its mission was cleared

What is to move a boat (`start`, the end of a pause in `full`) does so within a minute, or not at all. What is to stop
it or to bring it home, and does not within a minute, is given up, and had by way of a mission, as without `full`.
"""

from autonomy.config import Configuration
from autonomy.course import Course
from autonomy.effects import Level
from autonomy.helm import Helm
from autonomy.homeward import Homeward
from autonomy.mavlink.authority_table import Action, Command
from autonomy.mavlink.rover import AUTO
from autonomy.planning.plan import Plan
from autonomy.reporting import Reporter
from autonomy.situation import Situation, Wish

START_S = 60.0
"""A boat that has not started so long after `start`, or gone on after `resume`, does not: nobody expects it by then."""

IN_FLIGHT_S = 5.0
"""A boat that moves so soon after it was kept from moving does so by an order of ours that was under way, not by
anybody's will."""

HEED_S = 60.0
"""An autopilot that has not done so long what it was told does not do it."""

NOT_BROUGHT = "the autopilot was told to bring the boat home, and has not"

AGAIN_S = 30.0
"""Pause before a leg that did not come on board is sent again."""


class Wishes:
    """See the module's description. All that it is given belongs to the core."""

    def __init__(
        self,
        configuration: Configuration,
        helm: Helm,
        homeward: Homeward,
        course: Course,
        situation: Situation,
        reporter: Reporter,
    ) -> None:
        self._is_full = configuration.authority.mode == "full"
        self._helm, self._homeward, self._course = helm, homeward, course
        self._situation, self._reporter = situation, reporter
        self._away = self._has_held = False
        self._not_before = 0.0
        self._start_until: float | None = None
        self._go_on_until: float | None = None
        self._in_flight_until = 0.0
        self._told: tuple[Command, float] | None = None
        self._words: list[str] = []

    # What is wanted -------------------------------------------------------------------------------------------

    def utter(self, wish: Wish | None) -> None:
        """From now on this is wanted, or nothing any more."""
        if self._situation.wish is not wish:
            self._homeward.call_off()
        self._situation.wish = wish
        self._away, self._has_held, self._not_before = False, False, 0.0

    def let_start(self, now: float) -> None:
        """A boat that waits for its start may start by itself, once, and not when nobody expects it any more."""
        authority = self._helm.authority
        if authority.waits_for_start or self._start_until is not None:
            self._start_until = now + START_S
        authority.allow_start(True)

    def keep_from_starting(self, now: float) -> None:
        """It may not."""
        self._mind_orders(now)
        self._helm.authority.allow_start(False)
        self._start_until = None

    def hold(self, now: float) -> bool:
        """A boat that is ours, or about to be set in motion, is paused, and told to hold; returns whether it is."""
        authority, vehicle = self._helm.authority, self._helm.state
        self._mind_orders(now)
        if vehicle is None or not authority.hold(vehicle):
            return False
        self._go_on_until = None
        self.utter(Wish.PAUSE)
        return True

    def let_go(self, now: float) -> None:
        """A boat that holds is set in motion again."""
        authority, vehicle = self._helm.authority, self._helm.state
        if vehicle is not None and authority.command is Command.HELD:
            authority.release(vehicle)
            self._go_on_until = now + START_S

    def _mind_orders(self, now: float) -> None:
        """An order to move may be on its way to the autopilot."""
        if self._helm.authority.action in (Action.SELECT_AUTO, Action.ARM):
            self._in_flight_until = now + IN_FLIGHT_S

    # What becomes of it ---------------------------------------------------------------------------------------

    def take_words(self) -> list[str]:
        """What the operator at the boat must hear, since the last call."""
        words, self._words = self._words, []
        return words

    def step(self, now: float) -> Plan | None:
        """See that what is wanted is done; returns a plan to bring on board."""
        helm = self._helm
        if helm.authority.in_command and helm.headway.position_m is not None:
            self._homeward.begins_at(helm.headway.position_m)
        self._watch_start(now)
        self._watch_going_on(now)
        self._watch_orders(now)
        wish = self._situation.wish
        self._has_held = self._has_held or helm.authority.command is Command.HELD
        if wish is None:
            return None
        if not helm.authority.survey_started:
            # Its autopilot began anew, or its mission was cleared: another comes on board, and nobody has let it go on.
            if self._is_full:
                helm.authority.allow_start(False)
            self._end("the survey has to be started again")
        elif self._was_taken():
            self._end("the operator has taken the boat and given it back")
        elif self._homeward.reason and not self._homeward.is_sent:
            if wish is not Wish.RETURN:
                self._end(self._homeward.reason)
        elif wish is Wish.FINISH and helm.headway.path_finished:
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
            self._warn(f"has not started in {START_S:.0f} s: it waits for another start", "not started")

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
            self.utter(Wish.PAUSE)
            self._warn(f"has not gone on in {START_S:.0f} s: it holds again", "not gone on: it holds")

    def _watch_orders(self, now: float) -> None:
        """An order that was under way is undone; one that the autopilot does not follow is given up."""
        authority, vehicle = self._helm.authority, self._helm.state
        if vehicle is None:
            return
        if now < self._in_flight_until and authority.in_command and self.hold(now):
            self._warn("has moved off all the same: it is told to hold", "moved off: it is told to hold")
        command = authority.command
        if command not in (Command.STOPPING, Command.SENT_HOME) or not self._situation.in_touch:
            self._told = None
        elif self._told is None or self._told[0] is not command:
            self._told = (command, now)
        elif now >= self._told[1] + HEED_S:
            authority.give_up_order(vehicle)
            if command is Command.SENT_HOME:
                self.utter(Wish.RETURN)
                self._homeward.send(NOT_BROUGHT)
                text = "is not brought home by the autopilot: it sails home by a mission"
                self._warn(text, "not brought home: sails a mission home")
            else:
                text = "does not hold: it sails its leg to the end, and stays there"
                self._warn(text, "does not hold: it ends its leg")

    def _warn(self, text: str, words: str) -> None:
        """For the log, and in fewer words for the operator."""
        self._reporter.log(Level.WARNING, f"the boat {text}")
        self._words.append(words)

    def _was_taken(self) -> bool:
        """Whether somebody has taken the boat since the wish was uttered, or selected AUTO while it held."""
        authority, vehicle = self._helm.authority, self._helm.state
        ours = authority.in_command or authority.is_held
        if vehicle is not None and not ours and (vehicle.mode != AUTO or not vehicle.armed):
            self._away = True
        let_go = self._has_held and self._situation.wish is Wish.PAUSE
        return authority.in_command and (self._away or let_go)

    def _cut(self, now: float) -> Plan | None:
        """The leg being sailed, if more than that is on board."""
        headway = self._helm.headway
        sails = headway.sailing_ours or headway.has_damaged_ours
        if self._helm.dispatch.busy or now < self._not_before or not sails:
            return None
        leg = self._course.leg(Wish.PAUSE.value)
        if leg is not None:
            self._not_before = now + AGAIN_S
        return leg

    def _end(self, reason: str) -> None:
        assert self._situation.wish is not None
        text = f"{self._situation.wish.value}: that is over: {reason}"
        self._reporter.log(Level.INFO, text)
        self.utter(None)
