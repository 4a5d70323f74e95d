"""The bridge without sockets: what it sends, what it says of itself."""

import logging
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.bridge.bridge import Bridge, Outcome
from autonomy.mavlink.codec import Codec

from .examples import bridge_configuration


class Rig:
    """A bridge, an autopilot that booted at 1000 s, and a clock."""

    def __init__(self, **sections: Any) -> None:
        self.now = 2000.0
        self.bridge = Bridge(bridge_configuration(**sections), self.now)
        self.bridge.port_up(self.now)
        self.boat = Codec(1, 1)
        self.log: list[tuple[int, str]] = []
        self.sent: list[Any] = []

    def hear(self, message: Any, sender: Codec | None = None) -> None:
        (heard,) = Codec(9, 9).decode((sender or self.boat).encode(message))
        self.sent += self.bridge.on_message(self.now, heard)

    def vehicle(self) -> None:
        self.hear(mavlink.MAVLink_heartbeat_message(11, 3, 81, 10, 4, 3))
        self.hear(mavlink.MAVLink_system_time_message(0, round(1000 * (self.now - 1000.0))))

    def line(self, line: str = "33.5, 1") -> Outcome:
        return self.bridge.on_line(self.now, line)

    def wait(self, seconds: float, line: str | None = "33.5, 1", *, heard: bool = True) -> None:
        for _ in range(round(2 * seconds)):
            self.now += 0.5
            if heard:
                self.vehicle()
            if line is not None:
                self.line(line)
            self.sent += self.bridge.step(self.now)
            self.log += self.bridge.news.take()

    def words(self) -> list[str]:
        """To the operator."""
        return [each.text for each in self.sent if each.get_type() == "STATUSTEXT"]


def test_a_reading_carries_the_vehicles_time_of_its_water() -> None:
    rig = Rig(values={"SALT": {"field": 1, "delay_s": 8.0, "response_s": 2.0}, "FLOW": {"field": 2}})
    rig.wait(20.0)
    rig.now += 0.25
    made = rig.line("33.512, 7")
    assert [(each.name, each.time_boot_ms, each.value) for each in made.messages] == [
        ("SALT", 1_010_250, 33.512),
        ("FLOW", 1_020_250, 7.0),
    ]
    assert made.record() == {
        "line": "33.512, 7",
        "sent": {"SALT": [33.512, 1_010_250], "FLOW": [7.0, 1_020_250]},
    }


def test_without_the_vehicles_time_nothing_is_sent() -> None:
    rig = Rig()
    rig.wait(3.0, heard=False)
    assert rig.line().unsent == "the vehicle's time is not known"
    rig.wait(3.0)
    assert rig.line().messages
    rig.wait(6.0, heard=False)
    assert not rig.line().messages


def test_readings_of_one_name_are_never_stamped_twice_alike() -> None:
    rig = Rig()
    rig.wait(5.0)
    stamps = [message.time_boot_ms for _ in range(10) for message in rig.line().messages]
    assert stamps == sorted(set(stamps))


@pytest.mark.parametrize("value", ["3.3e38", "1e-300", "-0.0"])
def test_every_number_that_is_read_can_be_sent(value: str) -> None:
    rig = Rig()
    rig.wait(1.0)
    (message,) = rig.line(f"{value}, 0").messages
    assert Codec(1, 158).encode(message)
    assert struct.pack("<f", message.value)


def test_what_sharpening_makes_too_large_is_not_sent() -> None:
    rig = Rig(values={"SALT": {"field": 1, "response_s": 5.0, "response": "sharpen", "window_s": 0.5}})
    sent = []
    for value in ("3e38", "-3e38", *["33.5"] * 5):
        rig.now += 0.5
        rig.vehicle()
        sent += rig.line(f"{value}, 1").messages
    assert sent
    for message in sent:
        rig.boat.encode(message)


def test_lines_after_a_flood_of_garbage_are_not_of_the_future() -> None:
    rig = Rig()
    rig.vehicle()
    for _ in range(20_000):
        rig.line("?")
    (sent,) = rig.line().messages
    assert sent.time_boot_ms == pytest.approx(1000 * (rig.now - 1000.0), abs=2)


def test_it_says_how_it_is_once_and_again_when_that_changes() -> None:
    rig = Rig(instrument={"name": "probe", "silence_s": 5})
    rig.wait(20.0)
    rig.wait(20.0, "what?")
    rig.wait(20.0, None)
    rig.bridge.port_down("/dev/ttyUSB0: gone")
    rig.wait(20.0, None)
    rig.bridge.port_up(rig.now)
    rig.wait(20.0)
    told = [text for _, text in rig.log if "can't read" not in text]
    assert told == [
        "probe: sending",
        "probe: no line can be read",
        "probe: the instrument is silent",
        "probe: /dev/ttyUSB0: gone",
        "probe: sending",
    ]
    assert rig.words() == [*told[:3], "probe: the instrument's port is not open", told[4]]
    assert all(len(text) <= 50 for text in rig.words())


def test_a_pump_that_flickers_does_not_flood_log_and_operator() -> None:
    rig = Rig(pump={"field": 2, "minimum": 0.5, "flush_s": 0})
    for k in range(240):
        rig.wait(0.5, f"33.5, {k % 2}")
    assert 0 < len(rig.log) <= 120 / 5 + 1
    assert 0 < len(rig.words()) <= 120 / 10 + 1


def test_garbage_is_counted_and_the_newest_is_shown_once_a_minute() -> None:
    rig = Rig()
    rig.wait(10.0)
    rig.log.clear()
    for k in range(360):
        rig.wait(0.5, f"garbage \x00 {k}" if k % 2 else "33.5, 1")
    complaints = [text for level, text in rig.log if "can't read" in text and level == logging.WARNING]
    assert complaints[0] == "probe: can't read a line: not 2 columns: 'garbage \\x00 1'"
    assert complaints[1] == "probe: can't read 60 lines, the newest: not 2 columns: 'garbage \\x00 121'"
    assert len(complaints) == 3
    assert "not 2 columns: 180" in rig.bridge.report()


def test_it_asks_for_the_time_again_after_a_reboot_and_commands_nothing() -> None:
    rig = Rig()
    rig.wait(5.0)
    asked = [each for each in rig.sent if each.get_type() == "COMMAND_LONG"]
    assert {each.command for each in asked} == {mavlink.MAV_CMD_SET_MESSAGE_INTERVAL}
    assert {each.param1 for each in asked} == {mavlink.MAVLINK_MSG_ID_SYSTEM_TIME}
    rig.sent.clear()
    for k in range(20):
        rig.now += 0.5
        rig.hear(mavlink.MAVLink_system_time_message(0, 500 + 500 * k))
        rig.sent += rig.bridge.step(rig.now)
    assert "COMMAND_LONG" in {each.get_type() for each in rig.sent}
    (message,) = rig.line().messages
    assert message.time_boot_ms == 10_000


def test_it_beats_once_a_second_and_is_active_while_it_sends() -> None:
    rig = Rig()
    rig.wait(10.0)
    beats = [each for each in rig.sent if each.get_type() == "HEARTBEAT"]
    assert len(beats) == 10
    assert {each.autopilot for each in beats} == {mavlink.MAV_AUTOPILOT_INVALID}
    assert (beats[0].system_status, beats[-1].system_status) == (
        mavlink.MAV_STATE_STANDBY,
        mavlink.MAV_STATE_ACTIVE,
    )


def test_the_pump_of_another_vehicle_is_not_ours() -> None:
    rig = Rig(pump={"message_name": "PUMP", "minimum": 0.5, "flush_s": 0})
    running = mavlink.MAVLink_named_value_float_message(1, b"PUMP", 1.0)
    rig.wait(1.0)
    rig.hear(running, Codec(2, 1))
    assert rig.line().withheld == "nobody tells of the pump"
    rig.hear(running, Codec(1, 40))
    assert rig.line().messages


def test_bytes_without_an_end_are_no_silence() -> None:
    rig = Rig(instrument={"name": "probe", "silence_s": 5})
    rig.wait(10.0)
    for _ in range(20):
        rig.bridge.on_noise(rig.now)
        rig.wait(1.0, None)
    assert rig.log[-1][1] == "probe: no line can be read"
    assert any("another baud rate?" in text for _, text in rig.log)


def test_with_the_link_goes_the_time() -> None:
    rig = Rig()
    rig.wait(3.0)
    rig.bridge.link_down()
    assert rig.line().unsent
    rig.vehicle()
    assert rig.line().messages
