"""The mission protocol, with what was seen on a real ArduPilot Rover."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.vessel import Position

START = Position(33.70, -118.40)
EAST, NORTH, FAR = START.moved(300.0, 0.0), START.moved(0.0, 300.0), START.moved(300.0, 300.0)
ACCEPTED, ERROR, NO_SPACE, BAD_SEQUENCE, DENIED, CANCELLED = 0, 1, 4, 13, 14, 15
FENCE, RALLY = 1, 2


def places(bench) -> list[tuple[int, int]]:
    return [(item.x, item.y) for item in bench.autopilot.store.items(0)]


def scaled(*positions: Position) -> list[tuple[int, int]]:
    return [(round(p.lat_deg * 1e7), round(p.lon_deg * 1e7)) for p in positions]


def types(messages) -> list[str]:
    return [each.get_type() for each in messages]


def test_an_upload_asks_with_the_legacy_request_and_ends_accepted(bench, gcs):
    (first,) = gcs.send("mission_count", 1, 1, 2, 0)
    assert (first.get_type(), first.seq, first.target_system, first.target_component) == (
        "MISSION_REQUEST",
        0,
        255,
        190,
    )
    (second,) = gcs.item(0)
    assert (second.get_type(), second.seq) == ("MISSION_REQUEST", 1)
    answers = gcs.item(1, EAST)
    assert answers[-1].get_type() == "MISSION_ACK"
    assert answers[-1].type == ACCEPTED
    assert places(bench) == scaled(START, EAST)


def test_the_integer_request_is_a_switch(make_bench):
    gcs = make_bench(request_int=True).station()
    assert types(gcs.send("mission_count", 1, 1, 2, 0)) == ["MISSION_REQUEST_INT"]


def test_a_float_item_is_taken_too(bench, gcs):
    gcs.send("mission_count", 1, 1, 2, 0)
    gcs.item(0)
    item = (3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, 33.75, -118.5, 0.0)
    assert gcs.send("mission_item", 1, 1, 1, *item, 0)[-1].type == ACCEPTED
    (lat, lon) = places(bench)[1]
    assert lat * 1e-7 == pytest.approx(33.75, abs=5e-6)
    assert lon * 1e-7 == pytest.approx(-118.5, abs=5e-6)


def test_item_0_is_home_whatever_was_uploaded_there(bench, gcs):
    gcs.send("mission_count", 1, 1, 2, 0)
    gcs.item(0, FAR)
    gcs.item(1, EAST)
    assert places(bench) == scaled(START, EAST)


def test_a_request_is_repeated_every_second_and_after_eight_the_upload_is_given_up(bench, gcs):
    gcs.upload(EAST, NORTH, FAR)
    gcs.heard.clear()
    gcs.send("mission_count", 1, 1, 4, 0)
    gcs.item(0)
    gcs.item(1, FAR)
    gcs.heard.clear()
    bench.advance(7.5, step_s=0.125)
    repeats = gcs.of("MISSION_REQUEST")
    assert [each.seq for each in repeats] == [2] * 7
    bench.advance(1.0, step_s=0.125)
    (ack,) = gcs.of("MISSION_ACK")
    assert (ack.type, ack.target_system) == (CANCELLED, 255)
    # Not atomic: a hybrid of the new mission's beginning and the old one's end is on board now.
    assert places(bench) == scaled(START, FAR, NORTH, FAR)
    assert gcs.item(2, NORTH)[-1].type == ERROR


def test_items_keep_an_upload_alive(bench, gcs):
    gcs.send("mission_count", 1, 1, 5, 0)
    for seq in range(4):
        bench.advance(6.0)
        gcs.item(seq, EAST)
    assert gcs.item(4, EAST)[-1].type == ACCEPTED


def test_a_shorter_count_truncates_at_once(bench, gcs):
    gcs.upload(EAST, NORTH, FAR)
    gcs.send("mission_count", 1, 1, 2, 0)
    assert places(bench) == scaled(START, EAST)


@pytest.mark.parametrize("seq", [0, 3, 900])
def test_an_item_out_of_turn_is_refused_and_the_upload_goes_on(bench, gcs, seq):
    gcs.send("mission_count", 1, 1, 3, 0)
    gcs.item(0)
    assert [each.type for each in gcs.item(seq, FAR)] == [BAD_SEQUENCE]
    gcs.item(1, EAST)
    assert gcs.item(2, NORTH)[-1].type == ACCEPTED
    assert places(bench) == scaled(START, EAST, NORTH)


def test_a_second_uploader_is_denied_while_one_is_under_way(bench, gcs):
    other = bench.station("companion", 1, 191)
    same_link = gcs.bench.station("gcs2", 254, 190)
    gcs.send("mission_count", 1, 1, 2, 0)
    for intruder in (other, same_link):
        assert [each.type for each in intruder.send("mission_count", 1, 1, 2, 0)] == [DENIED]
        assert [each.type for each in intruder.item(0)] == [ERROR]
        assert [each.type for each in intruder.send("mission_request_list", 1, 1, 0)] == [DENIED]
    gcs.item(0)
    assert gcs.item(1, EAST)[-1].type == ACCEPTED
    assert other.upload(NORTH) == ACCEPTED


def test_a_new_count_from_the_same_sender_starts_again(bench, gcs):
    gcs.send("mission_count", 1, 1, 3, 0)
    gcs.item(0)
    gcs.item(1, FAR)
    assert gcs.upload(EAST) == ACCEPTED
    assert places(bench) == scaled(START, EAST)


def test_the_sender_can_cancel(bench, gcs):
    gcs.send("mission_count", 1, 1, 3, 0)
    gcs.send("mission_ack", 1, 1, CANCELLED, 0)
    gcs.heard.clear()
    bench.advance(10.0)
    assert gcs.of("MISSION_REQUEST") == gcs.of("MISSION_ACK") == []


def test_655_items_fit_and_one_more_does_not(bench, gcs):
    assert [each.type for each in gcs.send("mission_count", 1, 1, 656, 0)] == [NO_SPACE]
    assert gcs.upload(*[EAST] * 654) == ACCEPTED
    assert len(bench.autopilot.store) == 655


@pytest.mark.parametrize(
    ("wrong", "result"),
    [
        ({"command": 22}, mav.MAV_MISSION_UNSUPPORTED),
        ({"frame": 1}, mav.MAV_MISSION_UNSUPPORTED_FRAME),
        ({"param1": math.nan}, mav.MAV_MISSION_INVALID_PARAM1),
        ({"param3": math.inf}, mav.MAV_MISSION_INVALID_PARAM3),
        ({"x": 910_000_000}, mav.MAV_MISSION_INVALID_PARAM5_X),
        ({"y": -1_800_000_001}, mav.MAV_MISSION_INVALID_PARAM6_Y),
        ({"z": math.nan}, mav.MAV_MISSION_INVALID_PARAM7),
    ],
)
def test_an_impossible_item_ends_the_upload_with_its_reason(bench, gcs, wrong, result):
    gcs.send("mission_count", 1, 1, 2, 0)
    gcs.item(0)
    assert [each.type for each in gcs.item(1, EAST, **wrong)] == [result]
    assert gcs.item(1, EAST)[-1].type == ERROR


def test_items_come_back_rounded(bench, gcs):
    gcs.send("mission_count", 1, 1, 3, 0)
    gcs.item(0)
    odd = {"param1": 7.9, "param2": 3.0, "param3": 2.0, "param4": math.nan, "z": 1.23456}
    gcs.item(1, FAR, frame=6, **odd)
    gcs.item(2, EAST, frame=5)
    (got,) = gcs.send("mission_request_int", 1, 1, 1, 0)
    assert (got.frame, got.param1, got.param2, got.param3, got.param4) == (3, 7.0, 0.0, 0.0, 0.0)
    assert (got.x, got.y) == scaled(FAR)[0]
    assert got.z == pytest.approx(1.23)
    assert got.autocontinue == 1
    (second,) = gcs.send("mission_request_int", 1, 1, 2, 0)
    assert second.frame == 0


def test_a_download_answers_in_the_form_of_the_question(bench, gcs):
    gcs.upload(EAST, NORTH)
    (count,) = gcs.send("mission_request_list", 1, 1, 0)
    assert (count.get_type(), count.count) == ("MISSION_COUNT", 3)
    assert types(gcs.send("mission_request_int", 1, 1, 2, 0)) == ["MISSION_ITEM_INT"]
    (floats,) = gcs.send("mission_request", 1, 1, 2, 0)
    assert floats.get_type() == "MISSION_ITEM"
    assert floats.x == pytest.approx(NORTH.lat_deg, abs=1e-5)


def test_asking_beyond_the_end_tells_the_length(gcs):
    gcs.upload(EAST)
    answers = gcs.send("mission_request_int", 1, 1, 2, 0)
    assert types(answers) == ["MISSION_COUNT", "MISSION_ACK"]
    assert (answers[0].count, answers[1].type) == (2, ERROR)


def test_clearing_works_outside_auto_only(bench, gcs):
    gcs.upload(EAST)
    gcs.command(400, 1)
    gcs.command(176, 1, 10)
    assert gcs.send("mission_clear_all", 1, 1, 0)[-1].type == ERROR
    assert len(bench.autopilot.store) == 2
    gcs.command(176, 1, 4)
    assert gcs.send("mission_clear_all", 1, 1, 0)[-1].type == ACCEPTED
    (count,) = gcs.send("mission_request_list", 1, 1, 0)
    assert count.count == 0
    assert gcs.command(176, 1, 10) == mav.MAV_RESULT_FAILED


def test_count_zero_clears(bench, gcs):
    gcs.upload(EAST)
    assert gcs.send("mission_count", 1, 1, 0, 0)[-1].type == ACCEPTED
    assert len(bench.autopilot.store) == 0


@pytest.mark.parametrize("kind", [FENCE, RALLY])
def test_fence_and_rally_points_are_kept_apart_and_stored_whole_or_not_at_all(bench, gcs, kind):
    gcs.upload(EAST)
    assert gcs.send("mission_request_list", 1, 1, kind)[0].count == 0
    command = 5001 if kind == FENCE else 5100
    corners = (EAST, FAR, NORTH)
    gcs.send("mission_count", 1, 1, 3, kind)
    gcs.item(0, EAST, command, mission_type=kind, param1=3.0)
    bench.advance(9.0)
    assert gcs.send("mission_request_list", 1, 1, kind)[0].count == 0
    gcs.send("mission_count", 1, 1, 3, kind)
    for seq, corner in enumerate(corners):
        answers = gcs.item(seq, corner, command, mission_type=kind, param1=3.0)
    assert answers[-1].type == ACCEPTED
    assert gcs.send("mission_request_list", 1, 1, kind)[0].count == 3
    (second,) = gcs.send("mission_request_int", 1, 1, 1, kind)
    assert ((second.x, second.y), second.param1, second.mission_type) == (scaled(FAR)[0], 3.0, kind)
    assert places(bench) == scaled(START, EAST)


def test_unknown_mission_types_are_unsupported(gcs):
    assert [each.type for each in gcs.send("mission_count", 1, 1, 2, 7)] == [mav.MAV_MISSION_UNSUPPORTED]
    assert [each.type for each in gcs.send("mission_request_list", 1, 1, 7)] == [mav.MAV_MISSION_UNSUPPORTED]


def test_an_uploader_that_vanishes_makes_room_after_eight_seconds(bench, gcs):
    gcs.send("mission_count", 1, 1, 3, 0)
    bench.autopilot.leave("gcs")
    del bench.stations["gcs"]
    other = bench.station("other", 254, 190)
    assert other.upload(EAST) == ERROR
    bench.advance(9.0)
    assert other.upload(EAST) == ACCEPTED


def test_messages_for_others_are_not_answered(bench, gcs):
    assert gcs.send("mission_count", 1, 191, 2, 0) == []
    assert gcs.send("mission_request_list", 2, 1, 0) == []
    echo = bench.station("echo", 1, 1)
    assert echo.send("mission_request_list", 1, 1, 0) == []
