"""The simulated instrument's own port."""

import asyncio

import numpy as np
import pytest

from sim.autopilot import Autopilot
from sim.endpoints import Endpoint
from sim.instrument import TextPort, line_format
from sim.sensor import Sensor
from sim.vessel import Position, Vessel


class Slope:
    def value(self, lat_deg, lon_deg, time_s):
        return 30.0 + 0.01 * time_s

    def is_land(self, lat_deg, lon_deg):
        return False


def test_lines_come_instead_of_mavlink():
    """A serial server's client gets a line for each reading of ten seconds, and the autopilot sends none."""

    async def read():
        port = TextPort(Endpoint("tcp", "127.0.0.1", 0), "t1= 17.0, s1= {value:.2f}")
        await port.open()
        reader, writer = await asyncio.open_connection("127.0.0.1", port.endpoint.port)

        while not port.has_listeners:
            await asyncio.sleep(0.01)
        sensor = Sensor(Slope(), np.random.default_rng(0), says=port.say)
        autopilot = Autopilot(Vessel(Position(0.0, 0.0)), sensor)
        autopilot.join(0.0, "client")
        sent = [message for k in range(10) for _, message in autopilot.advance(float(k), 1.0)]
        lines = [await reader.readline() for _ in range(10)]
        writer.close()
        port.close()
        return sent, lines

    sent, lines = asyncio.run(read())
    assert lines == [f"t1= 17.0, s1= {30.0 + 0.01 * k:.2f}\r\n".encode() for k in range(1, 11)]
    kinds = {message.get_type() for message in sent}
    assert "HEARTBEAT" in kinds
    assert "NAMED_VALUE_FLOAT" not in kinds


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no value", "must hold"),
        ("{salt:.2f}", "knows only"),
        ("{0}", "knows only"),
        ("{value:q}", "Unknown format code"),
        ("{value", "expected '}'"),
    ],
)
def test_lines_without_a_value_are_refused(text, said):
    with pytest.raises(ValueError, match=said):
        line_format(text)
