"""Commands, parameters, streams, readiness, failsafe, and readings that are never lost."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot import Options
from sim.vessel import Position

START = Position(33.70, -118.40)
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4


def test_an_unasked_client_gets_everything_once_a_second(bench, gcs):
    bench.advance(20.0, step_s=0.05)
    for kind in (
        *("HEARTBEAT", "GPS_RAW_INT", "SYS_STATUS", "BATTERY_STATUS", "EKF_STATUS_REPORT", "SYSTEM_TIME"),
        *("MISSION_CURRENT", "ATTITUDE", "VFR_HUD", "NAV_CONTROLLER_OUTPUT"),
    ):
        assert len(gcs.of(kind)) == pytest.approx(20, abs=1), kind


def test_the_heartbeat_is_a_boats_under_ardupilot(bench, gcs):
    bench.advance(1.0)
    heartbeat = gcs.of("HEARTBEAT")[0]
    assert (heartbeat.type, heartbeat.autopilot) == (11, 3)
    assert heartbeat.base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert (heartbeat.custom_mode, heartbeat.system_status) == (0, mav.MAV_STATE_STANDBY)


def test_streams_run_on_protocol_time_and_stamps_on_the_vehicles(bench, gcs):
    bench.advance(10.0, speedup=50.0, step_s=0.02)
    times = gcs.of("SYSTEM_TIME")
    assert len(times) == pytest.approx(10, abs=1)
    assert times[-1].time_boot_ms - times[-2].time_boot_ms == pytest.approx(50_000, abs=1000)
    elapsed_us = times[-1].time_unix_usec - times[0].time_unix_usec
    assert elapsed_us == 1000 * (times[-1].time_boot_ms - times[0].time_boot_ms)
    assert times[0].time_unix_usec / 1e6 == pytest.approx(Options().start_utc_s, abs=60.0)


@settings(deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    steps=st.lists(st.floats(1e-3, 30.0), min_size=1, max_size=20),
    interval_s=st.sampled_from([0.3, 1.0, 7.0]),
)
def test_no_reading_is_lost_and_each_follows_its_own_position(make_bench, steps, interval_s):
    bench = make_bench()
    bench.autopilot.sensor.interval_s = interval_s
    stations = [bench.station("a"), bench.station("b", 254, 190)]
    for step_s in steps:
        bench.now += 0.02
        bench.deliver(bench.autopilot.advance(bench.now, step_s))
    elapsed_s = bench.autopilot.time_s
    assert elapsed_s == pytest.approx(sum(steps))
    for station in stations:
        values = station.of("NAMED_VALUE_FLOAT")
        assert len(values) == int((elapsed_s + 1e-6) / interval_s)
        for k, message in enumerate(station.heard):
            if message.get_type() == "NAMED_VALUE_FLOAT":
                before = station.heard[k - 1]
                assert before.get_type() == "GLOBAL_POSITION_INT"
                assert before.time_boot_ms == message.time_boot_ms
                assert message.name == "SALT"
        stamps = [each.time_boot_ms for each in values]
        assert stamps == [round(1000 * interval_s * (k + 1)) for k in range(len(values))]
        # This field's value is the time: readings were taken when their stamps say.
        assert [each.value for each in values] == pytest.approx([stamp / 1000 for stamp in stamps])


def test_intervals_are_each_clients_own(bench, gcs):
    other = bench.station("other", 254, 190)
    assert gcs.command(511, mav.MAVLINK_MSG_ID_ATTITUDE, 100_000) == ACCEPTED
    assert gcs.command(511, mav.MAVLINK_MSG_ID_VFR_HUD, -1) == ACCEPTED
    bench.advance(10.0, step_s=0.05)
    assert len(gcs.of("ATTITUDE")) == pytest.approx(100, abs=2)
    assert gcs.of("VFR_HUD") == []
    assert len(other.of("ATTITUDE")) == pytest.approx(10, abs=1)
    assert len(other.of("VFR_HUD")) == pytest.approx(10, abs=1)
    assert gcs.command(510, mav.MAVLINK_MSG_ID_ATTITUDE) == ACCEPTED
    assert gcs.of("MESSAGE_INTERVAL")[-1].interval_us == 100_000
    assert gcs.command(511, mav.MAVLINK_MSG_ID_ATTITUDE, 0) == ACCEPTED
    gcs.heard.clear()
    bench.advance(10.0)
    assert len(gcs.of("ATTITUDE")) == pytest.approx(10, abs=1)


def test_a_later_data_stream_request_overrides_an_interval(bench, gcs):
    gcs.command(511, mav.MAVLINK_MSG_ID_ATTITUDE, 100_000)
    gcs.send("request_data_stream", 1, 1, mav.MAV_DATA_STREAM_EXTRA1, 2, 1)
    bench.advance(10.0, step_s=0.05)
    assert len(gcs.of("ATTITUDE")) == pytest.approx(20, abs=2)
    gcs.send("request_data_stream", 1, 1, mav.MAV_DATA_STREAM_ALL, 0, 0)
    gcs.heard.clear()
    bench.advance(5.0)
    # The heartbeat belongs to no stream, and readings are no telemetry to be switched off.
    assert {each.get_type() for each in gcs.heard} == {
        "HEARTBEAT",
        "GLOBAL_POSITION_INT",
        "NAMED_VALUE_FLOAT",
    }


def test_messages_can_be_requested(bench, gcs):
    for number, kind in (
        (mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION"),
        (mav.MAVLINK_MSG_ID_HOME_POSITION, "HOME_POSITION"),
        (mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, "GPS_GLOBAL_ORIGIN"),
        (mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT, "EKF_STATUS_REPORT"),
    ):
        assert gcs.command(512, number) == ACCEPTED
        assert gcs.heard[-1].get_type() == kind
    assert gcs.command(512, 9999) == FAILED
    assert gcs.command(410) == ACCEPTED
    assert gcs.heard[-1].latitude == round(START.lat_deg * 1e7)
    assert gcs.command(520, 1) == ACCEPTED
    assert gcs.heard[-1].capabilities & mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT


def test_command_int_is_understood_and_the_acknowledgement_is_addressed(gcs):
    answers = gcs.send("command_int", 1, 1, 0, 400, 0, 0, 1.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    (ack,) = [each for each in answers if each.get_type() == "COMMAND_ACK"]
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (400, ACCEPTED, 255, 190)


def test_unknown_commands_are_unsupported(gcs):
    assert gcs.command(31010) == UNSUPPORTED
    assert gcs.command(22) == UNSUPPORTED


def test_modes_are_set_with_both_messages_and_only_as_custom_modes(bench, gcs):
    assert gcs.command(176, 0, 4) == DENIED
    assert gcs.command(176, 1, 99) == FAILED
    assert gcs.command(176, float("nan"), 4) == DENIED
    assert gcs.command(176, 1, 4) == ACCEPTED
    assert gcs.command(176, 1 | mav.MAV_MODE_FLAG_SAFETY_ARMED, 4) == ACCEPTED
    answers = gcs.send("set_mode", 1, 1, 5)
    assert [(each.command, each.result) for each in answers] == [(11, ACCEPTED)]
    assert [each.result for each in gcs.send("set_mode", 1, 0, 5)] == [DENIED]
    bench.advance(1.0)
    assert gcs.of("HEARTBEAT")[-1].custom_mode == 5


def test_before_the_estimator_is_ready_it_arms_but_does_not_go(make_bench):
    bench = make_bench(ready_after_s=40.0)
    gcs = bench.station()
    gcs.upload(START.moved(100.0, 0.0))
    bench.advance(5.0)
    flags = gcs.of("EKF_STATUS_REPORT")[-1].flags
    assert not flags & 0x10
    assert flags & 0x80
    assert gcs.command(400, 1) == ACCEPTED
    assert gcs.command(300) == FAILED
    assert any("position" in text for text in gcs.texts())
    bench.advance(40.0)
    flags = gcs.of("EKF_STATUS_REPORT")[-1].flags
    assert flags & 0x10
    assert not flags & 0x80
    assert gcs.command(300) == ACCEPTED


def test_arming_checks_are_a_switch(make_bench):
    bench = make_bench(ready_after_s=40.0, arming_checks=True)
    gcs = bench.station()
    assert gcs.command(400, 1) == FAILED
    assert gcs.texts() == ["Arm: need position estimate"]
    assert gcs.command(400, 1, 21196) == ACCEPTED
    assert gcs.command(400, 0) == ACCEPTED
    bench.advance(41.0)
    assert gcs.command(400, 1) == ACCEPTED


def test_parameters_are_listed_read_and_set(bench, gcs):
    everything = gcs.send("param_request_list", 1, 1)
    names = [each.param_id for each in everything]
    assert len(names) == len(set(names)) == everything[0].param_count
    assert [each.param_index for each in everything] == list(range(len(names)))
    wanted = {"FS_GCS_ENABLE", "FENCE_ENABLE", "WP_RADIUS", "WP_SPEED", "CRUISE_SPEED", "MAV_GCS_SYSID"}
    assert wanted <= set(names)
    (by_name,) = gcs.send("param_request_read", 1, 1, b"WP_RADIUS", -1)
    (by_index,) = gcs.send("param_request_read", 1, 1, b"", by_name.param_index)
    assert (by_name.param_value, by_index.param_id) == (2.0, "WP_RADIUS")
    gcs.send("param_set", 1, 1, b"WP_RADIUS", 12.5, mav.MAV_PARAM_TYPE_REAL32)
    assert gcs.of("PARAM_VALUE")[-1].param_value == 12.5
    assert gcs.send("param_request_read", 1, 1, b"NO_SUCH", -1) == []
    gcs.send("param_set", 1, 1, b"NO_SUCH", 1.0, 9)
    gcs.send("param_set", 1, 1, b"WP_RADIUS", float("nan"), 9)
    assert [each.param_value for each in gcs.of("PARAM_VALUE")[-2:]] == [12.5, 12.5]


def test_a_changed_parameter_is_told_to_everybody(bench, gcs):
    other = bench.station("other", 254, 190)
    gcs.send("param_set", 1, 1, b"WP_SPEED", 1.5, mav.MAV_PARAM_TYPE_REAL32)
    assert [each.param_value for each in other.of("PARAM_VALUE")] == [1.5]


def test_timesync_requests_are_answered_and_answers_are_not(bench, gcs):
    bench.advance(3.0)
    (reply,) = gcs.send("timesync", 0, 123456789)
    assert (reply.ts1, reply.tc1) == (123456789, 3_000_000_000)
    assert gcs.send("timesync", 5, 123456789) == []


def test_the_ground_stations_failsafe_holds_and_does_not_resume(bench, gcs):
    gcs.upload(START.moved(3000.0, 0.0))
    gcs.send("param_set", 1, 1, b"FS_GCS_ENABLE", 1, 2)
    companion = bench.station("companion", 1, 191)
    gcs.command(400, 1)
    gcs.command(300)
    for _ in range(10):
        gcs.send("heartbeat", 6, 8, 0, 0, 4, 3)
        bench.advance(1.0)
    assert gcs.of("HEARTBEAT")[-1].system_status == mav.MAV_STATE_ACTIVE
    for _ in range(10):
        companion.send("heartbeat", 18, 8, 0, 0, 4, 3)  # a companion does not count
        bench.advance(1.0)
    beat = gcs.of("HEARTBEAT")[-1]
    assert (beat.custom_mode, beat.system_status) == (4, mav.MAV_STATE_CRITICAL)
    gcs.send("heartbeat", 6, 8, 0, 0, 4, 3)
    bench.advance(2.0)
    beat = gcs.of("HEARTBEAT")[-1]
    assert (beat.custom_mode, beat.system_status) == (4, mav.MAV_STATE_ACTIVE)


def test_the_battery_drains(bench, gcs):
    bench.advance(2.0)
    bench.advance(20.0, speedup=600.0, step_s=1.0)
    first, last = gcs.of("BATTERY_STATUS")[0], gcs.of("BATTERY_STATUS")[-1]
    assert last.current_consumed > first.current_consumed
    assert last.battery_remaining < 100
    assert last.voltages[0] < first.voltages[0]
    battery = bench.autopilot.vessel.battery
    assert last.energy_consumed == pytest.approx(battery.used_wh * 36.0, rel=0.01)  # hectojoules
    assert last.current_consumed == pytest.approx(battery.drawn_c / 3.6, rel=0.01)  # mAh


@pytest.mark.parametrize(
    ("name", "value"),
    [("WP_SPEED", 1e30), ("WP_SPEED", -5.0), ("WP_RADIUS", -1.0), ("WP_RADIUS", 1e30), ("LOIT_RADIUS", 1e30)],
)
def test_absurd_parameters_make_absurd_boats_but_no_crash(bench, gcs, name, value):
    gcs.send("param_set", 1, 1, name.encode(), value, mav.MAV_PARAM_TYPE_REAL32)
    gcs.command(400, 1)
    gcs.command(176, 1, 15)
    gcs.send("set_position_target_global_int", 0, 1, 1, 6, 0xFFFC, -330_000_000, 1_000_000_000, *[0.0] * 9)
    bench.advance(20.0, speedup=100.0, step_s=1.0)
    assert 0.0 <= bench.autopilot.vessel.speed_mps <= 100.0
    assert len(gcs.of("NAMED_VALUE_FLOAT")) == 2000


@pytest.mark.parametrize(
    "options", [{"system_id": 255}, {"system_id": 0}, {"speed_mps": 0.0}, {"waypoint_radius_m": -1.0}]
)
def test_impossible_options_are_refused(options):
    with pytest.raises(ValueError, match=r"must be"):
        Options(**options)


def test_told_to_start_again_it_keeps_what_is_stored_and_nothing_else(make_bench):
    bench = make_bench(boot_clock_s=1000.0, ready_after_s=5.0)
    gcs = bench.station()
    bench.advance(6.0)
    gcs.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    gcs.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_ATTITUDE, -1.0)
    bench.autopilot.parameters.set("WP_RADIUS", 7.0)
    assert bench.autopilot.navigator.armed
    gcs.command(mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0)
    assert not bench.autopilot.navigator.armed
    assert not bench.autopilot.navigator.position_ok
    assert bench.autopilot.parameters["WP_RADIUS"] == 7.0
    gcs.heard.clear()
    bench.advance(6.0)
    assert gcs.of("SYSTEM_TIME")[-1].time_boot_ms <= 6000, "not what it showed at power-on"
    assert len(gcs.of("ATTITUDE")) == pytest.approx(6, abs=1)
    assert bench.autopilot.navigator.position_ok
