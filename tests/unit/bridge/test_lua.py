"""The scripts for the autopilot, run by a real Lua on an autopilot of a few lines."""

import re
import struct
from pathlib import Path

import pytest

lupa = pytest.importorskip("lupa.lua53")

DOCS = Path(__file__).parents[3] / "docs"
SCRIPT = DOCS / "bridge" / "thermosalinograph.lua"
LINE = "t1= 23.7658, c1= 0.00019, s1= 33.5124\r\n"

# uint32_t_ud of ArduPilot's bindings, as far as scripts need it; numbers of Lua are 64 bits here and 32 there.
BINDINGS = """
local uint32 = {}
uint32.__index = uint32
local function make(value) return setmetatable({value = value % 4294967296}, uint32) end
local function plain(value) return type(value) == "table" and value.value or value end
uint32.__sub = function(a, b) return make(plain(a) - plain(b)) end
function uint32:toint() return self.value < 2147483648 and self.value or self.value - 4294967296 end
clock_ms, waiting, relays = 0, {}, {[0] = 1}
function millis() return make(clock_ms) end
serial = {}
function serial:find_serial(number) return number == 0 and port or nil end
port = {}
function port:begin(baud) assert(baud == 9600) end
function port:set_flow_control(kind) end
function port:available() return make(#waiting) end
function port:read() return table.remove(waiting, 1) end
relay = {}
function relay:get(number) return relays[number] end
gcs = {}
function gcs:send_text(severity, text) said(severity, text) end
function gcs:send_named_float(name, value) sent_now(name, value) end
mavlink = {}
function mavlink:send_chan(channel, id, payload)
  assert(channel >= 0 and channel < 5)
  if channel < 2 then sent(channel, id, payload) return true end
end
"""


class Autopilot:
    """Runs a script as ArduPilot does: what it returns is what is called next, and when."""

    def __init__(self, source: str, boot_ms: int = 5000) -> None:
        self.texts: list[str] = []
        self.readings: list[tuple[str, float, int]] = []
        self._lua = lupa.LuaRuntime(encoding="latin-1")
        globals_ = self._lua.globals()
        globals_.said = lambda _, text: self.texts.append(text)
        globals_.sent = self._sent
        globals_.sent_now = lambda name, value: self.readings.append((name, value, self.now_ms))
        self._lua.execute(BINDINGS)
        self._globals = globals_
        self.now_ms = globals_.clock_ms = boot_ms
        self._update, pause_ms = self._lua.execute(source)
        self._due_ms = boot_ms + pause_ms

    def _sent(self, channel: int, number: int, payload: str) -> None:
        raw = payload.encode("latin-1")
        assert (number, len(raw)) == (251, 18)
        stamp_ms, value, name = struct.unpack("<If10s", raw)
        if channel == 1:
            self.readings.append((name.rstrip(b"\0").decode(), value, stamp_ms))

    def run(self, seconds: float, line: str = "", every_s: float = 1.0) -> None:
        """Let time pass; a line comes now and then."""
        end_ms, line_ms = self.now_ms + round(1000 * seconds), self.now_ms
        while self.now_ms < end_ms:
            self.now_ms += 10
            self._globals.clock_ms = self.now_ms % 2**32
            if line and self.now_ms >= line_ms:
                line_ms += round(1000 * every_s)
                self.type(line)
            if self.now_ms >= self._due_ms:
                self._update, pause_ms = self._update()
                self._due_ms = self.now_ms + pause_ms

    def type(self, text: str) -> None:
        for byte in text.encode("latin-1"):
            self._lua.execute(f"waiting[#waiting + 1] = {byte}")

    def pump(self, *, on: bool) -> None:
        self._globals.relays[0] = int(on)


@pytest.fixture
def autopilot() -> Autopilot:
    return Autopilot(SCRIPT.read_text())


def test_readings_are_stamped_when_their_water_was_taken_in(autopilot: Autopilot) -> None:
    autopilot.run(40.0, LINE)
    salt = [(value, stamp) for name, value, stamp in autopilot.readings if name == "SALT"]
    assert {name for name, _, _ in autopilot.readings} == {"SALT", "TEMP"}
    assert salt[-1][0] == pytest.approx(33.5124)
    assert salt[-1][1] == pytest.approx(autopilot.now_ms - 10_000, abs=1100)
    assert 8 <= len(salt) <= 10  # nothing in the first half minute


def test_nothing_is_sent_while_the_pump_is_off_or_the_hose_full_of_old_water(autopilot: Autopilot) -> None:
    autopilot.run(40.0, LINE)
    autopilot.pump(on=False)
    autopilot.readings.clear()
    autopilot.run(20.0, LINE)
    autopilot.pump(on=True)
    autopilot.run(14.0, LINE)
    assert autopilot.readings == []
    autopilot.run(5.0, LINE)
    assert len(autopilot.readings) >= 8
    told = [text.removeprefix("thermosalinograph: ") for text in autopilot.texts]
    assert told == ["warming up", "sending", "the pump is off", "the hose is being flushed", "sending"]


def test_garbage_and_halves_of_lines_send_nothing(autopilot: Autopilot) -> None:
    autopilot.run(40.0, LINE)
    count = len(autopilot.readings)
    for garbage in ("\xff\x00" * 300, "\n33.5124\n", "t1= 23.7658, c1= 0.00019, s1= 33.5\n", LINE[:-9], "\n"):
        autopilot.type(garbage)
        autopilot.run(1.0)
    assert len(autopilot.readings) == count
    assert len([text for text in autopilot.texts if "can't read" in text]) == 1
    autopilot.run(2.0, LINE)
    assert len(autopilot.readings) > count
    assert all(len(text) <= 50 for text in autopilot.texts)


def test_over_the_wrap_of_the_clock() -> None:
    autopilot = Autopilot(SCRIPT.read_text(), boot_ms=2**32 - 45_000)
    autopilot.run(60.0, LINE)
    stamps = [stamp for name, _, stamp in autopilot.readings if name == "SALT"]
    assert any(stamp > 2**32 - 10_000 for stamp in stamps)
    assert stamps[-1] < 10_000


def test_without_a_delay_the_usual_function_serves() -> None:
    autopilot = Autopilot(SCRIPT.read_text().replace("DELAY_MS = 10000", "DELAY_MS = 0"))
    autopilot.run(40.0, LINE)
    assert ("SALT", pytest.approx(33.5124)) in [(name, value) for name, value, _ in autopilot.readings]


def test_the_pumps_script_tells_of_the_relay() -> None:
    (source,) = re.findall(r"^```lua\n(.*?)^```$", (DOCS / "bridge.md").read_text(), re.MULTILINE | re.DOTALL)
    autopilot = Autopilot(source)
    autopilot.run(5.0)
    autopilot.pump(on=False)
    autopilot.run(2.0)
    told = [(name, value) for name, value, _ in autopilot.readings]
    assert told[0] == ("PUMP", 1)
    assert told[-1] == ("PUMP", 0)


def test_the_script_of_the_operators_page_runs_too() -> None:
    page = (DOCS / "operating.md").read_text()
    (source,) = re.findall(r"^```lua\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    autopilot = Autopilot(source)
    autopilot.run(5.0, "33.5124\n")
    assert autopilot.readings[-1][:2] == ("SALT", pytest.approx(33.5124))
