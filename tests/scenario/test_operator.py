"""The operator has the last word: he takes the boat, gives it back, and brings missions of his own."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.events import MessageReceived
from autonomy.mavlink.codec import Codec
from sim.autopilot import Mode
from sim.vessel import UniformCurrent

from .conftest import boat

THEIRS = [(400.0, 400.0), (800.0, 500.0), (600.0, 2000.0)]


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.MANUAL, Mode.LOITER, Mode.RTL, Mode.GUIDED])
def test_nothing_is_said_while_the_operator_has_the_boat(voyage, mode):
    voyage.advance(150.0)
    voyage.select(mode)
    voyage.advance(3.0)
    taken, plans = voyage.now, len(voyage.plans)
    voyage.advance(400.0)
    assert voyage.traffic(since=taken) == []
    assert len(voyage.plans) == plans
    assert voyage.health.state == "yielded"
    assert f"the operator has the boat ({mode.name})" in voyage.health.reason
    assert voyage.autopilot.navigator.mode is mode


def test_given_back_the_boat_reads_its_mission_and_sails_on(voyage):
    voyage.advance(100.0)
    mission = voyage.on_board_m()
    voyage.select(Mode.HOLD)
    voyage.advance(60.0)
    current, verified = voyage.autopilot.navigator.current, voyage.verified
    voyage.select(Mode.AUTO)
    given = voyage.now
    voyage.advance(20.0)
    assert voyage.traffic(since=given).count("MISSION_REQUEST_LIST") == 1
    assert not voyage.said("MISSION_COUNT", since=given)
    assert voyage.verified == verified
    assert (voyage.on_board_m() == mission).all()
    assert voyage.autopilot.navigator.current == current
    assert voyage.health.state == "exploring"
    voyage.until("rho 1.00 > 0.60")


def test_learning_goes_on_while_the_operator_sails(voyage):
    voyage.advance(100.0)
    voyage.select(Mode.GUIDED)
    before = voyage.samples
    voyage.autopilot.navigator.guide_to(voyage.autopilot.store[len(voyage.autopilot.store) - 1].position)
    voyage.advance(150.0)
    assert voyage.samples > before + 8
    assert voyage.health.state == "yielded"


def test_taken_in_the_middle_of_an_upload(voyage):
    voyage.stall_upload_after(2)
    voyage.until_sent("MISSION_ITEM_INT", 3)
    voyage.select(Mode.HOLD)
    voyage.advance(1.0)
    taken = voyage.now
    voyage.unstall()
    voyage.advance(120.0)
    assert voyage.traffic(since=taken) == []
    assert voyage.said("MISSION_ACK")[-1].type == 15  # our last word: the upload is cancelled
    voyage.select(Mode.AUTO)
    voyage.until("mission on board damaged")
    assert voyage.lines("an upload of ours failed half-way")
    assert voyage.advance(60.0, until=lambda: voyage.on_board_m().shape == voyage.plan_m().shape)
    assert voyage.autopilot.navigator.current == 1
    assert voyage.health.state == "exploring"


def test_a_job_that_ends_after_the_boat_was_taken_brings_no_mission(voyage):
    voyage.job_s = 20.0
    assert voyage.advance(1000.0, until=lambda: voyage.health.worker_busy)
    voyage.select(Mode.HOLD)
    voyage.until("the new plan is dropped")
    taken = voyage.now
    assert voyage.lines("re-estimated")  # what was learnt is kept
    assert len(voyage.plans) == 1
    voyage.advance(100.0)
    assert voyage.traffic(since=taken) == []
    voyage.select(Mode.AUTO)
    voyage.until("plan 2")
    assert voyage.health.state == "exploring"


def test_an_unknown_mission_is_never_overwritten(make_voyage):
    voyage = make_voyage()
    voyage.upload_as_operator(*THEIRS)
    theirs = voyage.on_board_m()
    voyage.advance(200.0)
    assert len(theirs) == 3
    assert (voyage.on_board_m() == theirs).all()
    assert not voyage.said("MISSION_COUNT")
    assert "a mission we don't know is on board: set mavlink.adopt: true" in voyage.health.reason
    assert voyage.traffic(since=voyage.now - 100.0) == []
    voyage.arm()
    voyage.select(Mode.AUTO)
    voyage.advance(100.0)
    assert (voyage.on_board_m() == theirs).all()
    assert voyage.samples == 0


def test_with_adopt_an_unknown_mission_is_replaced(make_voyage):
    voyage = make_voyage(mavlink={"adopt": True, "acceptance_radius_m": 15.0})
    voyage.upload_as_operator(*THEIRS)
    voyage.until("verified on board")
    assert (abs(voyage.on_board_m() - voyage.plan_m()) < 0.05).all()
    voyage.start()
    assert voyage.health.state == "exploring"


def test_with_adopt_a_mission_under_way_is_taken_over(make_voyage):
    voyage = make_voyage(mavlink={"adopt": True})
    voyage.upload_as_operator(*THEIRS)
    voyage.arm()
    voyage.select(Mode.AUTO)
    voyage.until("verified on board")
    assert voyage.autopilot.navigator.mode is Mode.AUTO
    assert (abs(voyage.on_board_m() - voyage.plan_m()) < 0.05).all()
    voyage.until("rho 1.00 > 0.60")


@pytest.mark.parametrize("adopt", [False, True])
@pytest.mark.parametrize("length", ["shorter", "equal", "longer"])
def test_a_mission_put_on_board_under_way_holds(make_voyage, adopt, length):
    voyage = make_voyage(mavlink={"adopt": adopt})
    voyage.start()
    voyage.advance(60.0)
    count = len(voyage.on_board_m()) + {"shorter": -2, "equal": 0, "longer": 3}[length]
    voyage.upload_as_operator(*[(200.0 + 90.0 * k, 300.0) for k in range(count)])
    theirs = voyage.on_board_m()
    plans, verified = len(voyage.plans), voyage.verified
    voyage.until("yielded")
    assert "another mission on board in place of ours" in voyage.health.reason
    yielded = voyage.now
    voyage.advance(300.0)
    assert (voyage.on_board_m() == theirs).all()
    assert voyage.verified == verified
    assert len(voyage.plans) <= plans + 1
    assert voyage.traffic(since=yielded) == []


@pytest.mark.parametrize("begins", [(200.0, 300.0), (2800.0, 2000.0)])
def test_a_mission_of_the_same_length_is_noticed_by_where_the_boat_sails(voyage, begins):
    """Its number of items does not tell, and without a new plan nothing of ours would read it before it is sailed."""
    voyage.advance(60.0)
    x, y = begins
    voyage.upload_as_operator(*[(x, y - 80.0 * k) for k in range(len(voyage.on_board_m()))])
    theirs, uploaded = voyage.on_board_m(), voyage.now
    assert voyage.advance(10.0, until=lambda: bool(voyage.lines("yielded", since=uploaded)))
    assert voyage.lines("m to waypoint", since=uploaded)
    assert "another mission on board in place of ours" in voyage.health.reason
    assert any("another mission" in str(each.text) for each in voyage.said("STATUSTEXT", since=uploaded))
    assert set(voyage.traffic(since=uploaded)) <= {
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST_INT",
        "MISSION_ACK",
    }
    yielded = voyage.now
    voyage.advance(900.0)
    assert voyage.traffic(since=yielded) == []
    assert (voyage.on_board_m() == theirs).all()


def test_without_distances_it_is_noticed_by_where_its_first_waypoint_is_reached(voyage):
    take = voyage._take
    nav_controller_output = 62  # its low byte is the eighth of a MAVLink 2 packet
    voyage._take = lambda packets: take([each for each in packets if each[1][7] != nav_controller_output])
    voyage.advance(20.0)
    x, y = voyage.core.position_m
    voyage.upload_as_operator(*[(x + 150.0, y + 60.0 * k) for k in range(len(voyage.on_board_m()))])
    voyage.until("Reached waypoint", patience_s=60.0)
    reached = voyage.now
    assert voyage.advance(10.0, until=lambda: bool(voyage.lines("yielded", since=reached - 1.0)))
    assert voyage.lines("m from ours: reading the mission on board")


def test_an_undisturbed_mission_is_not_read_for_nothing(make_voyage):
    """Once at the start; before and after each upload; and every ten minutes."""
    voyage = make_voyage(boat(current=UniformCurrent(1.5, -1.0)), planning={"hold_s": 4.0})
    voyage.start()
    voyage.advance(1500.0)
    lists = [each for each in voyage.said("MISSION_REQUEST_LIST") if each.mission_type == 0]
    assert voyage.verified >= 2
    assert voyage.lines("reading the mission on board") == []
    assert len(lists) <= 1 + 2 * voyage.verified + 2
    assert voyage.autopilot.navigator.mode is Mode.AUTO
    assert voyage.health.state == "exploring"


def test_a_mission_put_on_board_before_the_start_holds_too(make_voyage):
    voyage = make_voyage(mavlink={"adopt": True})
    voyage.advance(30.0)
    assert voyage.verified == 1
    voyage.upload_as_operator(*THEIRS)
    theirs = voyage.on_board_m()
    voyage.advance(10.0)
    read = voyage.now
    voyage.advance(200.0)
    assert (voyage.on_board_m() == theirs).all()
    assert voyage.traffic(since=read) == []
    assert "another mission on board in place of ours" in voyage.health.reason


def test_a_mission_cleared_before_the_start_is_put_on_board_again(make_voyage):
    voyage = make_voyage()
    voyage.advance(30.0)
    voyage.upload_as_operator()
    voyage.until("verified on board")
    voyage.start()
    assert voyage.health.state == "exploring"


def test_a_mission_cleared_under_way_is_replaced_so_that_the_boat_can_be_given_back(voyage):
    """AUTO is refused without a mission, so an operator who cleared it could not give the boat back."""
    voyage.advance(100.0)
    voyage.select(Mode.HOLD)
    voyage.advance(5.0)
    samples, verified = voyage.samples, voyage.verified
    voyage.operate(mavlink.MAVLink_mission_clear_all_message(1, 1))
    assert voyage.advance(60.0, until=lambda: voyage.verified > verified)
    assert voyage.autopilot.navigator.mode is Mode.HOLD
    voyage.select(Mode.AUTO)
    voyage.advance(60.0)
    assert voyage.health.state == "exploring"
    assert voyage.samples > samples, "what was learned is kept, and more is"


def test_an_operator_who_is_uploading_goes_first(make_voyage):
    voyage = make_voyage()
    voyage.advance(1.5)
    voyage.announce_as_operator(4)
    voyage.until("plan 1")
    voyage.advance(3.0)
    voyage.upload_as_operator(*THEIRS)
    theirs = voyage.on_board_m()
    voyage.advance(120.0)
    assert (voyage.on_board_m() == theirs).all()
    assert voyage.verified == 0
    assert "a mission we don't know is on board" in voyage.health.reason


def test_a_failsafe_has_the_boat(voyage):
    voyage.advance(100.0)
    voyage.operate(_ground_station_heartbeat())
    voyage.autopilot.parameters.set("FS_GCS_ENABLE", 1.0)
    voyage.autopilot.parameters.set("FS_ACTION", 0.0)
    voyage.until("a failsafe has the boat")
    struck = voyage.now
    assert voyage.autopilot.navigator.mode is Mode.AUTO
    voyage.advance(200.0)
    assert voyage.traffic(since=struck) == []
    voyage.autopilot.parameters.set("FS_GCS_ENABLE", 0.0)
    voyage.until("exploring: in AUTO under our mission")


def test_a_mode_that_flaps_does_not_fill_the_operators_screen(voyage):
    voyage.advance(30.0)
    begun = voyage.now
    for k in range(60):
        voyage.select(Mode.AUTO if k % 2 else Mode.HOLD)
        voyage.advance(1.1)
    words = [each for each in voyage.said("STATUSTEXT", begun) if "operator has the boat" in str(each.text)]
    assert 2 <= len(words) <= 5, "one in twenty seconds"
    voyage.select(Mode.AUTO)
    voyage.advance(30.0)
    assert voyage.health.state == "exploring"


def test_disarmed_in_auto_and_armed_again(voyage):
    voyage.advance(100.0)
    voyage.arm(armed=False)
    voyage.until("the operator has the boat (AUTO, disarmed)")
    disarmed = voyage.now
    voyage.advance(100.0)
    assert voyage.traffic(since=disarmed) == []
    voyage.arm()
    voyage.until("exploring: in AUTO under our mission")
    voyage.until("verified on board")


@pytest.mark.parametrize("late_s", [2.0, 30.0, 230.0])
def test_late_packets_give_us_nothing_while_the_operator_has_the_boat(voyage, late_s):
    voyage.advance(250.0)
    voyage.select(Mode.HOLD)
    voyage.advance(10.0)
    taken, reboots = voyage.now, voyage.core._helm.telemetry.reboots
    vehicle, own = Codec(voyage.autopilot.system_id, 1), Codec(voyage.autopilot.system_id, 191)
    for step in range(8):
        stamp = round(1000 * (voyage.autopilot.time_s - late_s)) + 100 * step
        late = mavlink.MAVLink_global_position_int_message(
            stamp, 335_000_000, -1_184_900_000, 0, 0, 0, 0, 0, 0
        )
        for message in own.decode(vehicle.encode(late)):
            voyage.happened(MessageReceived(message))
    voyage.advance(60.0)
    assert voyage.core._helm.telemetry.reboots == reboots
    assert voyage.traffic(since=taken) == []
    assert voyage.health.state == "yielded"


def _ground_station_heartbeat():
    return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)


def test_auto_selected_in_the_middle_of_the_first_upload(make_voyage):
    """What he starts is a part of our mission: it is called that, completed, verified, and sailed from its start."""
    voyage = make_voyage()
    voyage.stall_upload_after(2)
    voyage.until_sent("MISSION_ITEM_INT", 3)
    voyage.arm()
    voyage.select(Mode.AUTO)
    voyage.advance(2.0)
    assert "an upload of ours is under way" in voyage.health.reason
    assert len(voyage.on_board_m()) < len(voyage.plan_m())
    voyage.unstall()
    voyage.until("verified on board")
    verified = voyage.now
    assert voyage.on_board_m().shape == voyage.plan_m().shape
    voyage.advance(10.0)
    assert voyage.health.state == "exploring"
    commands = [message.command for message in voyage.said("COMMAND_LONG", since=verified - 0.1)]
    assert commands == [mavlink.MAV_CMD_DO_SET_MISSION_CURRENT]
    assert voyage.autopilot.navigator.current == 1
