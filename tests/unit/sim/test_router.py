"""Several clients of one vessel: sequence numbers, forwarding, and bytes that are no MAVLink."""

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot import Autopilot
from sim.router import Router
from sim.vessel import Position, Vessel

COMPANION = (1, 191)
GCS = (255, 190)


@pytest.fixture
def router() -> Router:
    router = Router(Autopilot(Vessel(Position(33.7, -118.4))))
    router.join(0.0, "gcs")
    router.join(0.0, "boat")
    return router


def send(
    router: Router, client: str, identity: tuple[int, int], kind: str, *fields: Any
) -> dict[str, list[Any]]:
    """What each client hears after one of them has sent a message."""
    packet = getattr(mav, f"MAVLink_{kind}_message")(*fields).pack(mav.MAVLink(None, *identity))
    return parsed(router.receive(0.0, client, packet))


def parsed(packets: list[tuple[Any, bytes]]) -> dict[str, list[Any]]:
    heard: dict[str, list[Any]] = {}
    for client, packet in packets:
        heard.setdefault(client, []).extend(mav.MAVLink(None).parse_buffer(packet))
    return heard


def heartbeat(router: Router, client: str, identity: tuple[int, int]) -> dict[str, list[Any]]:
    return send(router, client, identity, "heartbeat", 18, 8, 0, 0, 4, 3)


def test_every_client_sees_gapless_sequence_numbers(router):
    heartbeat(router, "gcs", GCS)
    sequences: dict[str, list[int]] = {"gcs": [], "boat": []}
    for k in range(400):
        packets = router.advance(0.1 * k, 0.1)
        if k % 7 == 0:
            ask = mav.MAVLink_param_request_list_message(1, 1).pack(mav.MAVLink(None, *GCS))
            packets += router.receive(0.1 * k, "gcs", ask)
        for client, messages in parsed(packets).items():
            sequences[client] += [each.get_seq() for each in messages]
    for client, numbers in sequences.items():
        assert len(numbers) > 256, client
        assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(numbers))


def test_renumbered_packets_are_what_packing_would_have_made(router):
    (packet,) = [packet for client, packet in router.advance(0.0, 1.0) if client == "boat" and packet[4] == 3]
    (message,) = mav.MAVLink(None).parse_buffer(packet)
    packer = mav.MAVLink(None, 1, 1)
    packer.seq = 3
    assert message.pack(packer) == packet


def test_heartbeats_of_others_reach_every_client_that_has_spoken(router):
    assert heartbeat(router, "boat", COMPANION) == {}
    heard = heartbeat(router, "gcs", GCS)
    assert [(each.get_srcSystem(), each.get_type()) for each in heard["boat"]] == [(255, "HEARTBEAT")]
    assert "gcs" not in heard


def test_what_is_addressed_to_a_component_goes_to_it_alone_and_unchanged(router):
    router.join(0.0, "third")
    heartbeat(router, "boat", COMPANION)
    heartbeat(router, "third", (254, 190))
    heard = send(router, "gcs", GCS, "command_long", *COMPANION, 42, 0, *[0.0] * 7)
    assert list(heard) == ["boat"]
    (message,) = heard["boat"]
    assert (message.command, message.get_srcSystem(), message.get_srcComponent()) == (42, *GCS)
    answer = send(router, "boat", COMPANION, "command_ack", 42, 0, 0, 0, *GCS)
    assert list(answer) == ["gcs"]


def test_a_system_without_a_component_means_all_of_them(router):
    heartbeat(router, "boat", COMPANION)
    heard = send(router, "gcs", GCS, "param_request_read", 1, 0, b"WP_RADIUS", -1)
    assert [each.get_type() for each in heard["boat"]] == ["PARAM_REQUEST_READ"]
    assert [each.get_type() for each in heard["gcs"]] == ["PARAM_VALUE"]


def test_what_is_for_the_autopilot_is_not_passed_on(router):
    heartbeat(router, "boat", COMPANION)
    heard = send(router, "gcs", GCS, "param_request_read", 1, 1, b"WP_RADIUS", -1)
    assert list(heard) == ["gcs"]


def test_somebody_who_calls_himself_by_the_autopilots_name_is_dropped(router):
    heartbeat(router, "boat", COMPANION)
    assert heartbeat(router, "gcs", (1, 1)) == {}
    assert send(router, "gcs", (1, 1), "param_request_list", 1, 1) == {}


def test_a_client_that_left_gets_nothing(router):
    heartbeat(router, "boat", COMPANION)
    router.leave("boat")
    assert {client for client, _ in router.advance(5.0, 1.0)} == {"gcs"}
    assert heartbeat(router, "gcs", GCS) == {}


@given(junk=st.binary(max_size=300), cut=st.integers(0, 20))
def test_junk_is_skipped_and_what_follows_is_understood(junk, cut):
    router = Router(Autopilot(Vessel(Position(33.7, -118.4))))
    ask = mav.MAVLink_param_request_read_message(1, 1, b"WP_RADIUS", -1).pack(mav.MAVLink(None, *GCS))
    router.receive(0.0, "gcs", junk)
    router.receive(0.0, "gcs", ask[:cut])
    for _ in range(14):  # a false start of a packet can swallow as many bytes as it claims to have
        heard = parsed(router.receive(0.0, "gcs", ask)).get("gcs", [])
    assert [each.param_id for each in heard] == ["WP_RADIUS"]
