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
