"""What people ashore want: what is given up and when, and what ends it. The helm is real, the rest stands still."""

from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.mavlink.authority_table import Command
from autonomy.situation import Wish
from autonomy.wishes import AGAIN_S, HEED_S, Wishes

from .test_helm import AREA, AUTO, HOLD, Boat

NO_MISSION = 1


class Ashore:
    """A boat under way, and the wishes of those who look after it."""

    def __init__(self, mode):
        authority = {"mode": mode, "return_battery": 0.5 if mode == "full" else None}
        self.boat = Boat(authority=authority).sails()
        self.authority = self.boat.helm.authority
        self.situation = SimpleNamespace(wish=None, in_touch=True)
        self.sent_home, self.log = [], []
        homeward = SimpleNamespace(
            reason="",
            is_sent=False,
            begins_at=lambda _: None,
            call_off=lambda: None,
            send=self.sent_home.append,
        )
        course = SimpleNamespace(leg=lambda reason: f"a leg: {reason}")
        reporter = SimpleNamespace(log=lambda _, text: self.log.append(text))
        configuration = Configuration.model_validate({"survey": {"area": AREA}, "authority": authority})
        self.wishes = Wishes(configuration, self.boat.helm, homeward, course, self.situation, reporter)

    def passes(self, seconds, mode=AUTO, *, armed=True):
        """Time passes, second by second, while the autopilot tells its mode; returns the plans that are brought."""
        plans = []
        for _ in range(seconds):
            self.boat.now += 1.0
            if self.situation.in_touch:
                self.boat.beats(mode, armed=armed)
            plans.append(self.wishes.step(self.boat.now))
        return [plan for plan in plans if plan is not None]


@pytest.fixture
def full():
    return Ashore("full")


@pytest.fixture
def missions():
    return Ashore("missions")


def test_an_autopilot_that_is_not_heard_is_not_taken_to_disobey(full):
    assert full.wishes.hold(full.boat.now)
    full.passes(round(HEED_S) - 10)
    full.situation.in_touch = False
    full.passes(100)
    full.situation.in_touch = True
    full.passes(round(HEED_S) - 10)
    assert full.authority.command is Command.STOPPING
    full.passes(20)
    assert (full.authority.command, full.situation.wish) == (Command.OURS, Wish.PAUSE)
    assert full.wishes.take_words() == ["does not hold: it ends its leg"]


def test_an_order_in_place_of_another_has_its_own_time(full):
    assert full.wishes.hold(full.boat.now)
    full.passes(round(HEED_S) - 10)
    full.boat.hear(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, -1, 40, 0, 0, 0, 0, 0, 0))
    full.passes(round(HEED_S) - 10)
    assert full.authority.command is Command.SENT_HOME
    assert full.sent_home == []
    full.passes(20)
    assert len(full.sent_home) == 1


def test_what_is_let_go_and_loses_its_mission_waits_to_be_started(full):
    assert full.wishes.hold(full.boat.now)
    full.passes(5, HOLD)
    assert full.authority.command is Command.HELD
    full.wishes.let_go(full.boat.now)
    full.wishes.utter(None)
    full.boat.tells_current(0, state=NO_MISSION)
    full.passes(2, HOLD)
    assert full.authority.command is Command.BEFORE_START
    assert not full.authority.was_ever_taken
    assert full.authority.waits_for_start


def test_a_leg_that_does_not_come_on_board_is_sent_again_after_a_pause(missions):
    missions.wishes.utter(Wish.PAUSE)
    assert len(missions.passes(round(AGAIN_S))) == 1
    assert len(missions.passes(round(AGAIN_S))) == 1


@pytest.mark.parametrize(("mode", "armed"), [(AUTO, False), (HOLD, True)])
def test_who_takes_the_boat_and_gives_it_back_has_decided_otherwise(missions, mode, armed):
    missions.wishes.utter(Wish.FINISH)
    missions.passes(5)
    assert missions.situation.wish is Wish.FINISH
    missions.passes(2, mode, armed=armed)
    missions.passes(2)
    assert missions.situation.wish is None
    assert any("the operator has taken the boat and given it back" in line for line in missions.log)
