"""Model time over wraps, reboots, reordering and fast simulations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.mavlink.clock import ModelClock

WRAP_MS = 2**32


def feed(
    clock: ModelClock, start_now: float, start_ms: int, seconds: float, rate: float = 1.0
) -> list[float]:
    times = []
    for step in range(int(seconds / 0.25)):
        time_s = clock.observe(start_now + step * 0.25, start_ms + int(step * 250 * rate))
        if time_s is not None:
            times.append(time_s)
    return times


@pytest.mark.parametrize("rate", [1.0, 10.0, 500.0])
def test_the_rate_is_measured(rate: float) -> None:
    clock = ModelClock()
    assert clock.rate == 1.0
    feed(clock, 100.0, 5000, 5.0, rate)
    assert clock.rate == pytest.approx(rate, rel=0.01)


@pytest.mark.parametrize("rate", [1.0, 10.0, 500.0])
def test_the_rate_survives_jitter_and_stalls(rate: float) -> None:
    rng = np.random.default_rng(1)
    clock = ModelClock()
    vehicle_ms = 1000.0
    now = 0.0
    for step in range(200):
        now += 0.05
        vehicle_ms += 50 * rate
        if step == 100:
            now += 3.0  # the vehicle stands still
        if step == 150:
            now += 2.0  # we stand still, and the vehicle doesn't
            vehicle_ms += 2000 * rate
        clock.observe(now + 0.02 * rng.random(), int(vehicle_ms))
        if now > 3.0:
            assert clock.rate == pytest.approx(rate, rel=0.2)


def test_the_rate_follows_a_change_of_speed() -> None:
    clock = ModelClock()
    feed(clock, 0.0, 0, 30.0, 1.0)
    feed(clock, 30.0, 30_000, 15.0, 10.0)
    assert clock.rate == pytest.approx(10.0, rel=0.01)


@pytest.mark.parametrize("rate", [1.0, 500.0])
def test_the_counter_wraps_after_49_days(rate: float) -> None:
    clock = ModelClock()
    before = feed(clock, 0.0, WRAP_MS - int(5000 * rate), 5.0, rate)
    after = feed(clock, 5.0, 0, 5.0, rate)
    times = np.array(before + after)
    assert np.allclose(np.diff(times), 0.25 * rate, atol=2e-3)
    assert clock.reboots == 0


def test_a_straggler_from_before_the_wrap_keeps_its_time() -> None:
    clock = ModelClock()
    clock.observe(0.0, WRAP_MS - 500)
    after = clock.observe(0.5, 100)
    straggler = clock.observe(0.6, WRAP_MS - 100)
    assert after is not None
    assert straggler is not None
    assert after - straggler == pytest.approx(0.2)
    assert clock.reboots == 0


def test_a_reboot_goes_on_from_the_last_time() -> None:
    clock = ModelClock()
    before = feed(clock, 0.0, 3_600_000, 10.0)
    after = feed(clock, 40.0, 2000, 10.0)
    assert clock.reboots == 1
    assert after[0] == pytest.approx(before[-1] + 40.5 - 9.75, abs=0.01)
    assert np.all(np.diff(before + after) > 0)


def test_a_reboot_shortly_before_the_wrap_is_no_wrap() -> None:
    clock = ModelClock()
    feed(clock, 0.0, WRAP_MS - 86_400_000, 10.0)
    feed(clock, 40.0, 2000, 10.0)
    assert clock.reboots == 1


def test_system_time_tells_how_long_the_reboot_took() -> None:
    clock = ModelClock()
    utc_usec = 1_700_000_000_000_000
    feed(clock, 0.0, 100_000, 5.0)
    clock.observe_utc(5.0, 105_000, utc_usec)
    offset_s = clock.utc_offset_s
    assert offset_s == pytest.approx(1_700_000_000 - 105)
    feed(clock, 15.0, 2000, 5.0)
    clock.observe_utc(20.0, 7000, 0)  # no GPS yet
    assert clock.utc_offset_s == offset_s
    # Our own clock slept meanwhile: 300 seconds have passed in truth.
    clock.observe_utc(20.5, 7500, utc_usec + 300_000_000)
    assert clock.model_time_s == pytest.approx(405.0)
    assert clock.utc_offset_s == pytest.approx(offset_s)


def test_model_time_never_jumps_back_even_if_utc_says_so() -> None:
    clock = ModelClock()
    feed(clock, 0.0, 100_000, 5.0)
    clock.observe_utc(5.0, 105_000, 1_700_000_000_000_000)
    times = feed(clock, 100.0, 2000, 5.0)
    clock.observe_utc(105.0, 7000, 1_700_000_001_000_000)
    assert clock.model_time_s is not None
    assert clock.model_time_s >= times[-1]
    assert clock.utc_offset_s == pytest.approx(1_700_000_001 - clock.model_time_s)


@given(st.lists(st.integers(0, 900), min_size=5, max_size=60))
def test_reordering_within_a_second_is_no_reboot(delays_ms: list[int]) -> None:
    clock = ModelClock()
    arrivals = sorted((number * 100 + delay, number) for number, delay in enumerate(delays_ms))
    for arrival_ms, number in arrivals:
        assert clock.observe(arrival_ms / 1000, 10_000 + number * 100) == pytest.approx(10 + number / 10)
    assert clock.reboots == 0


def test_time_between_messages_is_extrapolated_at_the_vehicles_pace() -> None:
    clock = ModelClock()
    assert clock.estimate(0.0) is None
    feed(clock, 0.0, 0, 5.0, 10.0)
    assert clock.estimate(4.75 + 0.1) == pytest.approx(47.5 + 1.0, rel=0.01)


@pytest.mark.parametrize("rate", [1.0, 20.0, 500.0])
def test_late_packets_are_no_reboot_however_many(rate: float) -> None:
    clock = ModelClock()
    feed(clock, 0.0, 10_000_000, 10.0, rate)
    newest_s, newest_ms = clock.model_time_s, 10_000_000 + int(39 * 250 * rate)
    for step in range(12):
        assert clock.observe(9.8, newest_ms - int(3000 * rate) + 10 * step) is None
    assert (clock.reboots, clock.breaks, clock.model_time_s) == (0, 0, newest_s)
    assert clock.observe(10.0, newest_ms + int(250 * rate)) == pytest.approx(newest_s + 0.25 * rate, abs=0.01)


@pytest.mark.parametrize("rate", [1.0, 20.0, 500.0])
@pytest.mark.parametrize("silence_s", [2.0, 60.0, 1200.0])
def test_a_reboot_is_noticed_at_every_pace_and_after_every_silence(rate: float, silence_s: float) -> None:
    clock = ModelClock()
    feed(clock, 0.0, 2_000_000_000, 10.0, rate)
    uptime_ms = int(1000 * rate * (silence_s - 1.0))
    (first, *_) = feed(clock, 10.0 + silence_s, uptime_ms, 2.0, rate)
    assert clock.reboots == clock.breaks == 1
    assert first == pytest.approx(2_000_000 + (10.0 + silence_s) * rate, rel=0.01)


def test_a_stamp_that_stands_still_is_no_clock() -> None:
    clock = ModelClock()
    feed(clock, 0.0, 100_000, 10.0)
    for step in range(40):
        assert clock.observe(10.0 + step / 4, 0) is None
        assert clock.observe(10.0 + step / 4, 4_000_000_000) is None
    assert clock.breaks == 0
    assert clock.observe(20.0, 110_000) == pytest.approx(110.0)


def test_one_wild_stamp_moves_nothing() -> None:
    clock = ModelClock()
    feed(clock, 0.0, 100_000, 10.0)
    assert clock.observe(9.9, 4_000_000_000) is None
    times = feed(clock, 10.0, 110_000, 10.0)
    assert times[0] == pytest.approx(110.0)
    assert clock.breaks == 0


def test_a_clock_that_goes_on_far_ahead_is_followed_without_a_reboot() -> None:
    clock = ModelClock()
    utc_usec = 1_700_000_000_000_000
    feed(clock, 0.0, 100_000, 10.0)
    clock.observe_utc(9.9, 109_900, utc_usec)
    times = feed(clock, 20.0, 7_300_000, 5.0)  # our machine slept for two hours, its clock with it
    assert (clock.reboots, clock.breaks) == (0, 1)
    assert times[0] == pytest.approx(120.5, abs=0.01)
    clock.observe_utc(25.0, 7_305_000, utc_usec + 7_195_100_000)
    assert clock.model_time_s == pytest.approx(7305.0)


@pytest.mark.parametrize("wild_ms", [5_000_000, 130_000])
def test_a_wrong_stamp_that_was_believed_is_found_out(wild_ms: int) -> None:
    clock = ModelClock()
    clock.observe(0.0, wild_ms)  # before the rate was known
    times = feed(clock, 0.25, 100_000, 20.0)
    assert clock.reboots == 0
    assert clock.breaks == 1
    assert times[0] == pytest.approx(wild_ms / 1000 + 5.0, abs=0.5)
    assert np.all(np.diff(times) > 0)


def test_simulations_that_change_their_pace_are_followed() -> None:
    clock = ModelClock()
    feed(clock, 0.0, 0, 10.0, 1.0)
    feed(clock, 10.0, 10_000, 10.0, 500.0)
    assert clock.rate == pytest.approx(500.0, rel=0.01)
    assert clock.reboots == 0


def test_a_wrap_and_a_reboot_during_a_long_loss_of_the_link() -> None:
    day_ms, day_s = 86_400_000, 86_400.0
    for lost_s, uptime_ms, reboots in [(5 * day_s, day_ms, 0), (3 * day_s, 3_600_000, 1)]:
        clock = ModelClock()
        feed(clock, 0.0, WRAP_MS - 4 * day_ms, 10.0)
        feed(clock, lost_s, uptime_ms, 10.0)
        assert clock.reboots == reboots


@pytest.mark.parametrize("wrong_usec", [2**64 - 1, 4_102_444_800_000_000, 978_307_199_999_999, 1])
def test_a_date_of_another_century_is_none(wrong_usec: int) -> None:
    clock = ModelClock()
    feed(clock, 0.0, 100_000, 5.0)
    clock.observe_utc(5.0, 105_000, wrong_usec)
    assert clock.utc_offset_s is None


def test_after_a_reboot_a_wrong_date_does_not_age_the_model() -> None:
    clock = ModelClock()
    utc_usec = 1_700_000_000_000_000
    feed(clock, 0.0, 100_000, 5.0)
    clock.observe_utc(5.0, 105_000, utc_usec)
    feed(clock, 15.0, 2000, 5.0)
    clock.observe_utc(20.0, 7000, utc_usec + 31 * 86_400_000_000)
    assert clock.model_time_s == pytest.approx(120.0, abs=0.1)
    assert clock.utc_offset_s == pytest.approx(utc_usec / 1e6 + 31 * 86400 - 120.0, abs=0.1)
