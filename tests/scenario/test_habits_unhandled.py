"""Every habit of an autopilot is handled, and would be missed: each scenario fails once its handling is taken away.

HALOCLINE_UNHANDLED: all of the table, a minute; without it what fails quickly.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import headway, helm
from autonomy.dispatch import MissionDispatch
from autonomy.mavlink import authority_table, mission_upload, safeguards
from autonomy.mavlink.authority import Authority, OnBoard
from autonomy.mavlink.authority_table import Action, Command, Rule
from autonomy.mavlink.authority_table import Event as What
from autonomy.mavlink.clock import ModelClock
from autonomy.mavlink.mission import MissionTransfer
from autonomy.mavlink.mission_current import MakeCurrent
from autonomy.mavlink.mission_upload import MissionUpload
from autonomy.mavlink.telemetry import Telemetry
from autonomy.mavlink.vehicle import VehicleState
from autonomy.orders import Orders
from autonomy.stall import StallWatch
from sim.autopilot import Options

from . import test_habits as habits

ALL = "HALOCLINE_UNHANDLED" in os.environ
Patch = Callable[[pytest.MonkeyPatch], None]


@dataclass(frozen=True)
class Unhandled:
    """One habit, and the service without what it has against it.

    Attributes:
        switches: of `Options`; none for what the autopilot does by default or is made to do by its parameters.
        missing: what is taken away, in words.
        without: takes it away.
        scenario: fails without it; takes `make_voyage`.
        fails_at: a piece of the statement in the scenario that fails.
        slow: takes more than a second or two.
    """

    switches: tuple[str, ...]
    missing: str
    without: Patch
    scenario: Callable[[Any], None]
    fails_at: str
    slow: bool = False


def under_way(scenario: Callable[..., None], *arguments: Any) -> Callable[[Any], None]:
    """A scenario that begins with a survey under way."""

    def begun(make_voyage: Any) -> None:
        voyage = make_voyage()
        voyage.start()
        scenario(voyage, *arguments)

    return begun


def given(scenario: Callable[..., None], *arguments: Any) -> Callable[[Any], None]:
    return lambda make_voyage: scenario(make_voyage, *arguments)


def replaced(owner: Any, name: str, value: Any) -> Patch:
    return lambda patch: patch.setattr(owner, name, value)


def answers_only(*kinds: str) -> Patch:
    """An upload that knows no other messages."""
    return replaced(mission_upload, "_KINDS", (*kinds, "MISSION_ACK"))


def refused_by(result: int) -> Patch:
    """An upload that takes this answer for a refusal."""
    sound = MissionUpload._on_ack

    def on_ack(self: MissionUpload, now: float, told: int) -> Any:
        return sound(self, now, mavlink.MAV_MISSION_UNSUPPORTED if told == result else told)

    return replaced(MissionUpload, "_on_ack", on_ack)


def failures_leave_things_as_they_were(patch: pytest.MonkeyPatch) -> None:
    """What was on board before a failed upload is believed to be there still."""
    sound = MissionDispatch._failed

    def failed(self: MissionDispatch, now: float, sent: Any, failure: Any) -> None:
        mission = self._aboard.mission
        sound(self, now, sent, failure)
        self._aboard.mission, self._looked = mission, True

    patch.setattr(MissionDispatch, "_failed", failed)
    patch.setattr(Authority, "upload_failed", lambda self, on_board_unknown: None)


def failed_plans_are_not_sent_again(patch: pytest.MonkeyPatch) -> None:
    sound = MissionDispatch._failed

    def failed(self: MissionDispatch, now: float, sent: Any, failure: Any) -> None:
        sound(self, now, sent, failure)
        self._waiting = None

    patch.setattr(MissionDispatch, "_failed", failed)


def nothing_is_made_current(patch: pytest.MonkeyPatch) -> None:
    sound = MissionTransfer.__init__

    def begin(self: MissionTransfer, *arguments: Any, **options: Any) -> None:
        sound(self, *arguments, **{**options, "make_current": False})

    patch.setattr(MissionTransfer, "__init__", begin)


def nothing_is_restarted(patch: pytest.MonkeyPatch) -> None:
    """The first item is made the current one, but a complete mission is not begun again."""
    sound = MakeCurrent._command_message

    def command_message(self: MakeCurrent, confirmation: int) -> Any:
        command = sound(self, confirmation)
        command.param2 = 0.0
        return command

    patch.setattr(MakeCurrent, "_command_message", command_message)


def the_estimator_is_not_asked(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Telemetry, "_on_ekf", lambda self, now, message: [])
    patch.setattr(VehicleState, "position_ok", property(lambda state: state.lat_deg is not None))
    patch.setattr(headway, "PATIENT_HEARTBEATS", 0)


def orders_are_given_once(patch: pytest.MonkeyPatch) -> None:
    """And as soon as there is a mission."""
    the_estimator_is_not_asked(patch)
    mission_suffices = lambda self, state: self.on_board is OnBoard.OURS and self._waiting_on_board  # noqa: E731
    patch.setattr(Authority, "is_ready", mission_suffices)
    sound = Orders._conclude

    def conclude(self: Orders, now: float, words: str) -> None:
        sound(self, now, words)
        self._not_before = 1e9 if self._order is None else self._not_before

    patch.setattr(Orders, "_conclude", conclude)


def nothing_is_said(patch: pytest.MonkeyPatch) -> None:
    """Who only looks on may think that he need not speak."""
    sound = helm.Helm.step

    def step(self: helm.Helm, now: float) -> list[Any]:
        return [each for each in sound(self, now) if each.get_type() != "HEARTBEAT"]

    patch.setattr(helm.Helm, "step", step)
    patch.setattr(helm.Helm, "say", lambda self, text: [])
    patch.setattr(helm.Helm, "warn", lambda self, text, critical=False: [])


def failsafes_are_not_seen(patch: pytest.MonkeyPatch) -> None:
    """Neither by the system's status nor, when the mode follows, by the mode."""
    table = dict(authority_table.TABLE)
    for event in (What.FAILSAFE, What.ELSEWHERE, What.HOMEWARD, What.READY):
        table[Command.OURS, event] = Rule(Command.OURS, Action.SAIL, "in AUTO under our mission")
    patch.setattr(authority_table, "TABLE", table)


BY_THE_BOOK = {
    "restarts_on_upload": "nothing has to be done about an autopilot that does by itself what it is asked for later; "
    "its scenario shows that asking for it all the same does no harm"
}
"""Switches that no handling belongs to."""

TABLE = (
    Unhandled(
        (),
        "answers to the legacy MISSION_REQUEST, which ArduPilot sends",
        answers_only("MISSION_REQUEST_INT"),
        given(habits.test_whoever_asks_for_items_in_his_own_way_gets_the_mission, "as ArduPilot"),
        "voyage.start()",
    ),
    Unhandled(
        ("request_int",),
        "answers to MISSION_REQUEST_INT",
        answers_only("MISSION_REQUEST"),
        given(habits.test_whoever_asks_for_items_in_his_own_way_gets_the_mission, "request_int"),
        "voyage.start()",
    ),
    Unhandled(
        (),
        "patience with the answer 13, which ArduPilot goes on after",
        refused_by(mavlink.MAV_MISSION_INVALID_SEQUENCE),
        habits.test_items_that_arrive_twice_are_answered_13_and_the_upload_goes_on,
        "voyage.start()",
    ),
    Unhandled(
        ("ends_on_wrong_item",),
        "a new beginning after the answer 1: no upload is going on any more",
        refused_by(mavlink.MAV_MISSION_ERROR),
        habits.test_an_upload_that_an_item_out_of_turn_has_ended_is_begun_again,
        "given up",
    ),
    Unhandled(
        (),
        "patience with the answer 14: another station is uploading",
        refused_by(mavlink.MAV_MISSION_DENIED),
        under_way(habits.test_while_another_station_uploads_ours_waits_and_does_not_lose_its_turn),
        "until=lambda: voyage.verified == 2",
        slow=True,
    ),
    Unhandled(
        (),
        "doubt about what is on board after an upload that has failed",
        failures_leave_things_as_they_were,
        given(habits.test_an_upload_that_dies_half_way_is_read_back_and_sent_again, False),
        "sailing_ours",
        slow=True,
    ),
    Unhandled(
        ("atomic_uploads",),
        "another attempt after an upload that has failed",
        failed_plans_are_not_sent_again,
        given(habits.test_an_upload_that_dies_half_way_is_read_back_and_sent_again, True),
        "len(voyage.plans) == 2",
        slow=True,
    ),
    Unhandled(
        (),
        "DO_SET_MISSION_CURRENT after an upload: ArduPilot keeps the index it had",
        nothing_is_made_current,
        under_way(
            habits.test_a_new_mission_under_way_is_sailed_from_its_first_waypoint_though_the_index_was_kept
        ),
        "navigator.current == 1",
        slow=True,
    ),
    Unhandled(
        (),
        "the restart of a mission that was complete: ArduPilot leaves it complete",
        nothing_is_restarted,
        habits.test_a_mission_that_was_complete_is_followed_by_one_that_is_sailed,
        "mission_state is MissionState.ACTIVE",
        slow=True,
    ),
    Unhandled(
        ("deaf_to_set_current",),
        "a look at where the boat really makes for",
        replaced(headway.Headway, "_doubt", lambda self, waypoint_m: None),
        habits.test_a_boat_that_does_not_make_for_the_first_waypoint_is_told_again,
        "until=lambda: voyage.autopilot.navigator.current == 1",
        slow=True,
    ),
    Unhandled(
        ("tells_fence",),
        "notice of a boat in AUTO that does not move",
        replaced(StallWatch, "follow", lambda *_anything: False),
        habits.test_a_boat_that_stops_at_a_fence_nobody_told_us_of_sails_elsewhere,
        'voyage.until("the boat is in AUTO and does not get to"',
        slow=True,
    ),
    Unhandled(
        (),
        "the fence, read and planned inside of",
        replaced(safeguards, "parse_fence", lambda mission: ()),
        habits.test_plans_stay_inside_the_fence_and_the_boat_never_meets_it,
        "the autopilot has a fence of 1 zone",
    ),
    Unhandled(
        ("ready_after_s",),
        "waiting for the estimator's word that it knows where it is",
        the_estimator_is_not_asked,
        habits.test_nothing_is_planned_before_the_estimator_is_ready,
        "assert not voyage.plans",
    ),
    Unhandled(
        ("arming_checks",),
        "waiting for that word before arming, and the order given again",
        orders_are_given_once,
        habits.test_an_autopilot_that_is_not_ready_to_be_armed_is_armed_when_it_is,
        "exploring: in AUTO under our mission",
    ),
    Unhandled(
        ("reboots_after_s",),
        "notice of a clock that has begun anew: the autopilot has rebooted in mid-mission",
        replaced(ModelClock, "_suspect", lambda self, now, time_boot_ms, doubt: None),
        habits.test_after_a_reboot_in_mid_mission_nothing_is_commanded_until_the_operator_starts_it_again,
        "telemetry.reboots == 1",
    ),
    Unhandled(
        ("boot_clock_s",),
        "the carry of a clock of 32 bits",
        replaced(ModelClock, "_is_wrap", lambda self, now, forward_ms: False),
        habits.test_the_clock_wraps_in_mid_survey,
        "telemetry.reboots == 0",
    ),
    Unhandled(
        ("probe_component",),
        "heartbeats while we only look on: messages are routed to those who have spoken",
        nothing_is_said,
        given(habits.test_a_probe_that_is_routed_to_those_who_spoke_is_heard, "observe"),
        "voyage.samples > 15",
    ),
    Unhandled(
        (),
        "yielding to the failsafe for a lost ground station",
        failsafes_are_not_seen,
        under_way(
            habits.test_the_ground_stations_failsafe_takes_the_boat_and_the_operator_gives_it_back, 2.0
        ),
        'voyage.until("a failsafe has the boat"',
        slow=True,
    ),
)


@pytest.mark.parametrize(
    "habit", [each.name for each in fields(Options) if each.name not in habits.NO_HABITS]
)
def test_each_switch_of_the_simulated_autopilot_is_in_the_table(habit: str) -> None:
    assert any(habit in entry.switches for entry in TABLE) or habit in BY_THE_BOOK


@pytest.mark.parametrize("entry", TABLE, ids=[entry.missing for entry in TABLE])
def test_its_scenario_fails_without(
    entry: Unhandled, make_voyage: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    if entry.slow and not ALL:
        pytest.skip("slow: HALOCLINE_UNHANDLED=1")
    entry.without(monkeypatch)
    with pytest.raises((AssertionError, RuntimeError)) as failure:
        entry.scenario(make_voyage)
    # The outermost frame of a scenario's own: what it asks for fails, not a helper's or the service's code.
    statement = next(str(each.statement) for each in failure.traceback if each.path.name == "test_habits.py")
    assert entry.fails_at in statement, f"it fails elsewhere: {statement}"
