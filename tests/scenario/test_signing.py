"""A signed link, and strangers on it: with no key, with another one, with packets they have heard."""

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.effects import Topic
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import Refusal, Signing, SigningKey
from sim.autopilot import Mode

KEY = SigningKey(bytes(range(32)))
OTHER = SigningKey(bytes(32))


class Wire:
    """What a stranger sees of the link: every byte of it."""

    def __init__(self, voyage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.packets: list[bytes] = []
        receive, take = voyage._router.receive, voyage._take

        def heard(now: float, client: Any, data: bytes) -> Any:
            self.packets.append(data)
            return receive(now, client, data)

        def taken(packets: Any) -> None:
            self.packets += [packet for _, packet in packets]
            take(packets)

        monkeypatch.setattr(voyage._router, "receive", heard)
        monkeypatch.setattr(voyage, "_take", taken)


def hostile(system: int, component: int) -> list[Any]:
    """What would end the survey, or spoil its map, if it were believed."""
    corner = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, 0, 1, 0, 0, 0, 0, 0, 0, 0.0, 0)
    return [
        mavlink.MAVLink_heartbeat_message(11, 3, mavlink.MAV_MODE_FLAG_SAFETY_ARMED, int(Mode.HOLD), 5, 3),
        mavlink.MAVLink_set_mode_message(1, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, int(Mode.HOLD)),
        mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, *[0.0] * 7),
        mavlink.MAVLink_mission_count_message(1, 1, 1, 0),
        mavlink.MAVLink_mission_item_int_message(1, 1, 0, *corner),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_named_value_float_message(1000, b"SALT", 99.0),
        mavlink.MAVLink_global_position_int_message(1000, 0, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_system_time_message(2**62, 1000),
    ]


def survey_of(voyage: Any, attack: Callable[[], None] | None) -> tuple[Any, ...]:
    """Sail for a while, attacked every second or not at all; all that a stranger could have changed."""
    voyage.start()
    for _ in range(60):
        if attack is not None:
            attack()
        voyage.advance(1.0)
    readings = [reading for group in voyage.published[Topic.OBSERVATIONS] for reading in group]
    return (
        voyage.on_board_m().tolist(),
        voyage.autopilot.navigator.current,
        voyage.verified,
        readings,
        [text for _, text in voyage.log],
    )


@pytest.fixture
def undisturbed(make_voyage: Callable[..., Any]) -> tuple[Any, ...]:
    return survey_of(make_voyage(key=KEY), None)


@pytest.mark.parametrize("identity", [(1, 1), (1, 191), (255, 190)])
@pytest.mark.parametrize("key", [None, OTHER], ids=["unsigned", "another key"])
def test_a_stranger_changes_nothing(
    make_voyage: Callable[..., Any],
    undisturbed: tuple[Any, ...],
    identity: tuple[int, int],
    key: SigningKey | None,
) -> None:
    voyage = make_voyage(key=KEY)
    # A clock far ahead: where a timestamp is believed before the signature, this silences whoever it names.
    codec = Codec(*identity, None if key is None else Signing(key, lambda: 3e9))

    def attack() -> None:
        for message in hostile(*identity):
            voyage.intrude(codec.encode(message))

    assert survey_of(voyage, attack) == undisturbed
    kind = Refusal.UNSIGNED if key is None else Refusal.WRONG
    assert voyage.signing.refused == {kind: 60 * len(hostile(*identity))}


def test_what_was_heard_on_the_link_is_not_believed_again(
    make_voyage: Callable[..., Any], undisturbed: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    voyage = make_voyage(key=KEY)
    wire = Wire(voyage, monkeypatch)

    def attack() -> None:
        packets, wire.packets = wire.packets[-200:], []
        for packet in packets:
            voyage.intrude(packet)
        wire.packets = packets  # and again, the next time

    assert survey_of(voyage, attack) == undisturbed
    assert voyage.signing.refused.keys() <= {Refusal.REPLAYED}
    assert voyage.signing.refused[Refusal.REPLAYED] > 1000


def test_an_autopilot_without_the_key_is_not_heard(make_voyage: Callable[..., Any]) -> None:
    voyage = make_voyage(key=KEY)
    voyage.key = None
    voyage.replace_autopilot(voyage.autopilot)
    voyage.advance(30.0)
    assert voyage.core.system_id is None
    assert voyage.verified == 0
    assert voyage.signing.refused[Refusal.UNSIGNED] > 30


def test_radio_status_of_a_stranger_does_not_keep_a_dead_link_alive(make_voyage: Callable[..., Any]) -> None:
    """It is believed unsigned, so nothing may hang on it."""
    voyage = make_voyage(key=KEY)
    voyage.start()
    voyage.linked = False
    forged = Codec(1, 1)
    for _ in range(20):
        voyage.intrude(forged.encode(mavlink.MAVLink_radio_status_message(1, 1, 1, 1, 1, 1, 1)))
        voyage.advance(1.0)
    assert voyage.signing.exempt == 20
    assert not voyage.health.link_ok


def test_the_same_attack_ends_a_survey_on_an_unsigned_link(make_voyage: Callable[..., Any]) -> None:
    """Else the tests above would show nothing."""
    voyage = make_voyage()
    voyage.start()
    stranger = Codec(1, 1)
    for message in hostile(1, 1):
        voyage.intrude(stranger.encode(message))
    voyage.advance(0.1)
    assert voyage.lines("yielded")
