"""Nothing is sent while the instrument is cold, or while no water flows."""

from typing import Any

import pytest

from autonomy.bridge.translator import Translator

from .examples import bridge_configuration


class Instrument:
    """A translator, and lines once a second."""

    def __init__(self, **sections: Any) -> None:
        self.translator = Translator(bridge_configuration(**sections))

    def said(self, now: float, line: str = "33.5, 1") -> str:
        made = self.translator.take(now, line)
        return made.unreadable or made.withheld or ("sent" if made.values else "nothing")


def test_after_it_was_switched_on_it_is_waited_for() -> None:
    probe = Instrument(instrument={"warm_up_s": 30, "silence_s": 5})
    assert [probe.said(float(t)) for t in range(32)] == ["warming up"] * 30 + ["sent"] * 2
    assert probe.said(36.0) == "sent"
    assert (
        probe.said(42.0) == "warming up"
    )  # it was silent for six seconds: switched off, for all that is known
    assert probe.translator.withheld == {"warming up": 31}


@pytest.mark.parametrize(
    ("pump", "on", "off"),
    [
        ({"field": 2, "minimum": 0.5}, "33.5, 1", "33.5, 0.4"),
        ({"field": 2, "text": "ON"}, "33.5, ON", "33.5, OFF"),
    ],
)
def test_a_line_may_tell_of_the_pump(pump: dict[str, Any], on: str, off: str) -> None:
    value = {"field": 1, "delay_s": 8, "response_s": 2}
    probe = Instrument(pump=pump, values={"SALT": value})
    flushed_s = 8 + 3 * 2
    said = [probe.said(float(t), off if 20 <= t < 25 else on) for t in range(60)]
    flush = ["the hose is being flushed"] * flushed_s
    assert said[:20] == flush + ["sent"] * (20 - flushed_s)
    assert said[20:25] == ["the pump is off"] * 5
    assert said[25:] == flush + ["sent"] * (35 - flushed_s)


def test_a_line_that_does_not_tell_of_the_pump_is_not_read() -> None:
    assert Instrument(pump={"field": 2, "minimum": 1}).said(0.0, "33.5, x") == "a field is no number"


def test_a_message_may_tell_of_the_pump() -> None:
    probe = Instrument(pump={"message_name": "PUMP", "minimum": 0.5, "flush_s": 3})
    gate = probe.translator.gate
    assert probe.said(0.0) == "nobody tells of the pump"
    gate.on_message(1.0, 1.0)
    assert [probe.said(1.0), probe.said(3.9), probe.said(4.0)] == ["the hose is being flushed"] * 2 + ["sent"]
    gate.on_message(5.0, 0.0)
    assert probe.said(5.0) == "the pump is off"
    gate.on_message(6.0, 1.0)
    assert probe.said(10.0) == "sent"
    assert probe.said(17.0) == "nobody tells of the pump"
    gate.on_message(18.0, 1.0)
    assert probe.said(18.0) == "the hose is being flushed"  # it may have stood still meanwhile
    gate.on_message(19.0, float("nan"))
    assert probe.said(19.0) == "the pump is off"


def test_what_was_smoothed_before_the_pump_stopped_is_forgotten() -> None:
    value = {"field": 1, "response_s": 5, "response": "sharpen"}
    probe = Instrument(pump={"field": 2, "minimum": 1, "flush_s": 0}, values={"SALT": value})
    said = [probe.said(float(t), "33.5, 0" if t == 10 else "33.5, 1") for t in range(20)]
    assert said == ["nothing"] * 5 + ["sent"] * 5 + ["the pump is off"] + ["nothing"] * 5 + ["sent"] * 4


def test_lines_that_come_at_once_count_one_after_the_other() -> None:
    translator = Translator(bridge_configuration())
    times = [translator.take(7.0, "33.5, 1").values["SALT"].taken_s for _ in range(5)]
    assert times == sorted(set(times))
    assert times[-1] < 7.01


def test_numbers_are_scaled() -> None:
    translator = Translator(
        bridge_configuration(values={"COND": {"field": 1, "scale": 10.0, "offset": -1.0}})
    )
    assert translator.take(0.0, "4.2, 0").values["COND"].value == pytest.approx(41.0)
    assert translator.take(1.0, "1e38, 0").unreadable == "a number is too large"
