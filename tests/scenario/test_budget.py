"""A budget at sea: the real core on the discrete driver sails it, and is home with the reserve unspent.

HALOCLINE_VOYAGES says how many random voyages (each takes some seconds).
"""

import os
from typing import Any

import numpy as np
import pytest

from autonomy.effects import Topic
from sim.autopilot import Mode
from sim.vessel import UnsteadyCurrent

from .conftest import HARBOUR_M, SPEED_MPS, boat

VOYAGES = int(os.environ.get("HALOCLINE_VOYAGES", "3"))
PLANNERS = ("auto", "paper", "spots", "lawnmower")
RESERVE = 0.1
"""Of the limits, by default."""


def sailed_home(voyage: Any, patience_s: float = 6000.0) -> None:
    """Sail on until the survey is finished; the boat lies in its harbour then."""
    assert voyage.advance(patience_s, until=lambda: bool(voyage.lines("finished:"))), voyage.log[-5:]
    place = voyage.survey.frame.to_local(*voyage.autopilot.vessel.position)
    assert np.hypot(*(place - HARBOUR_M)) < 30.0
    assert voyage.health.state == "finished"


@pytest.mark.timeout(120 + 40 * VOYAGES)
@pytest.mark.parametrize("seed", range(VOYAGES))
def test_home_with_the_reserve_unspent(make_voyage, legs_over_land, seed):
    rng = np.random.default_rng(seed)
    current = UnsteadyCurrent.draw(tuple(rng.uniform(-1.5, 1.5, 2)), 0.05 * SPEED_MPS, rng)
    autopilot = boat(seed=seed, current=current)
    battery, distance_m = autopilot.vessel.battery, rng.uniform(7e3, 12e3)
    battery.noise, battery.rng, battery.propulsion_w_per_m3s3 = 0.15, rng, 120.0 / SPEED_MPS**3
    amounts = {
        "distance_m": distance_m,
        "duration_s": distance_m / SPEED_MPS * rng.uniform(0.95, 1.1),
        "energy_wh": distance_m * 145.0 / SPEED_MPS / 3600.0 * rng.uniform(0.95, 1.1),
    }
    battery.capacity_wh = amounts["energy_wh"]
    names = list(amounts)[: 1 + seed % 3] if seed % 2 else [list(amounts)[2 - seed % 3]]
    limits = {name: amounts[name] for name in names}
    guesses = {"consumption_j_per_m": rng.uniform(10.0, 30.0), "speed_mps": rng.uniform(5.0, 11.0)}
    planning = {"planner": PLANNERS[seed % len(PLANNERS)], "lattice": (6, 5), "spots": 6}
    voyage = make_voyage(autopilot, seed=seed, budget={**limits, **guesses}, planning=planning)
    voyage.start()
    began_s, began_wh, began_m = autopilot.vessel.time_s, battery.used_wh, autopilot.vessel.distance_sailed_m
    sailed_home(voyage)
    spent = {
        "distance_m": autopilot.vessel.distance_sailed_m - began_m,
        "duration_s": autopilot.vessel.time_s - began_s - 5.0,  # in which health was asked for
        "energy_wh": battery.used_wh - began_wh,
    }
    shares = {name: spent[name] / (1.0 - RESERVE) / limit for name, limit in limits.items()}
    assert max(shares.values()) <= 1.0, shares
    assert max(shares.values()) >= 0.85, shares
    for plan in voyage.plans:
        route = voyage.survey.frame.to_local(*np.transpose([plan.start_deg, *plan.route_deg]))
        assert legs_over_land(route) == 0
    assert not autopilot.vessel.aground
    assert autopilot.navigator.mode is Mode.AUTO


def test_what_is_measured_on_the_way_home_still_teaches(make_voyage):
    exploration = {"minimum_basis": 10, "maximum_interval_s": 60.0, "outgrown_ratio": None}
    estimation = {"candidates": ("squared_exponential",), "maximum_points": 40}
    voyage = make_voyage(budget={"distance_m": 9000.0}, exploration=exploration, estimation=estimation)
    voyage.start()
    assert voyage.advance(3000.0, until=lambda: bool(voyage.lines("returning:")))
    before, plans, since = voyage.samples, len(voyage.plans), voyage.now
    assert voyage.health.state == "returning"
    sailed_home(voyage)
    assert voyage.samples > before + 5
    assert voyage.lines("re-estimated", since)
    assert len(voyage.plans) == plans
    # Once it lies there, nothing more is learnt.
    since = voyage.now
    voyage.advance(120.0)
    assert not voyage.lines("re-estimated", since)


def test_a_low_battery_turns_back_at_once_in_missions(make_voyage):
    voyage = make_voyage(budget={"low_battery": 0.4, "critical_battery": 0.2})
    voyage.start()
    voyage.advance(150.0)
    battery = voyage.autopilot.vessel.battery
    battery.used_wh = 0.65 * battery.capacity_wh
    voyage.until("the boat goes home: low: the battery is at 35%", 30.0)
    assert voyage.advance(20.0, until=lambda: voyage.verified == 2)
    assert voyage.autopilot.navigator.mode is Mode.AUTO
    assert voyage.plans[-1].planner == "home"
    said = [each.text for each in voyage.said("STATUSTEXT")]
    assert any("the boat goes home: low" in text for text in said)
    battery.used_wh = 0.85 * battery.capacity_wh
    voyage.until("the boat goes home: critical: the battery is at 15%", 30.0)
    assert voyage.said("STATUSTEXT")[-1].severity == 2  # MAV_SEVERITY_CRITICAL
    assert voyage.autopilot.navigator.mode is Mode.AUTO  # missions: no mode is changed
    sailed_home(voyage)
    assert voyage.verified == 2  # nothing better could be sent at the second alarm


def test_a_critical_budget_is_the_autopilots_with_full_authority(make_voyage):
    voyage = make_voyage(authority={"mode": "full"}, budget={"critical_battery": 0.5})
    assert voyage.advance(60.0, until=lambda: bool(voyage.lines("exploring")))
    voyage.advance(40.0)
    battery = voyage.autopilot.vessel.battery
    battery.used_wh = 0.6 * battery.capacity_wh
    voyage.until("the boat is told to return", 30.0)
    assert voyage.advance(20.0, until=lambda: voyage.autopilot.navigator.mode is Mode.RTL)
    assert voyage.health.state == "returning"


def test_a_boat_that_was_taken_goes_home_when_it_is_given_back(make_voyage):
    voyage = make_voyage(budget={"low_battery": 0.4})
    voyage.start()
    voyage.advance(100.0)
    voyage.select(Mode.HOLD)
    voyage.advance(10.0)
    battery = voyage.autopilot.vessel.battery
    battery.used_wh = 0.7 * battery.capacity_wh
    since = voyage.now
    voyage.advance(60.0)
    assert not voyage.said("MISSION_COUNT", since)  # the operator's
    voyage.select(Mode.AUTO)
    voyage.until("the boat goes home", 60.0)
    sailed_home(voyage)


def test_the_way_home_survives_a_restart(make_voyage):
    voyage = make_voyage(budget={"distance_m": 6000.0})
    voyage.start()
    assert voyage.advance(3000.0, until=lambda: bool(voyage.lines("returning:")))
    memory, sailed_m = voyage.core.checkpoint(), voyage.health.distance_m
    again = make_voyage(voyage.autopilot, budget={"distance_m": 6000.0})
    again.core.restore(memory)
    again.now = voyage.now
    again.core.resume(again.now, 0.0)
    again.advance(10.0)
    assert again.health.distance_m >= sailed_m
    assert again.health.state == "returning"
    sailed_home(again)
    assert 0.85 * 5400.0 < again.autopilot.vessel.distance_sailed_m < 5400.0
    assert len(again.published[Topic.PLAN]) == 0


def test_a_second_survey_after_disarming_has_a_budget_of_its_own(make_voyage):
    voyage = make_voyage(budget={"distance_m": 6000.0})
    voyage.start()
    sailed_home(voyage)
    first_m = voyage.autopilot.vessel.distance_sailed_m
    voyage.arm(armed=False)
    voyage.advance(5.0)
    voyage.arm()
    voyage.select(Mode.HOLD)
    voyage.select(Mode.AUTO)
    voyage.until("the budget: 5.4 km", 60.0)
    known = len(voyage.lines("finished:"))
    assert voyage.advance(6000.0, until=lambda: len(voyage.lines("finished:")) > known), voyage.log[-5:]
    assert 0.85 * 5400.0 < voyage.autopilot.vessel.distance_sailed_m - first_m < 5400.0
