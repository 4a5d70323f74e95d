"""Which waypoint AUTO would make for, and when somebody is told that land lies before it."""

from types import SimpleNamespace

import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.handback import Handback
from autonomy.mavlink.authority_table import Command
from autonomy.planning.survey import SurveyArea

from .test_helm import AUTO, FRAME, HOLD, Boat

ISLAND = shapely.box(40.0, 40.0, 60.0, 200.0)
"""Between (0, 100), where the mission of `Boat` ends, and (100, 100), its second waypoint; (100, 0) is the first."""
MANUAL = 0


class Watched:
    """A boat under way that is watched once a second."""

    def __init__(self):
        self.boat = Boat(authority={"mode": "full"}).sails()
        self.boat.hear(mavlink.MAVLink_ekf_status_report_message(0x10, 0, 0, 0, 0, 0))
        water = SurveyArea.from_geometry(
            FRAME, shapely.box(-500.0, -500.0, 500.0, 500.0), land=ISLAND, passage_cells=20
        )
        self.handback = Handback(
            self.boat.helm, SimpleNamespace(water=water), SimpleNamespace(log=lambda *_: None)
        )

    def told(self, mode, *place, armed=True):
        """The boat is at a place, in a mode; returns what the operator is told."""
        for _ in range(3):  # a jump is believed when it persists
            self.boat.now += 30.0
            self.boat.beats(mode, armed=armed)
            self.boat.is_at(*place, speed_mps=10.0)
        return self.handback.watch(self.boat.now)


@pytest.fixture
def watched():
    return Watched()


def test_of_a_boat_that_holds_it_is_told_too(watched):
    helm = watched.boat.helm
    watched.boat.tells_current(2)
    assert helm.authority.hold(helm.state)
    assert watched.told(HOLD, 0.0, 100.0) == "LAND before waypoint 2: no AUTO here"
    assert helm.authority.command is Command.HELD


def test_a_mission_that_is_complete_begins_anew(watched):
    watched.boat.tells_current(3, state=mavlink.MISSION_STATE_COMPLETE)
    assert watched.told(MANUAL, 20.0, 100.0) == "LAND before waypoint 1: no AUTO here"
    assert watched.told(MANUAL, 100.0, 50.0) is None
    assert watched.handback.trouble is None


def test_nothing_lies_before_a_boat_that_is_not_sure_where_it_is(watched):
    watched.boat.tells_current(2)
    watched.boat.hear(mavlink.MAVLink_ekf_status_report_message(0x80, 0, 0, 0, 0, 0))
    assert watched.told(MANUAL, 0.0, 100.0) is None
    assert watched.handback.trouble is None


def test_in_auto_the_course_is_watched_elsewhere(watched):
    watched.boat.tells_current(2)
    assert watched.told(AUTO, 0.0, 100.0) is None
