"""Does the boat know where and when it is, and is that where the survey begins?"""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry import Point
from shapely.ops import nearest_points

from autonomy.preflight.facts import Facts, Vehicle
from autonomy.preflight.finding import Finding, failed, passed, skipped, warned

_FEW_SATELLITES, _GOOD_SATELLITES = 6, 9
_BAD_HDOP, _GOOD_HDOP = 4.0, 2.0
_OFF_S, _WRONG_S = 2.0, 60.0
_FAR_M = 10e3
"""From the survey's water, or twice its extent: more than that is another survey."""

_SLOW_SHARE = 0.5
_DOUBTS = {
    "survey.land": "name a file of the shore in survey.land, or watch out: nothing else keeps the boat off it"
}
_NO_VEHICLE = "no autopilot is heard"


def position_checks(facts: Facts) -> list[Finding]:
    """Receiver, rate of positions, date, area and start."""
    vehicle = facts.vehicle
    area = [_area(facts), *(_doubt(text) for text in facts.doubts if not text.startswith("shore."))]
    if vehicle is None:
        return [skipped("position", _NO_VEHICLE), skipped("clock", _NO_VEHICLE), *area]
    return [*_fix(vehicle), _rate(facts, vehicle), _clock(vehicle), *area, _start(facts, vehicle)]


def _fix(vehicle: Vehicle) -> list[Finding]:
    check, fix = "position.fix", vehicle.fix
    if fix is None:
        return [
            failed(check, "the autopilot tells nothing of a GPS receiver", "connect it; set GPS1_TYPE to 1")
        ]
    if fix.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
        what = (
            "no receiver" if fix.fix_type == mavlink.GPS_FIX_TYPE_NO_GPS else f"no fix (type {fix.fix_type})"
        )
        return [
            failed(check, f"the GPS has {what}", "look at its cable; bring the boat into the open, and wait")
        ]
    found = [passed(check, f"the GPS has a fix (type {fix.fix_type})")]
    if fix.satellites is not None:
        found.append(_satellites(fix.satellites))
    if fix.hdop is not None:
        found.append(_hdop(fix.hdop))
    return found


def _satellites(count: int) -> Finding:
    check, said = "position.satellites", f"{count} satellites"
    remedy = "look for what shades or disturbs the antenna: metal, a USB 3 cable, a transmitter beside it"
    if count < _FEW_SATELLITES:
        return failed(check, said, remedy)
    return passed(check, said) if count >= _GOOD_SATELLITES else warned(check, said, remedy)


def _hdop(hdop: float) -> Finding:
    check, said = "position.hdop", f"HDOP {hdop:.1f}"
    remedy = "wait for more satellites, with a free view of the sky"
    if hdop > _BAD_HDOP:
        return failed(check, said, remedy)
    return passed(check, said) if hdop <= _GOOD_HDOP else warned(check, said, remedy)


def _rate(facts: Facts, vehicle: Vehicle) -> Finding:
    check, wanted = "position.rate", facts.configuration.mavlink.position_rate_hz
    remedy = (
        "let GLOBAL_POSITION_INT through to this link; raise its baud rate, or lower mavlink.position_rate_hz"
    )
    if facts.configuration.authority.mode == "observe":
        remedy = (
            "set SRn_POSITION of this port on the autopilot: with authority.mode observe nothing is asked for"
        )
    if vehicle.position_rate_hz == 0.0 or vehicle.state.lat_deg is None:
        return failed(check, "no position comes in", remedy)
    said = f"{vehicle.position_rate_hz:.1f} positions a second, {wanted:g} are wanted"
    if vehicle.position_rate_hz < _SLOW_SHARE * wanted:
        return warned(check, said, remedy)
    return passed(check, said)


def _clock(vehicle: Vehicle) -> Finding:
    check, ahead_s = "clock.utc", vehicle.utc_ahead_s
    if ahead_s is None:
        return warned(
            check,
            "the autopilot has no date: what is published and recorded would have the computer's",
            "wait for a GPS fix; let SYSTEM_TIME through to this link",
        )
    if abs(ahead_s) <= _OFF_S:
        return passed(check, f"computer and vehicle agree to {abs(ahead_s):.1f} s")
    way = "behind" if ahead_s > 0.0 else "ahead of"
    said = f"the computer's clock is {_duration(abs(ahead_s))} {way} the vehicle's, which has it from the satellites"
    remedy = "let chrony or systemd-timesyncd set it (timedatectl), or set it by hand: date -u -s TIME"
    if abs(ahead_s) > _WRONG_S:
        return failed(check, said, f"{remedy}; signing and certificates go by it")
    return warned(check, said, remedy)


def _area(facts: Facts) -> Finding:
    survey = facts.survey
    sailed = f"{survey.navigable.area / 1e6:.4g} km² of {survey.ground.area / 1e6:.4g} km² may be sailed"
    return passed("survey.area", f"{sailed}, {survey.standoff_m:g} m off land and keep-out")


def _doubt(text: str) -> Finding:
    key, _, said = text.partition(": ")
    return warned(key, said, _DOUBTS.get(key, f"look at {key} in the configuration"))


def _start(facts: Facts, vehicle: Vehicle) -> Finding:
    check, survey, state = "survey.start", facts.survey, vehicle.state
    if not state.position_ok or state.lat_deg is None or state.lon_deg is None:
        return skipped(check, "the boat does not know where it is")
    here = np.asarray(survey.frame.to_local(state.lat_deg, state.lon_deg), dtype=float)
    if survey.is_navigable(here)[0]:
        return passed(check, "the boat lies in the survey's water")
    entry = np.asarray(nearest_points(Point(here), survey.navigable)[1].coords[0])
    away_m = float(np.hypot(*(entry - here)))
    place = f"{state.lat_deg:.5f}, {state.lon_deg:.5f}"
    if survey.obstacles.intersects(Point(here)):
        return failed(
            check,
            f"by the polygons the boat lies on land or in keep-out, at {place}, {away_m:.0f} m from the survey's water",
            "launch it elsewhere, or correct survey.land and keep_out",
        )
    if away_m > max(_FAR_M, 2.0 * survey.span_m):
        return failed(
            check,
            f"the boat lies {away_m / 1e3:.0f} km from the survey's water, at {place}",
            "look at survey.area: is it this survey's configuration, and the longitude's sign right?",
        )
    if not survey.approach_is_clear(here, entry):
        return warned(
            check,
            f"between the boat and the survey's water, {away_m:.0f} m away, lies land or keep-out",
            "bring the boat to where the way in is clear before AUTO",
        )
    return passed(check, f"the boat lies {away_m:.0f} m from the survey's water, and the way in is clear")


def _duration(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.1f} s"
