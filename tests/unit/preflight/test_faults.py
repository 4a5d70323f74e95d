"""A boat with one thing wrong: preflight finds it, says what to do, and finds nothing else.

Every fault is seeded into the simulated autopilot, its instrument, the link to it, or the computer; the baseline,
with nothing wrong, shows that what is found is the fault.
"""

import itertools
import math
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.mavlink.signing import Signing, SigningKey
from autonomy.preflight.facts import Folder
from autonomy.preflight.finding import Grade
from sim.faults import Replaced
from sim.vessel import Position

sys.path.insert(0, str(Path(__file__).parent))
from pier import FENCE, UTC_S, Pier, autopilot, corner, polygon, settings, wrong


def changed(tree: dict[str, Any], **dotted: Any) -> dict[str, Any]:
    """Some keys of a configuration replaced; `a__b` is `a.b`, `...` leaves it out."""
    made = {section: dict(values) for section, values in tree.items()}
    for name, value in dotted.items():
        section, _, key = name.partition("__")
        made.setdefault(section, {})[key] = value
        if value is ...:
            del made[section][key]
    return made


def losing(*kinds: str) -> Callable[[Any], Any]:
    """A link that does not carry these messages."""
    return lambda message: None if message.get_type() in kinds else message


def saying(*kinds: str, **fields: Any) -> Callable[[Any], Any]:
    """A vehicle that says something else in messages of these kinds."""

    def spoil(message: Any) -> Any:
        if message.get_type() in kinds:
            for name, value in fields.items():
                setattr(message, name, value(getattr(message, name)) if callable(value) else value)
        return message

    return spoil


def from_system(number: int, kind: str) -> Callable[[Any], Any]:
    """Messages of a kind come from another system."""

    def spoil(message: Any) -> Any:
        if message.get_type() == kind:
            message._header.srcSystem = number
        return message

    return spoil


def with_a_neighbour() -> Callable[[Any], Any]:
    """Every other heartbeat is one of system 9's."""
    turns = itertools.cycle((1, 9))

    def spoil(message: Any) -> Any:
        if message.get_type() == "HEARTBEAT":
            message._header.srcSystem = next(turns)
        return message

    return spoil


def noisy() -> Callable[[bytes], bytes]:
    """A cable on which a byte of every tenth packet is wrong."""
    turns = itertools.cycle(range(10))
    return lambda packet: packet if next(turns) else packet[:-1] + bytes([packet[-1] ^ 0x10])


def key(letter: str) -> Signing:
    return Signing(SigningKey(letter.encode() * 32), lambda: UTC_S)


def set_to(**parameters: float) -> Callable[[Any], None]:
    """A boat with these parameters."""

    def prepare(boat: Any) -> None:
        for name, value in parameters.items():
            boat.parameters.set(name, value)

    return prepare


def fenced(*items: Any) -> Callable[[Any], None]:
    def prepare(boat: Any) -> None:
        boat.store.fence[:] = items

    return prepare


@dataclass
class Fault:
    """What is wrong, and what is to be found: check, grade, and words of finding and remedy."""

    name: str
    check: str
    grade: Grade
    said: str
    remedy: str
    also: tuple[str, ...] = ()
    config: dict[str, Any] = field(default_factory=dict)
    boat: dict[str, Any] = field(default_factory=dict)
    prepare: Callable[[Any], object] = lambda boat: None
    pier: dict[str, Any] = field(default_factory=dict)


FAIL, WARN = Grade.FAIL, Grade.WARN
QUALITY = ("sensor.quality",)
FAULTS = [
    Fault("nobody there", "link.vehicle", FAIL, "nothing came in for 15 s", "cross TX and RX", pier={"autopilot": None},
          also=("sensor.name",)),
    Fault("another vehicle", "link.vehicle", FAIL, "system 7 is not heard, but 1", "mavlink.system_id to 1",
          config={"mavlink__system_id": 7}),
    Fault("two vehicles", "link.vehicle", WARN, "several autopilots", "set mavlink.system_id",
          pier={"spoil": with_a_neighbour()}),
    Fault("another key", "link.vehicle", FAIL, "signing refuses them .refused: .* wrongly signed", "same key on both",
          pier={"their_key": key("a"), "our_key": key("b")}, also=("sensor.name",)),
    Fault("no key on their side", "link.vehicle", FAIL, "refused: .* unsigned", "same key on both",
          pier={"our_key": key("b")}, also=("sensor.name",)),
    Fault("open network, no key", "link.signing", WARN, "whoever is on that network", "signing.key_file",
          config={"mavlink__endpoint": "udpin:0.0.0.0:14551"}),
    Fault("only a ground station's messages", "link.vehicle", FAIL, "no heartbeat of an", "pass the autopilot",
          pier={"spoil": losing("HEARTBEAT")}),
    Fault("noise on the cable", "link.noise", WARN, r"damaged packets beside \d+ sound", "baud rate",
          pier={"garble": noisy()}),
    Fault("PX4", "autopilot.firmware", FAIL, "unsupported autopilot PX4", "install ArduPilot Rover",
          pier={"spoil": saying("HEARTBEAT", autopilot=mavlink.MAV_AUTOPILOT_PX4)}),
    Fault("old firmware", "autopilot.firmware", WARN, "Rover 3.5.2", "update",
          pier={"spoil": saying("AUTOPILOT_VERSION", flight_sw_version=3 << 24 | 5 << 16 | 2 << 8 | 255)}),
    Fault("a beta", "autopilot.firmware", WARN, "no official release", "stable release",
          pier={"spoil": saying("AUTOPILOT_VERSION", flight_sw_version=4 << 24 | 7 << 16 | 192)}),
    Fault("estimator not ready", "autopilot.estimator", FAIL, "no position of its own", "wait in the open",
          boat={"ready_after_s": 1e6}, also=("autopilot.status", "autopilot.arming")),
    Fault("failsafe in force", "autopilot.status", FAIL, "a failsafe has struck", "clear its cause",
          pier={"spoil": saying("HEARTBEAT", system_status=mavlink.MAV_STATE_CRITICAL)}),
    Fault("arming checks fail", "autopilot.arming", FAIL, "checks before arming fail", "PreArm",
          pier={"spoil": saying("SYS_STATUS", onboard_control_sensors_health=lambda h: h & ~(1 << 28))}),
    Fault("under way already", "autopilot.mode", FAIL, "armed, in AUTO", "take the boat",
          pier={"spoil": saying(
              "HEARTBEAT", custom_mode=10, base_mode=lambda bits: bits | mavlink.MAV_MODE_FLAG_SAFETY_ARMED)}),
    Fault("left armed", "autopilot.mode", WARN, "armed, in MANUAL", "disarm", pier={"spoil": saying(
        "HEARTBEAT", base_mode=lambda bits: bits | mavlink.MAV_MODE_FLAG_SAFETY_ARMED)}),
    Fault("home left elsewhere", "autopilot.home", FAIL, "from the survey area", "set home where",
          boat={"home": Position(34.5, -118.5)}, also=("energy.budget",)),
    Fault("home unknown", "autopilot.home", WARN, "RTL would have nowhere to go", "set home",
          pier={"spoil": losing("HOME_POSITION")}),
    Fault("home on land", "autopilot.home", WARN, "on land", "set home on the water",
          boat={"home": Position(33.5, -118.5)}),
    Fault("an old mission", "autopilot.mission", WARN, "a mission of 3 items is on board", "clear the mission",
          prepare=lambda boat: [boat.store.write(k, corner(FENCE[k], 16)) for k in range(4)]),
    Fault("failsafes do nothing", "safeguards.FS_ACTION", WARN, "FS_ACTION 0", "set FS_ACTION",
          prepare=set_to(FS_ACTION=0)),
    Fault("no ground station failsafe", "safeguards.FS_GCS_ENABLE", WARN, "FS_GCS_ENABLE 0", "set FS_GCS_ENABLE",
          prepare=set_to(FS_GCS_ENABLE=0)),
    Fault("fence switched off", "safeguards.FENCE_ENABLE", WARN, "fence is off", "FENCE_ENABLE to 1",
          prepare=set_to(FENCE_ENABLE=0)),
    Fault("battery not watched", "safeguards.BATT_MONITOR", WARN, "BATT_MONITOR 0", "set BATT_MONITOR",
          prepare=set_to(BATT_MONITOR=0)),
    Fault("low battery without consequence", "safeguards.BATT_FS_LOW_ACT", WARN, "BATT_FS_LOW_ACT 0", "BATT_LOW_VOLT",
          prepare=set_to(BATT_FS_LOW_ACT=0)),
    Fault("fence on, none on board", "safeguards.fence", FAIL, "none on board", "upload a fence",
          prepare=fenced()),
    Fault("safeguards can't be read", "safeguards.read", FAIL, "fence can't be read|not been read", "let parameters",
          pier={"spoil": losing("MISSION_COUNT")}),
    Fault("area outside the fence", "survey.fence", FAIL, "no navigable water is left", "draw the fence",
          prepare=fenced(*polygon([(lat + 0.2, lon) for lat, lon in FENCE])), also=("safeguards.rally",)),
    Fault("area half outside the fence", "survey.fence", WARN, r"5\d% of the survey's water", "room to spare",
          prepare=fenced(*polygon([(lat, min(lon, -118.5)) for lat, lon in FENCE]))),
    Fault("rally point on the island", "safeguards.rally", WARN, "33.50000, -118.50000 lies on land", "move it",
          prepare=lambda boat: boat.store.rally.append(corner((33.5, -118.5), mavlink.MAV_CMD_NAV_RALLY_POINT))),
    Fault("no fix", "position.fix", FAIL, "no fix", "into the open",
          pier={"spoil": saying("GPS_RAW_INT", fix_type=1)}),
    Fault("few satellites", "position.satellites", FAIL, "4 satellites", "antenna",
          pier={"spoil": saying("GPS_RAW_INT", satellites_visible=4)}),
    Fault("bad geometry", "position.hdop", WARN, "HDOP 3.1", "free view",
          pier={"spoil": saying("GPS_RAW_INT", eph=310)}),
    Fault("positions don't come", "position.rate", FAIL, "no position comes in", "GLOBAL_POSITION_INT",
          pier={"spoil": losing("GLOBAL_POSITION_INT")}),
    Fault("positions rare, and nothing is asked for", "position.rate", WARN, "2.1 positions a second", "SRn_POSITION",
          config={"authority__mode": "observe", "mavlink__position_rate_hz": 10.0}),
    Fault("vehicle without a date", "clock.utc", WARN, "has no date", "GPS fix", boat={"start_utc_s": 0.0}),
    Fault("computer a day behind", "clock.utc", FAIL, "24 hours behind", "timesyncd",
          boat={"start_utc_s": UTC_S + 86_400.0}),
    Fault("start on land", "survey.start", FAIL, "on land or in keep-out", "survey.land",
          boat={"at": Position(33.5, -118.5)}, also=("autopilot.home",)),
    Fault("start far away", "survey.start", FAIL, r"\d\d km from the survey's water", "longitude's sign",
          boat={"at": Position(33.3, -118.5)}, also=("autopilot.home", "energy.budget")),
    Fault("wrong name", "sensor.name", FAIL, "no reading is named SALT; heard are SAL1", "sensor.message_name: SAL1",
          boat={"sensor": {"name": "SAL1"}}),
    Fault("silent probe", "sensor.name", FAIL, "no readings come in", "switch the probe on",
          pier={"spoil": losing("NAMED_VALUE_FLOAT")}),
    Fault("probe of another system", "sensor.name", FAIL, "comes from system 42", "system id, 1",
          pier={"spoil": from_system(42, "NAMED_VALUE_FLOAT")}),
    Fault("slow probe", "sensor.rate", WARN, "only one reading|a reading every", "once to ten times",
          boat={"sensor": {"interval_s": 15.0}}),
    Fault("probe in air", "sensor.values", FAIL, "outside sensor.minimum", "into the water",
          boat={"sensor": {"faults": [lambda time_s, value: 0.1]}}, also=QUALITY),
    Fault("probe without a value", "sensor.values", FAIL, r"10 of 15 readings are without a value", "is it wet",
          boat={"sensor": {"faults": [Replaced(math.nan, 4.0, 3.0)]}}, also=QUALITY),
    Fault("stuck probe", "sensor.values", WARN, "all of them", "move the probe",
          boat={"sensor": {"faults": [lambda time_s, value: 33.512]}}, also=QUALITY),
    Fault("no limits for the probe", "sensor.limits", WARN, "sensor.minimum and sensor.maximum not set", "set sensor",
          config={"sensor__minimum": float("-inf"), "sensor__maximum": float("inf")}),
    Fault("battery unknown", "energy.battery", FAIL, "charge is not told", "BATT_MONITOR",
          pier={"spoil": saying("SYS_STATUS", "BATTERY_STATUS", battery_remaining=-1)}),
    Fault("battery nearly empty", "energy.budget", FAIL, "way to the survey's water and home", "charge or change",
          boat={"at": Position(33.44, -118.5), "used_wh": 4300.0}, also=("energy.battery",)),
    Fault("battery too small for the area", "energy.budget", WARN, "not four times across", "smaller area",
          config={"budget__energy_wh": 150.0}),
    Fault("no budget", "energy.budget", WARN, "as if the battery were endless", "budget.distance_m",
          config={f"budget__{key}": ... for key in ("distance_m", "energy_wh", "consumption_j_per_m")}),
    Fault("folder can't be written", "disk.journal", FAIL, "nothing can be written", "journal.directory",
          pier={"around": {"folders": (Folder("journal", Path("/j"), 0.0, "nothing can be written there"),)}}),
    Fault("disk full", "disk.checkpoint", FAIL, "12 MB free", "make room",
          pier={"around": {"folders": (Folder("checkpoint", Path("/c"), 12.0),)}}),
    Fault("disk smaller than the journal", "disk.journal", WARN, "less than journal.total_mb", "total_mb",
          pier={"around": {"folders": (Folder("journal", Path("/j"), 900.0),)}}),
    Fault("router away", "shore.router", WARN, "shore.example.org:7447: no session", "zenohd runs",
          pier={"around": {"routers": {"tcp/shore.example.org:7447": "no session can be opened"}}}),
    Fault("no router", "shore.router", WARN, "nothing is published", "set shore.connect",
          config={"shore__connect": []}),
    Fault("no land", "survey.land", WARN, "all of the survey area counts as water", "survey.land",
          pier={"around": {"doubts": ("survey.land: no polygons: all of the survey area counts as water",)}}),
]  # fmt: skip


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for all: equal surveys are read once."""
    return tmp_path_factory.mktemp("desk")


def pier(desk: Path, fault: Fault) -> Pier:
    configuration = Configuration.model_validate(changed(settings(desk), **fault.config))
    boat = autopilot(**fault.boat)
    fault.prepare(boat)
    return Pier(configuration, **({"autopilot": boat} | fault.pier))


def test_with_nothing_wrong_nothing_is_found(desk: Path) -> None:
    found = pier(desk, Fault("", "", FAIL, "", "")).findings()
    assert wrong(found) == {}
    assert len(found) >= 20
    assert not [each for each in found if each.grade is Grade.SKIP]


def test_a_signed_link_is_as_good(desk: Path) -> None:
    signed = pier(desk, Fault("", "", FAIL, "", "", pier={"their_key": key("a"), "our_key": key("a")}))
    assert wrong(signed.findings()) == {}


def test_there_are_enough_of_them() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 20


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_found_and_its_remedy_named(desk: Path, fault: Fault) -> None:
    found = wrong(pier(desk, fault).findings())
    assert fault.check in found
    finding = found[fault.check]
    assert finding.grade is fault.grade
    assert re.search(fault.said, finding.says), finding.says
    assert re.search(fault.remedy, finding.remedy), finding.remedy
    assert set(found) <= {fault.check, *fault.also}, found


def test_it_only_listens_and_asks(desk: Path) -> None:
    """Not one message that makes a vehicle do anything: heartbeats, questions, wishes for streams."""
    asked = pier(desk, Fault("", "", FAIL, "", ""))
    asked.findings()
    kinds = {each.get_type() for each in asked.said}
    assert kinds == {
        "HEARTBEAT", "COMMAND_LONG", "PARAM_REQUEST_READ", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK",
        "REQUEST_DATA_STREAM",
    }  # fmt: skip
    commands = {each.command for each in asked.said if each.get_type() == "COMMAND_LONG"}
    assert commands == {mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE}
