"""Links that go, and what is done without them: vehicle, probe, position."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.events import LinkDown
from sim.autopilot import MissionState, Mode

POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT


def mute(voyage: Any, *message_ids: int) -> None:
    """From now on these messages of the vehicle get lost on the way."""
    receive = type(voyage)._take

    def take(packets: list[tuple[Any, bytes]]) -> None:
        heard = [each for each in packets if int.from_bytes(each[1][7:10], "little") not in message_ids]
        receive(voyage, heard)

    voyage._take = take


def unmute(voyage: Any) -> None:
    del voyage._take


def test_a_vehicle_lost_for_an_hour_is_found_where_it_is_and_sails_on(voyage):
    """The plan is frozen: nothing is planned, and nothing is asked of a vehicle that is not there."""
    voyage.advance(100.0)
    plans, samples = len(voyage.plans), voyage.samples
    voyage.cut_link()
    voyage.advance(10.0)
    lost = voyage.now
    for _ in range(6):  # the shell dials for ever; each dial that fails is one more of these
        voyage.advance(600.0)
        voyage.happened(LinkDown("nobody answers"))
    assert voyage.traffic(since=lost) == []
    assert len(voyage.plans) == plans
    health = voyage.health
    assert (health.state, health.link_ok) == ("waiting_for_vehicle", False)
    assert voyage.autopilot.navigator.mission_state is MissionState.COMPLETE, "the boat sailed on by itself"
    voyage.restore_link()
    voyage.advance(30.0)
    assert len(voyage.plans) == plans + 1
    assert voyage.health.state == "exploring"
    voyage.advance(200.0)
    assert voyage.samples > samples


def test_a_vehicle_lost_while_its_job_runs_gets_no_plan_of_where_it_was(voyage):
    voyage.job_s = 30.0
    assert voyage.advance(1000.0, until=lambda: voyage.health.worker_busy)
    voyage.cut_link()
    plans = len(voyage.plans)
    voyage.advance(60.0)
    assert len(voyage.plans) == plans
    assert voyage.lines("the new plan is dropped")


def test_heartbeats_alone_are_no_vehicle_to_sail_with(make_voyage):
    """Without a position nothing is planned; why is said."""
    voyage = make_voyage()
    mute(voyage, POSITION)
    voyage.advance(60.0)
    assert not voyage.plans
    assert voyage.health.lat_deg is None
    assert "position" in voyage.health.reason
    unmute(voyage)
    voyage.start()


def test_without_a_new_position_nothing_is_learnt(voyage):
    """The probe goes on; where it measures nobody knows."""
    voyage.advance(100.0)
    mute(voyage, POSITION)
    voyage.advance(5.0)
    samples, plans = voyage.samples, len(voyage.plans)
    stale = voyage.now
    voyage.advance(400.0)
    assert voyage.samples == samples
    assert len(voyage.plans) == plans, "nor is anything planned from where the vessel no longer is"
    assert "position" in voyage.health.reason
    assert voyage.lines("position", since=stale)
    unmute(voyage)
    voyage.advance(100.0)
    assert voyage.samples > samples
    assert "position" not in voyage.health.reason


def test_a_probe_that_is_silent_is_told_and_its_plan_is_sailed_to_the_end_and_no_further(voyage):
    voyage.advance(100.0)
    sensor, voyage.autopilot.sensor = voyage.autopilot.sensor, None
    plans = len(voyage.plans)
    voyage.until("no reading named SALT comes in", patience_s=60.0)
    assert voyage.advance(3000.0, until=lambda: bool(voyage.lines("Mission Complete")))
    voyage.advance(300.0)
    assert voyage.autopilot.navigator.mission_state is MissionState.COMPLETE
    assert len(voyage.plans) == plans, "there is nothing new to plan with"
    assert voyage.autopilot.navigator.mode is Mode.AUTO
    sensor.taken = int(voyage.autopilot.vessel.time_s / sensor.interval_s)
    voyage.autopilot.sensor = sensor
    assert voyage.advance(60.0, until=lambda: len(voyage.plans) > plans)
    samples = voyage.samples
    voyage.advance(200.0)
    assert voyage.samples > samples
    assert "no reading" not in voyage.health.reason


@pytest.mark.parametrize("gone_s", [3.0, 20.0])
def test_a_vehicle_whose_heartbeat_fails_for_a_moment_keeps_its_plan(voyage, gone_s):
    voyage.advance(60.0)
    mission = voyage.on_board_m()
    mute(voyage, HEARTBEAT)
    voyage.advance(gone_s)
    assert bool(voyage.lines("has fallen silent")) == (gone_s > 5.0)
    unmute(voyage)
    voyage.advance(15.0)
    assert voyage.health.state == "exploring"
    assert (voyage.on_board_m() == mission).all()
