"""Is the autopilot one that can sail, ready, and would it look after the boat when nobody else does?"""

import re
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry import Point

from autonomy.config import Configuration
from autonomy.mavlink.rover import AUTO, mode_name, unsupported
from autonomy.planning.survey import SurveyArea
from autonomy.preflight.facts import Facts, Vehicle
from autonomy.preflight.finding import Finding, failed, passed, skipped, warned
from autonomy.seaway import Seaway

_OLDEST = (4, 1)
"""Releases of ArduPilot Rover before it lack messages that the service asks for."""

_REMEDIES = {
    "FS_ACTION": "set FS_ACTION to 1 (RTL) or 2 (HOLD)",
    "FS_THR_ENABLE": "set FS_THR_ENABLE to 1",
    "FS_GCS_ENABLE": "set FS_GCS_ENABLE to 1, if a ground station will stay in reach",
    "FS_EKF_ACTION": "set FS_EKF_ACTION to 1",
    "FENCE_ENABLE": "draw an inclusion fence and set FENCE_ENABLE to 1",
    "FENCE_ACTION": "set FENCE_ACTION to 1 (RTL) or 2 (HOLD)",
    "BATT_MONITOR": "set BATT_MONITOR for the power module (4: voltage and current)",
    "BATT_FS_LOW_ACT": "set BATT_LOW_VOLT and BATT_FS_LOW_ACT (1: RTL)",
    "BATT_FS_CRT_ACT": "set BATT_CRT_VOLT and BATT_FS_CRT_ACT (1: RTL)",
}
_LOST_SHARE = 0.01
_FAR_HOME_M = 20e3


def autopilot_checks(facts: Facts) -> list[Finding]:
    """Firmware, status, mode, arming checks, home, mission, failsafes, fence, rally points."""
    vehicle = facts.vehicle
    if vehicle is None:
        return [skipped("autopilot", "no autopilot is heard"), skipped("safeguards", "no autopilot is heard")]
    found = [_kind(vehicle), _status(vehicle), _mode(vehicle), _prearm(vehicle), _estimate(vehicle)]
    found += [_home(vehicle, facts.survey), _mission(vehicle, facts.configuration)]
    return found + list(_safeguards(facts, vehicle))


def _kind(vehicle: Vehicle) -> Finding:
    check, strange, version = "autopilot.firmware", unsupported(vehicle.state), vehicle.version
    if strange:
        return failed(
            check, strange, "the service only listens to it: install ArduPilot Rover with FRAME_CLASS 2"
        )
    if version is None:
        return warned(
            check, "ArduPilot Rover that does not tell its version", "look which firmware is on board"
        )
    text = f"ArduPilot Rover {version[0]}.{version[1]}.{version[2]}"
    if version[:2] < _OLDEST:
        return warned(
            check, text, f"update to {_OLDEST[0]}.{_OLDEST[1]} or newer, best the latest stable release"
        )
    if not version[3]:
        return warned(check, f"{text}, which is no official release", "install the latest stable release")
    return passed(check, text)


def _status(vehicle: Vehicle) -> Finding:
    check, status = "autopilot.status", vehicle.state.system_status
    last = f"; it says: {vehicle.texts[-1]}" if vehicle.texts else ""
    if status >= mavlink.MAV_STATE_CRITICAL:
        return failed(
            check,
            f"a failsafe has struck (MAV_STATE {status}){last}",
            "clear its cause, restart the autopilot",
        )
    if status in (mavlink.MAV_STATE_BOOT, mavlink.MAV_STATE_CALIBRATING, mavlink.MAV_STATE_UNINIT):
        return warned(
            check, f"still starting or calibrating{last}", "wait a minute with the boat still, and look again"
        )
    return passed(check, "no failsafe is in force")


def _mode(vehicle: Vehicle) -> Finding:
    check, state = "autopilot.mode", vehicle.state
    name = mode_name(state.mode)
    if not state.armed:
        if state.mode == AUTO:
            return warned(
                check, "AUTO, disarmed: it sails as soon as it is armed", "select HOLD until it may leave"
            )
        return passed(check, f"{name}, disarmed")
    if state.mode == AUTO:
        return failed(check, "armed, in AUTO: it is under way already", "take the boat: HOLD, disarm")
    return warned(check, f"armed, in {name}", "disarm while people are near the propeller")


def _prearm(vehicle: Vehicle) -> Finding:
    check = "autopilot.arming"
    if vehicle.prearm_ok is None:
        return skipped(check, "the autopilot does not tell whether it would arm")
    if vehicle.prearm_ok:
        return passed(check, "its own checks before arming are passed")
    said = "; ".join(text for text in vehicle.texts if "prearm" in text.lower())
    return failed(
        check,
        f"its own checks before arming fail{f': {said}' if said else ''}",
        "read its messages (PreArm: …) in the ground station, and mend what they name",
    )


def _estimate(vehicle: Vehicle) -> Finding:
    check, ok = "autopilot.estimator", vehicle.state.ekf_ok
    if ok is None:
        return warned(
            check, "the autopilot does not tell how sure it is", "let EKF_STATUS_REPORT through to this link"
        )
    if not ok:
        return failed(
            check,
            "the estimator (EKF) has no position of its own",
            "wait in the open for GPS and compass; calibrate the compass if it stays so",
        )
    return passed(check, "the estimator (EKF) has a position")


def _home(vehicle: Vehicle, survey: SurveyArea) -> Finding:
    check, home_deg = "autopilot.home", vehicle.state.home_deg
    if home_deg is None:
        return warned(
            check,
            "the autopilot has not told its home: RTL would have nowhere to go",
            "wait for the first fix, or set home in the ground station; set budget.home too",
        )
    x_m, y_m = survey.frame.to_local(*home_deg)
    away_m = survey.ground.distance(_point(x_m, y_m))
    said = f"home is {home_deg[0]:.5f}, {home_deg[1]:.5f}, {_length(away_m)} from the survey area"
    if away_m > max(_FAR_HOME_M, 2.0 * survey.span_m):
        return failed(check, said, "set home where the boat is launched: RTL would go there")
    if survey.obstacles.intersects(_point(x_m, y_m)):
        return warned(
            check, f"{said}, on land or in keep-out", "set home on the water, or correct the polygons of land"
        )
    return passed(check, said)


def _mission(vehicle: Vehicle, configuration: Configuration) -> Finding:
    check, total = "autopilot.mission", vehicle.state.mission_total
    if not total:
        return passed(check, "no mission is on board")
    if configuration.mavlink.adopt:
        return passed(
            check, f"a mission of {total} items is on board, which may be overwritten (mavlink.adopt)"
        )
    return warned(
        check,
        f"a mission of {total} items is on board; unless this service put it there it is never overwritten",
        "clear the mission in the ground station, or set mavlink.adopt to true",
    )


def _safeguards(facts: Facts, vehicle: Vehicle) -> Iterator[Finding]:
    known = vehicle.safeguards
    if known is None:
        yield failed(
            "safeguards.read",
            vehicle.unread,
            "the service would not plan: look at the link, and let parameters and missions through to it",
        )
        return
    yield passed("safeguards.read", f"{known.summary} on board")
    for text in known.warnings:
        named = re.search(r"\((\w+) 0\)", text)
        if named is not None:
            yield warned(f"safeguards.{named[1]}", text, _REMEDIES[named[1]])
        elif "none on board" in text:
            yield failed("safeguards.fence", text, "upload a fence, or set FENCE_ENABLE to 0")
        else:
            yield warned("safeguards.unknown", text, "see whether the firmware has them; it may be no Rover")
    if not known.warnings:
        yield passed("safeguards.failsafes", "all of the autopilot's failsafes are on")
    yield from _water_within(facts, vehicle)


def _water_within(facts: Facts, vehicle: Vehicle) -> Iterator[Finding]:
    """Survey area and rally points against the fence and land."""
    known, survey = vehicle.safeguards, facts.survey
    assert known is not None
    seaway = Seaway(facts.configuration, survey)
    if known.has_fence:
        seaway.enclose(known)
        yield _within_fence(seaway, facts)
    for lat_deg, lon_deg in known.rally_deg:
        here = _point(*survey.frame.to_local(lat_deg, lon_deg))
        if seaway.water.obstacles.intersects(here):
            yield warned(
                "safeguards.rally",
                f"the rally point at {lat_deg:.5f}, {lon_deg:.5f} lies on land, in keep-out or outside the fence",
                "move it: a boat that returns would go there in a straight line",
            )


def _within_fence(seaway: Seaway, facts: Facts) -> Finding:
    check, survey = "survey.fence", facts.survey
    if seaway.problem:
        return failed(
            check, seaway.problem, "draw the fence round the survey area, or the area inside the fence"
        )
    lost = 1.0 - seaway.water.navigable.area / survey.navigable.area
    if lost > _LOST_SHARE:
        margin_m = facts.configuration.authority.fence_margin_m
        return warned(
            check,
            f"{lost:.0%} of the survey's water lies outside the autopilot's fence, or within {margin_m:g} m of it",
            "draw the fence round the survey area with room to spare, or leave it out of the plan knowingly",
        )
    return passed(check, "the survey's water lies inside the autopilot's fence")


def _point(x_m: float, y_m: float) -> Point:
    return Point(float(x_m), float(y_m))


def _length(metres: float) -> str:
    return f"{metres / 1e3:.1f} km" if metres >= 1e3 else f"{metres:.0f} m"
