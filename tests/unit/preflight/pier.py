"""A boat at the pier, ready to leave: the simulated autopilot, asked by preflight without sockets or waiting."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import Signing, told
from autonomy.planning.survey import SurveyArea, read_survey
from autonomy.preflight.checks import checks
from autonomy.preflight.conversation import Conversation
from autonomy.preflight.facts import Facts, Folder, Link, probe_of, vehicle_of
from autonomy.preflight.finding import Finding, Grade
from sim.autopilot import Autopilot, Options
from sim.autopilot.missions import MissionItem
from sim.router import Router
from sim.sensor import Sensor
from sim.vessel import Battery, Position, Vessel

UTC_S = 1_780_000_000.0
BEGAN_S = 100.0
STEP_S = 0.2
AREA = [(33.48, -118.52), (33.48, -118.48), (33.52, -118.48), (33.52, -118.52)]
FENCE = [(33.46, -118.54), (33.46, -118.46), (33.54, -118.46), (33.54, -118.54)]
ISLAND = [(33.495, -118.505), (33.495, -118.495), (33.505, -118.495), (33.505, -118.505)]
START = Position(33.484, -118.516)
SAFE = {
    "FS_GCS_ENABLE": 1,
    "FENCE_ENABLE": 1,
    "FENCE_TYPE": 4,
    "BATT_FS_LOW_ACT": 1,
    "BATT_FS_CRT_ACT": 1,
}


class Water:
    """Salinity that no two places share."""

    def value(self, lat_deg: Any, lon_deg: Any, time_s: Any) -> Any:
        return 33.5 + (lat_deg - 33.5) + (lon_deg + 118.5)

    def is_land(self, lat_deg: Any, lon_deg: Any) -> Any:
        return np.zeros(np.shape(lat_deg), dtype=bool)


def corner(place: tuple[float, float], command: int, count: float = 4.0) -> MissionItem:
    at = MissionItem.at(Position(*place))
    return MissionItem(at.frame, command, (count, 0.0, 0.0, 0.0), at.x, at.y, 0.0)


def polygon(corners: list[tuple[float, float]], *, inside: bool = True) -> list[MissionItem]:
    kinds = (
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    )
    return [corner(each, kinds[inside], len(corners)) for each in corners]


def settings(folder: Path) -> dict[str, Any]:
    """Of a boat with which nothing is wrong."""
    land = folder / "land.geojson"
    ring = [[lon, lat] for lat, lon in [*ISLAND, ISLAND[0]]]
    land.write_text(f'{{"type": "Polygon", "coordinates": [{ring}]}}')
    return {
        "mavlink": {"endpoint": "serial:/dev/ttyAMA0:921600"},
        "sensor": {"minimum": 2.0, "maximum": 42.0},
        "survey": {"area": AREA, "land": land, "standoff_m": 50.0, "passage_cells": 40},
        "budget": {"distance_m": 40_000.0, "energy_wh": 5000.0, "consumption_j_per_m": 60.0},
        "shore": {"connect": ["tcp/shore.example.org:7447"]},
    }


def autopilot(sensor: dict[str, Any] | None = None, *, at: Position = START, home: Position | None = None,
              used_wh: float = 0.0, **options: Any) -> Autopilot:  # fmt: skip
    """Of a boat with which nothing is wrong, but for what is said otherwise."""
    probe = Sensor(Water(), np.random.default_rng(1), **{"noise_std": 0.01, **(sensor or {})})
    vessel = Vessel(at, battery=Battery(used_wh=used_wh))
    made = Autopilot(vessel, probe, Options(**{"start_utc_s": UTC_S, **options}), home=home)
    for name, value in SAFE.items():
        made.parameters.set(name, value)
    made.store.fence[:] = polygon(FENCE)
    made.store.rally[:] = [corner((33.482, -118.518), mavlink.MAV_CMD_NAV_RALLY_POINT)]
    return made


@dataclass
class Pier:
    """One preflight.

    Attributes:
        configuration: as the service would read it.
        autopilot: of the boat; None: nobody is there.
        spoil: every message on its way from the vehicle; None is lost.
        garble: every packet from the vehicle, as it arrives.
        their_key, our_key: signing, if there is any.
        seconds: of listening.
    """

    configuration: Configuration
    autopilot: Autopilot | None = field(default_factory=autopilot)
    spoil: Callable[[Any], Any | None] = lambda message: message
    garble: Callable[[bytes], bytes] = lambda packet: packet
    their_key: Signing | None = None
    our_key: Signing | None = None
    seconds: float = 15.0
    around: dict[str, Any] = field(default_factory=dict)

    def findings(self) -> list[Finding]:
        return checks(self.facts())

    def facts(self) -> Facts:
        configuration = self.configuration
        survey = survey_of(configuration)
        self.talk = talk = Conversation.of(configuration)
        codec = Codec(1, configuration.mavlink.component_id, self.our_key)
        self.said: list[Any] = []
        bytes_in = sum(self._converse(talk, codec))
        refused = "" if self.our_key is None else told(self.our_key.refused)
        counters = codec.counters
        link = Link(
            "", self.seconds, bytes_in, counters.messages, counters.bad_frames, refused, dict(talk.autopilots)
        )
        known: dict[str, Any] = {
            "link": link,
            "vehicle": vehicle_of(talk, self.seconds, (BEGAN_S + self.seconds, UTC_S + self.seconds)),
            "probe": probe_of(talk, configuration, survey),
            "folders": (Folder("journal", Path("/j"), 50_000.0), Folder("checkpoint", Path("/c"), 50_000.0)),
            "routers": dict.fromkeys(configuration.shore.connect, ""),
        }
        return Facts(configuration, survey, **(known | self.around))

    def _converse(self, talk: Conversation, codec: Codec) -> Iterator[int]:
        """The bytes that each step of it brings."""
        boat = self.autopilot
        router = None if boat is None else Router(boat, self.their_key)
        if router is not None:
            router.join(BEGAN_S, "preflight")
        for step in range(round(self.seconds / STEP_S)):
            now = BEGAN_S + STEP_S * (step + 1)
            packets = [] if router is None else router.advance(now, STEP_S)
            out = talk.step(now)
            brought = 0
            while packets or out:
                for client, data in packets:
                    if client == "preflight":
                        brought += len(data)
                        spoilt = map(self.spoil, codec.decode(self.garble(data)))
                        out += [each for message in spoilt if message for each in talk.handle(now, message)]
                self.said += out
                if talk.state is not None:
                    codec.system_id = talk.state.system_id
                sent = [codec.encode(message) for message in out]
                packets = (
                    [] if router is None else [p for d in sent for p in router.receive(now, "preflight", d)]
                )
                out = []
            yield brought


_SURVEYS: dict[str, SurveyArea] = {}


def survey_of(configuration: Configuration) -> SurveyArea:
    """Read once for equal sections: ways over water take a while to prepare."""
    key = configuration.survey.model_dump_json()
    if key not in _SURVEYS:
        _SURVEYS[key] = read_survey(configuration.survey)
    return _SURVEYS[key]


def wrong(findings: list[Finding]) -> dict[str, Finding]:
    """What is not as it should be, by check."""
    return {each.check: each for each in findings if each.grade in (Grade.WARN, Grade.FAIL)}
