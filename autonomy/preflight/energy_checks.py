"""Is what the battery holds enough for what is planned?"""

import math

import numpy as np
from shapely.geometry import Point

from autonomy.budget import Budget, Reading
from autonomy.geometry import FloatArray
from autonomy.mavlink.vehicle import VehicleState
from autonomy.planning.survey import SurveyArea
from autonomy.preflight.facts import Facts
from autonomy.preflight.finding import Finding, failed, passed, skipped, warned

_FULL_ENOUGH = 0.8
_CROSSINGS = 4.0
"""Of the area, there and back between: less than so many make no map."""


def energy_checks(facts: Facts) -> list[Finding]:
    """Charge, and the budget against the way there, some lanes, and home."""
    vehicle = facts.vehicle
    if vehicle is None:
        return [skipped("energy", "no autopilot is heard")]
    return [_charge(facts, vehicle.state), _budget(facts, vehicle.state)]


def _charge(facts: Facts, state: VehicleState) -> Finding:
    check, charge, budget = "energy.battery", state.battery_remaining, facts.configuration.budget
    volts = "" if state.battery_voltage_v is None else f", {state.battery_voltage_v:.1f} V"
    if charge is None:
        remedy = "set BATT_MONITOR and BATT_CAPACITY for the power module"
        if budget.energy_wh is not None or budget.low_battery is not None:
            return failed(
                check, f"the battery's charge is not told{volts}, and the budget goes by it", remedy
            )
        return warned(check, f"the battery's charge is not told{volts}", remedy)
    authority = facts.configuration.authority
    ends = [budget.low_battery, budget.critical_battery]
    ends.append(authority.return_battery if authority.mode == "full" else None)
    end = max((each for each in ends if each is not None), default=0.0)
    said = f"the battery is at {charge:.0%}{volts}"
    if charge <= end:
        return failed(check, f"{said}, and at {end:.0%} the boat turns back", "charge it")
    return (
        passed(check, said) if charge >= _FULL_ENOUGH else warned(check, said, "charge it, or plan for less")
    )


def _budget(facts: Facts, state: VehicleState) -> Finding:
    check, section, survey = "energy.budget", facts.configuration.budget, facts.survey
    budget = Budget(section)
    if not np.isfinite(budget.limits).any():
        return warned(
            check,
            "no budget is set: the service plans as if the battery were endless",
            "set budget.distance_m, or budget.energy_wh with consumption_j_per_m (docs/budget.md)",
        )
    if not state.position_ok or state.lat_deg is None or state.lon_deg is None:
        return skipped(check, "the boat does not know where it is")
    here_m = np.asarray(survey.frame.to_local(state.lat_deg, state.lon_deg), dtype=float)
    budget.follow(Reading.of(state, here_m, 0.0, is_sailing=False))
    budget.begin()
    metres, way_m = budget.metres(), _way_m(facts, here_m)
    needed_m = section.home_margin * 2.0 * way_m
    told = f"{metres / 1e3:.1f} km may be sailed ({budget.said()} without the reserve)"
    if metres <= needed_m:
        return failed(
            check,
            f"{told}, and the way to the survey's water and home takes {needed_m / 1e3:.1f} km",
            "charge or change the battery, launch nearer, or correct the budget",
        )
    lanes_m = needed_m + _CROSSINGS * _shorter_side_m(survey)
    if metres < lanes_m:
        return warned(
            check,
            f"{told}: with the way there and home that is not four times across the area ({lanes_m / 1e3:.1f} km)",
            "take a smaller area, or more battery; autonomy plan tells what map to expect",
        )
    return passed(check, told)


def _way_m(facts: Facts, here_m: FloatArray) -> float:
    """Straight from the farther of boat and home to the survey's water; 0 inside of it."""
    survey, home_deg = facts.survey, facts.configuration.budget.home
    if home_deg is None and facts.vehicle is not None:
        home_deg = facts.vehicle.state.home_deg
    places = [here_m] if home_deg is None else [here_m, survey.frame.to_local(*home_deg)]
    return max(float(Point(place).distance(survey.navigable)) for place in places)


def _shorter_side_m(survey: SurveyArea) -> float:
    x_min, y_min, x_max, y_max = survey.bounds
    return min(x_max - x_min, y_max - y_min, math.sqrt(survey.ground.area))
