"""The mission on board is begun anew, or from elsewhere: the straight way to its waypoint was no leg of the plan."""

import dataclasses

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import jobs
from autonomy.planning.plan import Plan
from sim.autopilot import Mode

from .conftest import FRAME, ISLAND, boat

WEST_TO_EAST = np.array(
    [(700.0, 1200.0), (700.0, 1900.0), (2300.0, 1900.0), (2300.0, 600.0), (2800.0, 300.0)]
)
"""Round the island in the north; from its fourth leg the straight way back to the first corner leads over it."""


class Office:
    """The first plan leads round the island; then the planner plans."""

    def __init__(self):
        self.reasons = []

    def __call__(self, name, request, survey):
        result = jobs.run(name, request, survey)
        self.reasons.append(request.plan.reason)
        if len(self.reasons) > 1:
            return result
        spots = np.ones(len(WEST_TO_EAST), dtype=bool)
        plan = Plan(request.plan.start_m, WEST_TO_EAST, spots, 1.0, "test", request.plan.reason)
        return dataclasses.replace(result, plan=plan)


def where(voyage):
    return FRAME.to_local(*voyage.autopilot.vessel.position)


def clearance_m(voyage, duration_s):
    """How near the boat comes to the island within a time."""
    nearest_m, end = np.inf, voyage.now + duration_s
    while voyage.now < end:
        voyage.advance(0.5)
        nearest_m = min(nearest_m, ISLAND.distance(shapely.Point(where(voyage))))
    assert not voyage.autopilot.vessel.aground
    return nearest_m


def comes_up_in_auto(voyage):
    """As with INITIAL_MODE 10 and ARMING_REQUIRE 0: under way again before its first heartbeat."""
    voyage.reboot()
    voyage.arm()
    voyage.select(Mode.AUTO)


def selects_auto_again(voyage):
    voyage.autopilot.parameters.set("MIS_RESTART", 1.0)
    voyage.select(Mode.HOLD)
    voyage.advance(5.0)
    voyage.autopilot.navigator.set_current(1, restart=True)
    voyage.select(Mode.AUTO)


def jumps(voyage):
    voyage.operate(mavlink.MAVLink_mission_set_current_message(voyage.autopilot.system_id, 1, 1))


def unnoticed(voyage):
    """A clock that goes on, far ahead: no reboot to the service, which lets the boat be until AUTO is back."""
    old = voyage.autopilot
    new = boat(at_m=tuple(where(voyage).tolist()), boot_clock_s=2**32 / 1000.0 - 100.0)
    for seq in range(len(old.store)):
        new.store.write(seq, old.store[seq])
    voyage.replace_autopilot(new)
    voyage.advance(20.0)
    voyage.arm()
    voyage.select(Mode.AUTO)


@pytest.fixture
def office():
    return Office()


@pytest.fixture
def east_of_the_island(make_voyage, office):
    """A boat on the fourth leg, whose first three waypoints lie behind it."""
    voyage = make_voyage(run_job=office, model={"capacity": 200}, exploration={"minimum_basis": 200})
    voyage.start()
    assert voyage.advance(
        900.0, until=lambda: voyage.autopilot.navigator.current == 4 and where(voyage)[1] < 1300
    )
    assert len(office.reasons) == 1
    assert ISLAND.intersects(shapely.LineString([where(voyage), WEST_TO_EAST[0]]))
    return voyage


@pytest.mark.parametrize("begins_anew", [comes_up_in_auto, selects_auto_again, jumps, unnoticed])
def test_a_mission_begun_anew_is_sailed_round_the_land(east_of_the_island, office, begins_anew):
    voyage = east_of_the_island
    begun = voyage.now
    begins_anew(voyage)
    assert voyage.autopilot.navigator.current == 1
    # The plan's own stand-off is 60 m, but for its corners' acceptance radii.
    assert clearance_m(voyage, 150.0) > 30.0
    assert voyage.lines("land lies before the vessel: the mission goes round it", begun)
    assert [each.text for each in voyage.said("STATUSTEXT", begun) if "land ahead" in each.text]
    assert "land lay before the boat" in office.reasons
    assert voyage.health.reason == "in AUTO under our mission"


def test_until_the_way_round_is_on_board_health_tells_of_the_land(east_of_the_island):
    voyage = east_of_the_island
    voyage.passes = lambda message: not message.get_type().startswith("MISSION_COUNT")
    jumps(voyage)
    voyage.advance(3.0)
    assert "land lies before the vessel" in voyage.health.reason
    voyage.unstall()
    assert clearance_m(voyage, 60.0) > 30.0
    assert voyage.health.reason == "in AUTO under our mission"


LAND_IN_AUTO = "land or the fence lies before waypoint 4"


def brought(voyage, there_m):
    """The operator brings the boat to a place, (2,), in local metres, and lets it lie there."""
    voyage.select(Mode.HOLD)
    vessel = voyage.autopilot.vessel
    vessel.position = type(vessel.position)(*FRAME.to_geodetic(there_m).tolist())
    voyage.advance(10.0)


def warnings(voyage, since):
    return [each.text for each in voyage.said("STATUSTEXT", since) if "LAND before" in each.text]


def test_whoever_brings_the_boat_behind_the_island_is_told_before_he_selects_auto(east_of_the_island):
    voyage, taken = east_of_the_island, east_of_the_island.now
    voyage.select(Mode.MANUAL)
    voyage.advance(10.0)
    assert voyage.health.reason.endswith("we wait for AUTO"), "the way is free from where it was taken"
    brought(voyage, (1000.0, 1300.0))
    assert warnings(voyage, taken) == ["halocline: LAND before waypoint 4: no AUTO here"]
    assert len(voyage.lines(LAND_IN_AUTO, taken)) == 1
    assert LAND_IN_AUTO in voyage.health.reason
    brought(voyage, (2000.0, 400.0))
    assert "land" not in voyage.health.reason
    brought(voyage, (1000.0, 1300.0))
    voyage.advance(100.0)
    assert len(warnings(voyage, taken)) == 1, "a coast comes and goes"
    brought(voyage, (2000.0, 400.0))
    voyage.advance(300.0)
    brought(voyage, (1000.0, 1300.0))
    assert len(warnings(voyage, taken)) == 2
    assert set(voyage.traffic(taken)) == set(), "words are all that is said"
    voyage.select(Mode.AUTO)
    assert clearance_m(voyage, 60.0) > 30.0
    assert voyage.health.reason == "in AUTO under our mission"


def test_whoever_brings_it_out_of_the_fence_is_told_too(make_voyage):
    voyage = make_voyage()
    voyage.fence((-100.0, -500.0), (3100.0, -500.0), (3100.0, 2500.0), (-100.0, 2500.0), stops_the_boat=False)
    voyage.start()
    taken = voyage.now
    brought(voyage, (-300.0, 300.0))
    assert len(warnings(voyage, taken)) == 1
    assert "land or the fence lies before waypoint" in voyage.health.reason


@pytest.mark.parametrize("why", ["disarmed", "another mission", "cleared", "half of ours"])
def test_nothing_is_said_of_a_way_that_would_not_be_sailed(east_of_the_island, why):
    voyage, taken = east_of_the_island, east_of_the_island.now
    if why == "half of ours":
        voyage.stall_upload_after(1)
        jumps(voyage)
        voyage.until_sent("MISSION_ITEM_INT", 1)
    voyage.select(Mode.MANUAL)
    voyage.advance(2.0)
    if why == "disarmed":
        voyage.arm(armed=False)
    elif why == "another mission":
        voyage.upload_as_operator((2000.0, 400.0), (2100.0, 400.0))
    elif why == "cleared":
        voyage.upload_as_operator()
    brought(voyage, (1000.0, 1300.0))
    voyage.advance(30.0)
    assert [each for each in warnings(voyage, taken) if "no AUTO" in each] == []


def test_a_boat_that_was_moved_before_its_start_gets_another_mission(make_voyage):
    """Towed round the island after the first mission was put on board, which begins on the other side now."""
    voyage = make_voyage()
    voyage.until("verified on board")
    first_m = voyage.on_board_m()
    opposite_m = np.array([1500.0, 1200.0]) * 2.0 - first_m[0]
    if not ISLAND.intersects(shapely.LineString([first_m[0], opposite_m])):
        pytest.fail("the mission begins elsewhere than this test expects")
    voyage.autopilot.vessel.position = type(voyage.autopilot.vessel.position)(
        *FRAME.to_geodetic(opposite_m).tolist()
    )
    moved = voyage.now
    voyage.until("verified on board", 60.0)
    assert voyage.lines("land lies before waypoint 1 of the mission on board", moved)
    assert [each.text for each in voyage.said("STATUSTEXT", moved) if "LAND before" in each.text]
    way = shapely.LineString([opposite_m, *voyage.on_board_m()])
    assert not way.intersects(ISLAND)
    verified = voyage.verified
    voyage.advance(300.0)  # and then it is let be
    assert voyage.verified == verified
    voyage.arm()
    voyage.select(Mode.AUTO)
    assert clearance_m(voyage, 60.0) > 30.0
