"""Readings that a bridge sends: preflight says what the configuration lacks for them."""

import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.geometry import LocalFrame
from autonomy.mavlink.codec import Codec
from autonomy.planning.survey import SurveyArea
from autonomy.preflight.conversation import Conversation
from autonomy.preflight.facts import Facts, probe_of
from autonomy.preflight.finding import Finding, Grade
from autonomy.preflight.probe_checks import probe_checks

AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(-5000, -5000, 5000, 5000))


def findings(sensor: dict[str, object], *, lag_s: float = 8.0, heading: int = 9000) -> dict[str, Finding]:
    """Of twenty seconds with an autopilot at 4 Hz and a bridge at 1 Hz whose water is so old."""
    configuration = Configuration.model_validate({"survey": {"area": AREA}, "sensor": sensor})
    conversation = Conversation.of(configuration)
    boat, bridge = Codec(1, 1), Codec(1, 158)

    def hear(now: float, sender: Codec, message: object) -> None:
        (heard,) = Codec(9, 9).decode(sender.encode(message))
        conversation.handle(now, heard)

    hear(0.0, boat, mavlink.MAVLink_heartbeat_message(11, 3, 81, 0, 4, 3))
    for tick in range(80):
        now = 0.25 * tick
        place = (335000000, -1185000000, 0, 0, 0, 0, 0)
        hear(now, boat, mavlink.MAVLink_global_position_int_message(100_000 + 250 * tick, *place, heading))
        if tick % 4 == 0 and tick > 40:
            stamp_ms = round(1000 * (100.0 + now - lag_s))
            hear(
                now,
                bridge,
                mavlink.MAVLink_named_value_float_message(stamp_ms, b"SALT", 33.5 + 0.01 * (tick % 3)),
            )
    found = probe_checks(Facts(configuration, SURVEY, probe=probe_of(conversation, configuration, SURVEY)))
    return {each.check: each for each in found}


def test_a_bridge_whose_stamps_are_used_is_all_right() -> None:
    found = findings({"clock": "vehicle", "intake_forward_m": 3.0, "minimum": 2.0, "maximum": 42.0})
    assert found["sensor.name"].grade is Grade.PASS
    assert found["sensor.values"].grade is not Grade.FAIL
    assert not {"sensor.clock", "sensor.intake"} & set(found)


def test_stamps_that_are_not_used_are_missed() -> None:
    found = findings({})["sensor.clock"]
    assert found.grade is Grade.WARN
    assert "sensor.clock: vehicle" in found.remedy


def test_stamps_that_are_not_the_vehicles_are_told() -> None:
    found = findings({"clock": "vehicle"}, lag_s=-3000.0)["sensor.clock"]
    assert found.grade is Grade.FAIL
    assert "sensor.clock: own" in found.remedy


def test_an_intake_needs_a_heading() -> None:
    found = findings({"clock": "vehicle", "intake_starboard_m": -1.0}, heading=65535)["sensor.intake"]
    assert found.grade is Grade.FAIL
    assert "compass" in found.remedy
