"""What the configuration lets us do with the boat, and how it is given back."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.effects import Outcome
from autonomy.events import MessageReceived
from sim.autopilot import Mode

from .conftest import boat
from .test_checkpoint import restart
from .test_directives import told


def test_in_full_the_boat_is_started_and_sent_home_once(make_voyage):
    voyage = make_voyage(boat(ready_after_s=30.0), authority={"mode": "full", "return_battery": 0.5})
    voyage.advance(29.0)
    assert not voyage.autopilot.navigator.armed
    assert voyage.advance(30.0, until=lambda: bool(voyage.lines("exploring")))
    assert voyage.autopilot.navigator.mode is Mode.AUTO
    voyage.advance(60.0)
    battery = voyage.autopilot.vessel.battery
    battery.used_wh = 0.6 * battery.capacity_wh
    voyage.until("returning: on its way home (RTL)", patience_s=20.0)
    assert voyage.autopilot.navigator.mode is Mode.RTL
    returning = voyage.now
    voyage.advance(60.0)
    assert voyage.traffic(since=returning) == []
    voyage.select(Mode.AUTO)  # the operator has decided otherwise
    voyage.until("exploring: in AUTO under our mission")
    voyage.advance(60.0)
    assert voyage.autopilot.navigator.mode is Mode.AUTO


def test_in_full_a_boat_that_was_taken_is_not_started_again(make_voyage):
    voyage = make_voyage(authority={"mode": "full"})
    voyage.until("exploring: in AUTO under our mission", patience_s=60.0)
    voyage.select(Mode.HOLD)
    voyage.arm(armed=False)
    voyage.advance(5.0)
    taken = voyage.now
    voyage.advance(120.0)
    assert voyage.traffic(since=taken) == []
    assert voyage.autopilot.navigator.mode is Mode.HOLD
    assert not voyage.autopilot.navigator.armed


def lose_heartbeats(voyage, duration_s):
    """The autopilot's own; all else gets through."""
    take, end = voyage._take, voyage.now + duration_s
    heartbeat = bytes(3)  # the number of the message: the eighth to the tenth byte of a MAVLink 2 packet
    voyage._take = lambda packets: take(
        [each for each in packets if voyage.now > end or each[1][7:10] != heartbeat]
    )


def lose(voyage, duration_s, *kinds):
    """Messages of these kinds do not reach the service for a while."""
    happened, end = voyage.happened, voyage.now + duration_s

    def heard(event):
        lost = isinstance(event, MessageReceived) and event.message.get_type() in kinds
        if not lost or voyage.now > end:
            happened(event)

    voyage.happened = heard


STARTS = (mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
STAMPED = ("SYSTEM_TIME", "GLOBAL_POSITION_INT", "NAMED_VALUE_FLOAT")
ORDERS = {
    "heartbeat first": (True, 3.5, *STAMPED),
    "clock first": (False, 3.5, "HEARTBEAT"),
    "heartbeats lost": (True, 4.5, "HEARTBEAT"),
    "silence": (False, 12.0, "HEARTBEAT", *STAMPED),
    "clock long after": (True, 12.0, *STAMPED),
}
"""What is heard after a reboot: whether the mission is still on board, and what is lost for how long."""


@pytest.mark.parametrize("order", ORDERS)
def test_in_full_a_boat_whose_autopilot_began_anew_under_way_waits_to_be_started(make_voyage, order):
    keep_mission, duration_s, *lost = ORDERS[order]
    voyage = make_voyage(
        authority={"mode": "full"},
        shore={"commands": {"token_file": "boat1.token"}},
    )
    voyage.until("exploring: in AUTO under our mission", patience_s=60.0)
    voyage.advance(15.3)
    lose(voyage, duration_s, *lost)
    voyage.reboot(keep_mission=keep_mission)
    booted = voyage.now
    voyage.advance(80.0)
    assert not voyage.autopilot.navigator.armed
    assert not [each for each in voyage.said("COMMAND_LONG", since=booted) if each.command in STARTS]
    assert voyage.lines("the autopilot has started again", since=booted)
    words = [str(each.text) for each in voyage.said("STATUSTEXT", since=booted)]
    assert sum("autopilot restarted: arm, select AUTO" in each for each in words) == 1
    assert voyage.health.state == "waiting_for_vehicle"
    assert "arm and select AUTO, or for `start` from ashore" in voyage.health.reason
    assert told(voyage, "start").outcome is Outcome.DONE
    voyage.until("exploring: in AUTO under our mission", patience_s=60.0)


def test_in_full_a_boat_that_breaks_down_as_it_is_armed_is_not_armed_again(make_voyage):
    """The motor draws more than the supply gives: nobody has seen it armed."""
    voyage = make_voyage(boat(ready_after_s=10.0), authority={"mode": "full"})
    assert voyage.advance(60.0, until=lambda: voyage.autopilot.navigator.armed)
    assert not voyage.core._helm.state.armed
    voyage.autopilot.reboot(voyage.now)
    assert not voyage.advance(80.0, until=lambda: voyage.autopilot.navigator.armed)


@pytest.mark.parametrize("away_s", [0.0, 30.0])
@pytest.mark.parametrize("mode", ["missions", "full"])
def test_who_clears_the_mission_out_of_auto_has_taken_the_boat(make_voyage, mode, away_s):
    """He gets another on board, or he could not select AUTO; but nothing starts before he does.

    That the mission is gone may be heard before the mode: a heartbeat is lost, or the service was away.
    """
    voyage = make_voyage(authority={"mode": mode})
    voyage.start()
    voyage.advance(30.0)
    memory = voyage.core.checkpoint()
    lose_heartbeats(voyage, away_s + 2.5)
    voyage.select(Mode.HOLD)
    voyage.operate(mavlink.MAVLink_mission_clear_all_message(1, 1))
    if away_s:
        restart(voyage, memory, away_s)
    voyage.until("verified on board", patience_s=60.0)
    voyage.advance(120.0)
    assert voyage.autopilot.navigator.mode is Mode.HOLD
    assert voyage.core._helm.authority.was_ever_taken
    assert voyage.health.state == "waiting_for_vehicle"
    voyage.select(Mode.AUTO)
    voyage.until("exploring: in AUTO under our mission", patience_s=30.0)


def test_with_resume_never_auto_does_not_give_the_boat_back(make_voyage):
    voyage = make_voyage(authority={"resume": "never"})
    voyage.start()
    voyage.select(Mode.HOLD)
    voyage.advance(10.0)
    taken, samples = voyage.now, voyage.samples
    voyage.select(Mode.AUTO)
    voyage.advance(200.0)
    assert voyage.traffic(since=taken) == []
    assert voyage.health.state == "yielded"
    assert "authority.resume: never" in voyage.health.reason
    assert voyage.samples > samples, "learning goes on"


def test_why_we_yield_is_said_to_the_operator(voyage):
    voyage.advance(30.0)
    voyage.select(Mode.MANUAL)
    voyage.advance(3.0)
    assert "the operator has the boat (MANUAL)" in str(voyage.said("STATUSTEXT")[-1].text)
