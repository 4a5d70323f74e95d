"""Mission transfers as scripts: what the vehicle says, and what we answer."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission import (
    Failed,
    MissionDownload,
    MissionItem,
    MissionTransfer,
    MissionUpload,
    Phase,
    Route,
    Verified,
    missions_equal,
    time_scale,
    waypoint,
)
from autonomy.mavlink.mission_download import Download
from autonomy.mavlink.mission_upload import Upload

ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)
ITEMS = tuple(waypoint(33.0 + n / 100, -118.0, acceptance_radius_m=5.0) for n in range(2))
ACCEPTED, ERROR, NO_SPACE, SEQUENCE, BUSY, CANCELLED = 0, 1, 4, 13, 14, 15


def heard(message: Any, system_id: int = 1, component_id: int = 1) -> Any:
    return Codec(1, 191).decode(Codec(system_id, component_id).encode(message))[0]


def request(seq: int, mission_type: int = 0, legacy: bool = False, to: tuple[int, int] = (1, 191)) -> Any:
    kind = mavlink.MAVLink_mission_request_message if legacy else mavlink.MAVLink_mission_request_int_message
    return heard(kind(*to, seq, mission_type))


def ack(result: int, mission_type: int = 0, to: tuple[int, int] = (1, 191)) -> Any:
    return heard(mavlink.MAVLink_mission_ack_message(*to, result, mission_type))


def count(number: int, mission_type: int = 0) -> Any:
    return heard(mavlink.MAVLink_mission_count_message(1, 191, number, mission_type))


def item(seq: int, content: MissionItem) -> Any:
    back = Route(1, 1, vehicle_system=1, vehicle_component=191)
    return heard(content.to_message(back, seq))


def command_ack(result: int, command: int = 224) -> Any:
    return heard(mavlink.MAVLink_command_ack_message(command, result, 0, 0, 1, 191))


def current(seq: int, state: int = 3) -> Any:
    return heard(mavlink.MAVLink_mission_current_message(seq, 2, state, 0))


def kinds(messages: list[Any]) -> list[str]:
    return [message.get_type() for message in messages]


def sequence_numbers(messages: list[Any]) -> list[int]:
    assert set(kinds(messages)) <= {"MISSION_ITEM_INT"}
    return [message.seq for message in messages]


HOME = MissionItem(0, 16, 330000000, -1180000000)


def stored(waypoints: tuple[MissionItem, ...]) -> list[MissionItem]:
    """Waypoints as ArduPilot gives them back, behind home."""
    return [HOME] + [MissionItem(3, each.command, each.x, each.y, each.z) for each in waypoints]


def serve(machine: Any, now: float, on_board: list[MissionItem]) -> list[Any]:
    """Let the machine read a mission to its end; returns what it sends then."""
    sent = machine.handle(now, count(len(on_board)))
    while kinds(sent) == ["MISSION_REQUEST_INT"]:
        sent = machine.handle(now, item(sent[0].seq, on_board[sent[0].seq]))
    return list(sent)


def transfer_to_reading(**options: Any) -> MissionTransfer:
    transfer = MissionTransfer(ITEMS, ROUTE, **options)
    (announced,) = transfer.start(0.0)
    for seq in range(announced.count):
        transfer.handle(0.1, request(seq))
    assert kinds(transfer.handle(0.2, ack(ACCEPTED))) == ["MISSION_REQUEST_LIST"]
    assert transfer.phase is Phase.READING
    return transfer


class TestUpload:
    def test_every_request_and_repetition_is_answered(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        (announced,) = upload.start(0.0)
        assert (announced.get_type(), announced.count, announced.mission_type) == ("MISSION_COUNT", 2, 0)
        for seq in (0, 0, 1, 0, 1):
            (sent,) = upload.handle(0.1, request(seq))
            assert (sent.seq, sent.x) == (seq, ITEMS[seq].x)
        upload.handle(0.2, ack(ACCEPTED))
        assert upload.state is Upload.SENT
        assert sequence_numbers(upload.handle(0.3, request(1))) == [1]

    def test_the_old_request_gets_the_new_item(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        (sent,) = upload.handle(0.1, request(0, legacy=True))
        assert (sent.get_type(), sent.frame) == (
            "MISSION_ITEM_INT",
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        )

    def test_an_early_accepted_is_ignored(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, ack(ACCEPTED))
        assert upload.state is Upload.ANNOUNCED
        upload.handle(0.1, request(0))
        upload.handle(0.1, ack(ACCEPTED))
        assert upload.state is Upload.SERVING

    def test_words_for_others_are_ignored(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, request(0))
        upload.handle(0.1, request(1))
        assert upload.handle(0.1, request(0, mission_type=1)) == []
        assert upload.handle(0.1, request(0, to=(255, 190))) == []
        upload.handle(0.2, ack(ACCEPTED, mission_type=1))
        upload.handle(0.2, ack(ACCEPTED, to=(255, 190)))
        upload.handle(0.2, heard(mavlink.MAVLink_mission_ack_message(1, 191, 0, 0), component_id=100))
        assert upload.state is Upload.SERVING

    def test_out_of_sequence_is_waited_out(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, request(0))
        assert upload.handle(0.2, ack(SEQUENCE)) == []
        assert sequence_numbers(upload.handle(1.0, request(1))) == [1]
        upload.handle(1.1, ack(ACCEPTED))
        assert upload.state is Upload.SENT

    def test_out_of_sequence_after_a_repeated_last_item_ends_the_upload(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, request(0))
        upload.handle(0.1, request(1))
        upload.handle(0.1, ack(SEQUENCE))
        assert upload.state is Upload.SERVING, "that answered a doubled item 0"
        assert sequence_numbers(upload.on_deadline(0.4)) == [1]
        upload.handle(0.5, ack(SEQUENCE))
        assert upload.state is Upload.SENT

    def test_an_error_after_the_last_item_is_left_to_the_read_back(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, request(1))
        upload.handle(0.1, ack(ERROR))
        assert upload.state is Upload.SENT

    def test_another_uploader_is_waited_for(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, ack(BUSY))
        assert (upload.state, upload.contested, upload.touched) == (Upload.BUSY, True, False)
        assert upload.on_deadline(1.0) == []
        assert kinds(upload.on_deadline(2.2)) == ["MISSION_COUNT"]
        assert sequence_numbers(upload.handle(2.3, request(0))) == [0]

    def test_one_refusal_does_not_answer_two_counts(self) -> None:
        """The second may have been taken: then the mission is cut to its length already."""
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        assert kinds(upload.on_deadline(1.5)) == ["MISSION_COUNT"]
        upload.handle(1.6, ack(BUSY))
        assert (upload.state, upload.touched) == (Upload.BUSY, True)
        upload.handle(1.7, ack(BUSY))
        assert (upload.state, upload.touched) == (Upload.BUSY, False)

    @pytest.mark.parametrize("answers_after_s", [0.2, 0.6, 1.4])
    def test_a_slow_link_to_an_autopilot_that_takes_no_item_twice(self, answers_after_s: float) -> None:
        """It ends the upload over a doubled item, so ours must be the more patient timer in the end."""
        items, upload, now = ITEMS * 3, MissionUpload(ITEMS * 3, ROUTE), 0.0
        upload.start(now)
        for _ in range(5):
            upload.handle(now, request(0))
            for seq in range(len(items)):
                answered_at = now + answers_after_s
                repeats = []
                while (deadline := upload.next_deadline()) is not None and deadline < answered_at:
                    repeats += upload.on_deadline(deadline)
                now = answered_at
                if repeats:
                    upload.handle(now, ack(SEQUENCE))
                    upload.handle(now, ack(ERROR))
                    break
                upload.handle(now, request(seq + 1) if seq + 1 < len(items) else ack(ACCEPTED))
            if upload.state is Upload.SENT:
                return
            now = upload.next_deadline() or now
            upload.on_deadline(now)
        raise AssertionError(upload.state)

    def test_cancelled_by_the_vehicles_timeout_begins_again(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, request(0))
        assert kinds(upload.handle(8.1, ack(CANCELLED))) == ["MISSION_COUNT"]
        assert upload.handle(8.1, ack(CANCELLED)) == [], "a doubled one must not begin twice"

    def test_a_refused_mission_leaves_the_old_one(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.1, ack(NO_SPACE))
        assert (upload.state, upload.touched) == (Upload.FAILED, False)
        assert "no space" in upload.reason

    def test_a_silent_vehicle_is_asked_twelve_times(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        counts = len(upload.start(0.0))
        for _ in range(20):
            deadline = upload.next_deadline()
            if deadline is None:
                break
            counts += len(upload.on_deadline(deadline))
        assert counts == 12
        assert (upload.state, upload.touched) == (Upload.FAILED, True)

    def test_a_lost_item_is_sent_again_after_a_quarter_second(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(1.0, request(0))
        assert upload.next_deadline() == pytest.approx(1.25)
        assert upload.on_deadline(1.2) == []
        assert sequence_numbers(upload.on_deadline(1.25)) == [0]

    def test_silence_ends_an_upload_or_begins_it_again_when_the_vehicle_has_given_it_up(self) -> None:
        for served, silent_s, state in (
            ([0, 1], 3.9, Upload.SERVING),
            ([0, 1], 4.0, Upload.SENT),
            ([0], 8.9, Upload.SERVING),
            ([0], 9.0, Upload.ANNOUNCED),
        ):
            upload = MissionUpload(ITEMS, ROUTE)
            upload.start(0.0)
            for seq in served:
                upload.handle(0.0, request(seq))
            upload.on_deadline(silent_s)
            assert upload.state is state

    def test_cancelling_tells_the_vehicle(self) -> None:
        upload = MissionUpload(ITEMS, ROUTE)
        upload.start(0.0)
        upload.handle(0.0, request(0))
        (last_word,) = upload.cancel()
        assert (last_word.get_type(), last_word.type) == ("MISSION_ACK", CANCELLED)
        assert upload.handle(0.1, request(1)) == []


class TestDownload:
    def test_items_are_fetched_one_by_one_and_home_is_left_out(self) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        assert kinds(download.start(0.0)) == ["MISSION_REQUEST_LIST"]
        (last_word,) = serve(download, 0.1, stored(ITEMS))
        assert (last_word.get_type(), last_word.type) == ("MISSION_ACK", ACCEPTED)
        assert download.mission is not None
        assert missions_equal(ITEMS, download.mission)

    @pytest.mark.parametrize("on_board", [[], [HOME]])
    def test_an_empty_mission(self, on_board: list[MissionItem]) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        download.start(0.0)
        serve(download, 0.1, on_board)
        assert download.mission == ()

    def test_px4_has_no_home_item(self) -> None:
        download = MissionDownload(ROUTE, autopilot=12)
        download.start(0.0)
        serve(download, 0.1, list(ITEMS))
        assert download.mission == ITEMS

    def test_doubles_and_items_not_asked_for_are_ignored(self) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        download.start(0.0)
        on_board = stored(ITEMS)
        (wanted,) = download.handle(0.1, count(3))
        assert wanted.seq == 0
        assert download.handle(0.1, item(2, on_board[2])) == []
        (wanted,) = download.handle(0.1, item(0, on_board[0]))
        assert wanted.seq == 1
        assert download.handle(0.1, item(0, on_board[0])) == []
        assert download.handle(0.1, count(3)) == []
        assert sequence_numbers([]) == []
        assert download.on_deadline(0.4)[0].seq == 1

    def test_a_mission_that_changes_meanwhile_is_read_from_the_start(self) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        download.start(0.0)
        download.handle(0.1, count(3))
        assert kinds(download.handle(0.2, count(7))) == ["MISSION_REQUEST_LIST"]

    def test_a_busy_vehicle_is_asked_later(self) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        download.start(0.0)
        assert download.handle(0.1, ack(BUSY)) == []
        assert download.on_deadline(1.6) == []
        assert kinds(download.on_deadline(2.2)) == ["MISSION_REQUEST_LIST"]

    @pytest.mark.parametrize("answer", [ack(BUSY), ack(ERROR)], ids=["busy", "error"])
    def test_a_vehicle_that_puts_us_off_for_ever_is_given_up(self, answer: Any) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        now, asked = 100.0, len(download.start(100.0))
        while download.state is Download.LISTING:
            download.handle(now + 0.01, answer)
            deadline = download.next_deadline()
            assert deadline is not None
            assert now < deadline <= 160.0
            now = deadline
            asked += len(download.on_deadline(now))
        assert download.state is Download.FAILED
        assert download.reason
        assert now <= 160.0
        assert asked <= 40
        assert download.next_deadline() is None

    def test_a_mission_that_is_never_the_same_twice_is_given_up(self) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        now = 0.0
        download.start(now)
        while download.state is not Download.FAILED:
            now += 1.0
            download.handle(now, count(10 + int(now) % 2))
            download.on_deadline(now)
        assert now <= 60.0 + 11 * 0.5 + 1.0

    def test_a_crawling_download_ends_and_an_ordinary_slow_one_is_let_end(self) -> None:
        for item_s, done in [(0.3, True), (3.0, False)]:
            download = MissionDownload(ROUTE, autopilot=3)
            now = 0.0
            download.start(now)
            download.handle(now, count(600))
            seq = 0
            while download.state is Download.FETCHING:
                now += item_s
                download.handle(now, item(seq, HOME))
                download.on_deadline(now)
                seq += 1
            assert (download.state is Download.DONE) == done
            assert now <= 60.0 + 600 * 0.5 + item_s

    def test_more_items_than_any_mission_has_are_not_fetched(self) -> None:
        download = MissionDownload(ROUTE, autopilot=3)
        download.start(0.0)
        assert download.handle(0.1, count(65535)) == []
        assert download.state is Download.FAILED
        assert download.reason == "the vehicle tells of 65535 mission items, and 1000 are read at most"


class TestTransfer:
    def test_ardupilot_gets_a_home_item_and_px4_none(self) -> None:
        for autopilot, number in ((3, 3), (12, 2)):
            (announced,) = MissionTransfer(ITEMS, ROUTE, autopilot=autopilot).start(0.0)
            assert announced.count == number

    def test_verified_after_reading_back(self) -> None:
        transfer = transfer_to_reading()
        serve(transfer, 0.3, stored(ITEMS))
        assert transfer.outcome == Verified(ITEMS)
        assert transfer.next_deadline() is None
        assert transfer.handle(1.0, request(0)) == []

    def test_a_different_mission_on_board_is_sent_again_and_given_up_after_five_rounds(self) -> None:
        transfer = transfer_to_reading()
        wrong = stored((ITEMS[0], ITEMS[0]))
        for _ in range(4):
            assert "MISSION_COUNT" in kinds(serve(transfer, 0.3, wrong))
            for seq in range(3):
                transfer.handle(0.3, request(seq))
            transfer.handle(0.3, ack(ACCEPTED))
        serve(transfer, 0.3, wrong)
        assert isinstance(transfer.outcome, Failed)
        assert transfer.outcome.on_board_unknown
        assert "differs" in transfer.outcome.reason

    def test_requests_are_answered_while_reading_back(self) -> None:
        transfer = transfer_to_reading()
        assert sequence_numbers(transfer.handle(0.3, request(2))) == [2]

    def test_made_current_and_confirmed(self) -> None:
        transfer = transfer_to_reading(make_current=True)
        sent = serve(transfer, 0.3, stored(ITEMS))
        command = sent[-1]
        assert (command.get_type(), command.command, command.param1, command.param2) == (
            "COMMAND_LONG",
            224,
            1,
            0,
        )
        transfer.handle(0.4, current(1))
        assert transfer.outcome is None, "before the answer it still tells about the old mission"
        transfer.handle(0.5, command_ack(0, command=512))
        transfer.handle(0.5, command_ack(0))
        transfer.handle(0.6, current(1, state=4))
        assert transfer.outcome is None, "paused"
        transfer.handle(0.7, current(1))
        assert transfer.outcome == Verified(ITEMS)

    def test_a_complete_mission_is_restarted(self) -> None:
        transfer = transfer_to_reading(make_current=True, mission_state=5)
        assert serve(transfer, 0.3, stored(ITEMS))[-1].param2 == 1
        late = transfer_to_reading(make_current=True)
        assert serve(late, 0.3, stored(ITEMS))[-1].param2 == 0
        late.handle(0.4, command_ack(0))
        (command,) = late.handle(0.5, current(2, state=5))
        assert (command.command, command.param2) == (224, 1)
        late.handle(0.6, command_ack(0))
        late.handle(0.7, current(1))
        assert late.outcome == Verified(ITEMS)

    def test_a_mission_that_stays_complete_is_restarted_at_our_pace_not_at_the_links(self) -> None:
        """Such an autopilot accepts the command, answers at once that the mission is complete, and would for ever."""
        transfer = transfer_to_reading(make_current=True)
        now, commands, sent = 0.3, 0, serve(transfer, 0.3, stored(ITEMS))
        while transfer.outcome is None and commands < 100:
            if any(message.get_type() == "COMMAND_LONG" and message.command == 224 for message in sent):
                commands += 1
                transfer.handle(now, command_ack(0))
                sent = transfer.handle(now, current(2, state=5))
                continue
            deadline = transfer.next_deadline()
            assert deadline is not None
            now, sent = deadline, transfer.on_deadline(deadline)
        assert commands < 12
        assert isinstance(transfer.outcome, Failed)
        assert transfer.outcome.on_board is not None
        assert now < 15.0

    def test_an_autopilot_without_the_command_gets_the_old_message(self) -> None:
        transfer = transfer_to_reading(make_current=True)
        serve(transfer, 0.3, stored(ITEMS))
        (sent,) = transfer.handle(0.4, command_ack(3))
        assert (sent.get_type(), sent.seq) == ("MISSION_SET_CURRENT", 1)
        transfer.handle(0.5, current(1, state=0))
        assert transfer.outcome == Verified(ITEMS)

    def test_temporarily_rejected_means_later(self) -> None:
        transfer = transfer_to_reading(make_current=True)
        serve(transfer, 0.3, stored(ITEMS))
        assert transfer.handle(0.4, command_ack(1)) == []
        (again,) = transfer.on_deadline(1.9)
        assert (again.command, again.confirmation) == (224, 1)

    def test_a_mission_that_does_not_become_active_is_known_all_the_same(self) -> None:
        transfer = transfer_to_reading(make_current=True)
        serve(transfer, 0.3, stored(ITEMS))
        transfer.handle(0.4, command_ack(0))
        while (deadline := transfer.next_deadline()) is not None:
            transfer.handle(deadline, current(1, state=4))
            transfer.on_deadline(deadline)
        assert isinstance(transfer.outcome, Failed)
        assert not transfer.outcome.on_board_unknown
        assert transfer.outcome.on_board == ITEMS

    def test_the_limit_ends_it_and_tells_the_vehicle(self) -> None:
        transfer = MissionTransfer(ITEMS, ROUTE, limit_s=10.0)
        transfer.start(0.0)
        transfer.handle(9.9, request(0))
        (last_word,) = transfer.on_deadline(10.0)
        assert last_word.type == CANCELLED
        assert isinstance(transfer.outcome, Failed)
        assert transfer.outcome.on_board_unknown

    def test_an_empty_list_is_no_mission(self) -> None:
        with pytest.raises(ValueError, match="at least one waypoint"):
            MissionTransfer((), ROUTE)

    def test_timers_follow_a_fast_vehicle_and_slow_down_again(self) -> None:
        assert [time_scale(rate) for rate in (0.5, 1.0, 4.0, 500.0)] == [1.0, 1.0, 0.25, 0.1]
        upload = MissionUpload(ITEMS, ROUTE, time_scale=0.1)
        upload.start(0.0)
        upload.handle(0.0, request(0))
        pauses, now = [], 0.0
        for _ in range(10):
            deadline = upload.next_deadline()
            assert deadline is not None
            pauses.append(deadline - now)
            now = deadline
            upload.on_deadline(now)
        assert pauses[0] == pytest.approx(0.025)
        assert pauses[-1] == pytest.approx(0.25)


class TestItems:
    def test_waypoints_are_exact_in_1e7_degrees(self) -> None:
        point = waypoint(33.1234567, -118.7654321, acceptance_radius_m=5.0)
        assert (point.x, point.y) == (331234567, -1187654321)
        assert waypoint(0.0, 242.0, acceptance_radius_m=5.0).y == -1180000000

    @pytest.mark.parametrize(("lat", "lon"), [(91, 0), (0, -181), (float("nan"), 0), (0, float("inf"))])
    def test_places_off_the_earth_are_refused(self, lat: float, lon: float) -> None:
        with pytest.raises(ValueError, match="no such place"):
            waypoint(lat, lon, acceptance_radius_m=5.0)

    @pytest.mark.parametrize(
        ("sent", "read", "equal"),
        [
            ({"frame": 6}, {"frame": 3}, True),
            ({"frame": 5}, {"frame": 0}, True),
            ({"frame": 6}, {"frame": 0}, False),
            ({"param1": 2.7}, {"param1": 2.0}, True),
            ({"param1": 2.7}, {"param1": 3.0}, False),
            ({"param2": 5.0}, {"param2": 0.0}, True),
            ({"param2": 5.0}, {"param2": 4.0}, False),
            ({"z": 1.2345}, {"z": 1.23}, True),
            ({"z": 1.0}, {"z": 1.5}, False),
            ({"x": 1}, {"x": 2}, False),
            ({"y": 1}, {"y": 2}, False),
            ({"command": 16}, {"command": 19}, False),
        ],
    )
    def test_equal_as_far_as_autopilots_store(
        self, sent: dict[str, Any], read: dict[str, Any], equal: bool
    ) -> None:
        base = {"frame": 3, "command": 16, "x": 0, "y": 0}
        assert missions_equal([MissionItem(**base | sent)], [MissionItem(**base | read)]) is equal

    def test_missions_of_different_lengths_differ(self) -> None:
        assert not missions_equal(ITEMS, ITEMS[:1])
