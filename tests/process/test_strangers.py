"""Many vehicles, and what strangers send: real ones are followed, nothing grows without bound, nothing else changes."""

import logging
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cbor2
import numpy as np
import pytest
from zenoh import CongestionControl

from autonomy import wire
from autonomy.effects import Topic
from autonomy.shore import roster
from autonomy.shore.roster import MAXIMUM_VEHICLES
from autonomy.shore.subscriber import Subscriber, VehicleView

sys.path.insert(0, str(Path(__file__).parent))
from shore_helpers import (
    SOON_S,
    free_endpoint,
    health_notice,
    learnt_model,
    model_snapshot,
    observation,
    plan_notice,
    session,
    survey_notice,
)

pytestmark = pytest.mark.process

BLOCK = CongestionControl.BLOCK  # or zenoh drops what a busy machine does not take at once
FLEET = 120


@pytest.fixture(scope="module")
def messages() -> dict[Topic, wire.Message]:
    model, _ = learnt_model()
    return {
        Topic.MODEL: replace(model_snapshot(model), precision="12 bit"),
        Topic.PLAN: plan_notice(),
        Topic.HEALTH: replace(health_notice(), run=7, observations_end=3),
        Topic.SURVEY: survey_notice(),
        Topic.STATUS: wire.StatusDigest(b"digest"),
        Topic.OBSERVATIONS: wire.ObservationBatch(7, 0, 0, 3, tuple(map(observation, range(3)))),
        Topic.LOG: wire.LogBatch(7, 0, 0, 1, (wire.LogNotice("info", "hello"),)),
    }


def spoilt(message: wire.Message) -> Iterator[bytes]:
    """What is not what its key promises, one of each kind."""
    good = wire.encode(message)
    content = cbor2.loads(good)
    rng = np.random.default_rng(5)
    yield b""
    yield rng.bytes(1000)
    yield good[:-1]
    yield cbor2.dumps({**content, "v": 2})
    yield cbor2.dumps({**content, "v": 2**60})
    yield cbor2.dumps([content])
    yield b"\x9b\x00\x00\x00\xff\xff\xff\xff\xff"
    yield b"\x5b\x00\x00\x00\xff\xff\xff\xff\xff"
    yield b"\x81" * 50_000
    yield wire.encode(message, packed=True)[:-4]
    for name, value in content.items():
        if isinstance(value, float | int) and not isinstance(value, bool) and name != "v":
            yield cbor2.dumps({**content, name: float("nan")})
            yield cbor2.dumps({**content, name: 1e300})
        if isinstance(value, cbor2.CBORTag) and value.tag == 86 and name != "value":
            yield cbor2.dumps({**content, name: cbor2.CBORTag(86, np.full(4, np.nan).tobytes())})
            yield cbor2.dumps({**content, name: cbor2.CBORTag(86, bytes(2**20))})


def test_on_every_key_what_is_not_what_it_promises_is_refused_and_changes_nothing(messages, caplog):
    caplog.set_level(logging.ERROR, logger="autonomy")
    endpoint = free_endpoint()
    updates = []
    with (
        Subscriber(listen=[endpoint], on_update=updates.append) as shore,
        session("client", connect=[endpoint]) as stranger,
    ):
        sent = 0
        for topic, message in messages.items():
            for payload in spoilt(message):
                stranger.put(wire.key("boat1", topic), payload, congestion_control=BLOCK)
                sent += 1
        assert shore.wait_for(lambda one: one.counters.refused == sent, SOON_S), shore.counters
        assert (updates, shore.latest("boat1")) == ([], VehicleView("boat1"))
        for topic, message in messages.items():
            stranger.put(wire.key("boat1", topic), wire.encode(message), congestion_control=BLOCK)
        assert shore.wait_for(lambda one: one.counters.received == len(messages), SOON_S)
        view = shore.latest("boat1")
        assert (view.plan, view.health, view.survey, view.status) == (
            *(messages[topic] for topic in (Topic.PLAN, Topic.HEALTH, Topic.SURVEY, Topic.STATUS)),
        )


def test_a_fleet_is_followed_whatever_names_strangers_use(messages, caplog):
    caplog.set_level(logging.ERROR, logger="autonomy")
    endpoint = free_endpoint()
    names = [f"boat{number}" for number in range(FLEET)]
    model = messages[Topic.MODEL]
    line = wire.encode(messages[Topic.LOG])
    with (
        Subscriber(listen=[endpoint]) as shore,
        session("client", connect=[endpoint]) as fleet,
        session("client", connect=[endpoint]) as stranger,
    ):
        for number in range(10_000):
            stranger.put(f"usv/stranger{number}/log", line, congestion_control=BLOCK)
        assert shore.wait_for(lambda one: one.counters.refused == 10_000 - MAXIMUM_VEHICLES, SOON_S)
        tokens = [fleet.liveliness().declare_token(wire.alive_key(name)) for name in names]
        assert shore.wait_for(lambda one: all(one.latest(name).alive for name in names), SOON_S)
        for name in names:
            payload = wire.encode(replace(model, vehicle=name))
            fleet.put(wire.key(name, Topic.MODEL), payload, congestion_control=BLOCK)
        false = [stranger.liveliness().declare_token(f"usv/false{number}/alive") for number in range(1000)]
        assert shore.wait_for(lambda one: all(one.latest(name).model is not None for name in names), SOON_S)
        assert shore.wait_for(lambda one: one.latest("false100").alive, SOON_S)
        assert len(shore.vehicles()) == MAXIMUM_VEHICLES
        assert set(names) <= set(shore.vehicles())
        del tokens, false


def test_models_of_strangers_find_no_room_without_end(messages, monkeypatch, caplog):
    """Each is small in bytes and large in memory: it is the memory that is bounded."""
    caplog.set_level(logging.ERROR, logger="autonomy")
    model = messages[Topic.MODEL]
    size = 2 * len(model.model) ** 2
    monkeypatch.setattr(roster, "LARGEST_MODELS", 5 * size)
    endpoint = free_endpoint()
    with Subscriber(listen=[endpoint]) as shore, session("client", connect=[endpoint]) as stranger:
        for number in range(8):
            payload = wire.encode(replace(model, vehicle=f"boat{number}"))
            stranger.put(f"usv/boat{number}/model", payload, congestion_control=BLOCK)
        assert shore.wait_for(lambda one: one.counters.refused == 3, SOON_S)
        newer = wire.encode(replace(model, vehicle="boat0", sequence=9))
        stranger.put("usv/boat0/model", newer, congestion_control=BLOCK)
        assert shore.wait_for(lambda one: one.latest("boat0").model.sequence == 9, SOON_S)
