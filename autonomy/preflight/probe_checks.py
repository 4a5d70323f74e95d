"""Does the instrument say something, under the right name, often enough, that can be water?"""

import math
from statistics import median

from autonomy.mavlink.companion import BRIDGE_COMPONENT
from autonomy.mavlink.pairing import NO_HEADING
from autonomy.mavlink.telemetry import TIME_UNKNOWN
from autonomy.preflight.facts import Facts, Named
from autonomy.preflight.finding import Finding, failed, passed, skipped, warned
from autonomy.quality.checks import NO_VALUE_ABOVE

_SLOWEST_HZ, _FASTEST_HZ = 0.1, 20.0
_STUCK_AFTER = 8
_FEW_BAD = 0.05
"""Share of bad readings that any probe may have."""

_FLAG_GOOD, _, _FLAG_SUSPECT, _FLAG_FAIL, _FLAG_MISSING = range(5)
"""Columns of the counts of flags."""


def probe_checks(facts: Facts) -> list[Finding]:
    """Name, rate, values, their limits, quality."""
    sensor, probe = facts.configuration.sensor, facts.probe
    limits = _limits(facts)
    named = probe.named.get(sensor.message_name)
    if named is None:
        return [_unheard(facts), *limits]
    system = None if facts.vehicle is None else facts.vehicle.state.system_id
    if system is not None and system not in named.systems:
        others = ", ".join(map(str, sorted(named.systems)))
        said = f"{sensor.message_name} comes from system {others}, not from the vehicle's, {system}"
        return [
            failed("sensor.name", said, f"let whoever sends it use the vehicle's system id, {system}"),
            *limits,
        ]
    heard = passed("sensor.name", f"{sensor.message_name} is heard, {named.count} readings")
    return [heard, _rate(named), *_clock(facts, named), *_values(facts, named), *limits]


def _unheard(facts: Facts) -> Finding:
    name, others = facts.configuration.sensor.message_name, sorted(facts.probe.named)
    if not others:
        return failed(
            "sensor.name",
            f"no readings come in, neither {name} nor others",
            "switch the probe on; start what sends its readings as NAMED_VALUE_FLOAT (docs/operating.md, section 3)",
        )
    near = next((other for other in others if other.lower() == name.lower()), others[0])
    return failed(
        "sensor.name",
        f"no reading is named {name}; heard are {', '.join(others)}",
        f"if one of these is it, set sensor.message_name: {near}",
    )


def _rate(named: Named) -> Finding:
    check, rate_hz = "sensor.rate", named.rate_hz
    if math.isnan(rate_hz) or rate_hz < _SLOWEST_HZ:
        said = "only one reading came" if math.isnan(rate_hz) else f"a reading every {1.0 / rate_hz:.0f} s"
        return warned(check, said, "let the probe speak once to ten times a second")
    said = f"{rate_hz:.1f} readings a second"
    if rate_hz > _FASTEST_HZ:
        return warned(
            check, said, "average at the sender: more than ten a second load the link and teach nothing"
        )
    return passed(check, said)


def _clock(facts: Facts, named: Named) -> list[Finding]:
    """Whether readings are given the time and the place of their water."""
    check, sensor, dropped = "sensor.clock", facts.configuration.sensor, facts.probe.dropped
    if sensor.clock == "own" and BRIDGE_COMPONENT in named.components:
        said = (
            f"readings come from a bridge (component {BRIDGE_COMPONENT}), which stamps them with the time at which the "
            "water was taken in; but they are timed by their arrival"
        )
        return [warned(check, said, "set sensor.clock: vehicle (docs/bridge.md)")]
    untimed = dropped.get(TIME_UNKNOWN, 0)
    if sensor.clock == "vehicle" and 2 * untimed > named.count:
        said = f"{untimed} of {named.count} readings are not stamped by the vehicle's clock, as sensor.clock says"
        return [failed(check, said, "set sensor.clock: own, unless it is autonomy bridge that sends them")]
    if 2 * dropped.get(NO_HEADING, 0) > named.count:
        said = "the autopilot tells no heading, without which the place of the intake is unknown"
        return [failed("sensor.intake", said, "calibrate the compass; or leave out sensor.intake_…_m")]
    return []


def _values(facts: Facts, named: Named) -> list[Finding]:
    check, sensor, values = "sensor.values", facts.configuration.sensor, facts.probe.values
    if not values:
        return [_unplaced(facts, named)]
    sound = [each for each in values if math.isfinite(each) and abs(each) < NO_VALUE_ABOVE]
    empty = len(values) - len(sound)
    if 2 * empty > len(values):
        said = f"{empty} of {len(values)} readings are without a value (NaN)"
        return [failed(check, said, "look at the probe: is it wet, and its cable whole?"), _quality(facts)]
    low, high, usual = min(sound), max(sound), median(sound)
    unit = "" if sensor.units == "1" else f" {sensor.units}"
    said = f"{low:.6g} to {high:.6g}, usually {usual:.6g}{unit}"
    outside = sum(not sensor.minimum <= each <= sensor.maximum for each in sound)
    found = []
    if 2 * outside > len(sound):
        found.append(
            failed(
                check,
                f"{said}: {outside} of {len(sound)} outside sensor.minimum to maximum ({sensor.minimum:g} to "
                f"{sensor.maximum:g})",
                "put the probe into the water; look at its unit; or correct sensor.minimum and maximum",
            )
        )
    elif len(sound) >= _STUCK_AFTER and low == high:
        found.append(
            warned(
                check,
                f"{len(sound)} readings, all of them {low:.6g}: a stuck probe, or still water and a coarse one",
                "move the probe, and look again; restart or clean it if it stays",
            )
        )
    else:
        found.append(passed(check, said))
    return [*found, _quality(facts)]


def _unplaced(facts: Facts, named: Named) -> Finding:
    dropped = facts.probe.dropped
    why = ", ".join(f"{count} {reason}" for reason, count in sorted(dropped.items()))
    if facts.vehicle is None or facts.vehicle.state.lat_deg is None:
        return skipped(
            "sensor.values", "the boat does not know where it is, and readings without a place are nothing"
        )
    return failed(
        "sensor.values",
        f"none of {named.count} readings could be given a place{f' ({why})' if why else ''}",
        "raise mavlink.position_rate_hz, or sampling.pairing_gap_s",
    )


def _quality(facts: Facts) -> Finding:
    check, flags = "sensor.quality", facts.probe.flags
    total = flags.get("aggregate", (0, 0, 0, 0, 0))
    bad = {
        test: counts[_FLAG_SUSPECT] + counts[_FLAG_FAIL] + counts[_FLAG_MISSING]
        for test, counts in flags.items()
        if test != "aggregate"
    }
    said = ", ".join(f"{count} by {test.replace('_', ' ')}" for test, count in bad.items() if count)
    wrong = total[_FLAG_SUSPECT] + total[_FLAG_FAIL] + total[_FLAG_MISSING]
    if wrong <= _FEW_BAD * sum(total):
        but = f", {wrong} do not: {said}" if wrong else ""
        return passed(check, f"{total[_FLAG_GOOD]} readings pass the tests of quality control{but}")
    return warned(
        check,
        f"{wrong} of {sum(total)} readings would not teach: {said}",
        "look at the probe and its cable; docs/operating.md, section 3, has the tests and their limits",
    )


def _limits(facts: Facts) -> list[Finding]:
    sensor = facts.configuration.sensor
    if math.isfinite(sensor.minimum) and math.isfinite(sensor.maximum):
        return []
    missing = [key for key in ("minimum", "maximum") if not math.isfinite(getattr(sensor, key))]
    keys = " and ".join(f"sensor.{key}" for key in missing)
    return [
        warned(
            "sensor.limits",
            f"{keys} not set: a probe in air, or one that says a number for an error, would be learnt",
            f"set {keys} to what this water can have",
        )
    ]
