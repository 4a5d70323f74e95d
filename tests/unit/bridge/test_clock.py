"""The vehicle's clock by this computer's, over delays, drift, reboots and simulations."""

import numpy as np
import pytest

from autonomy.bridge.clock import VehicleClock

BOOTED_AT = 900.0


def stamp_ms(now: float, rate: float = 1.0) -> int:
    return int((now - BOOTED_AT) * 1000 * rate)


def test_before_the_vehicle_was_heard_nothing_is_known() -> None:
    assert VehicleClock().stamp(1.0, 1.0) is None


@pytest.mark.parametrize("drift", [-5e-5, 0.0, 5e-5])
def test_delays_of_the_link_hardly_matter(drift: float) -> None:
    """A tenth of a second late on average, one in fifty at once; crystals 50 ppm apart; for an hour."""
    rng = np.random.default_rng(2)
    sent_s = np.arange(1000.0, 4600.0, 0.5)
    delays_s = np.where(rng.random(sent_s.size) < 0.02, 0.001, rng.exponential(0.1, sent_s.size))
    clock, wrong_ms = VehicleClock(), []
    for sent, came in zip(sent_s, np.maximum.accumulate(sent_s + delays_s), strict=True):
        clock.observe(float(came), stamp_ms(sent, 1.0 + drift))
        told = clock.stamp(float(came), float(sent))
        assert told is not None
        wrong_ms.append(told - stamp_ms(sent, 1.0 + drift))
    # By 0.25 ms a second it sinks against the drifting clock, and some ms pass before the next quick message.
    assert np.max(np.abs(wrong_ms[200:])) <= 30


def test_times_past_are_stamped_as_the_clock_was_then() -> None:
    clock = VehicleClock()
    for second in range(1000, 1030):
        clock.observe(float(second), stamp_ms(second))
    assert clock.stamp(1029.0, 1016.0) == stamp_ms(1016.0)
    assert clock.stamp(1029.0, BOOTED_AT - 1.0) is None


def test_a_silent_vehicle_may_have_started_again() -> None:
    clock = VehicleClock()
    clock.observe(1000.0, stamp_ms(1000.0))
    assert clock.stamp(1004.0, 1004.0) is not None
    assert clock.stamp(1006.0, 1006.0) is None


def test_after_a_reboot_the_new_clock_counts() -> None:
    clock = VehicleClock()
    for second in range(1000, 1020):
        clock.observe(float(second), stamp_ms(second))
    for tick in range(8):
        clock.observe(1030.0 + 0.5 * tick, 2000 + 500 * tick)
    assert clock.reboots == 1
    assert clock.stamp(1033.5, 1033.5) == 5500
    assert clock.stamp(1033.5, 1025.0) is None  # before it had started


def test_over_the_wrap() -> None:
    clock = VehicleClock()
    for tick in range(-10, 10):
        clock.observe(1000.0 + tick, (2**32 + 1000 * tick + 500) % 2**32)
    assert clock.stamp(1009.0, 1009.0) == 9500


def test_a_simulation_at_twenty_times_the_pace() -> None:
    rng = np.random.default_rng(3)
    clock = VehicleClock()
    for second in np.arange(1000.0, 1060.0, 0.25):
        clock.observe(second + rng.exponential(0.005), stamp_ms(second, 20.0))
    told = clock.stamp(1059.8, 1058.8)
    assert told == pytest.approx(stamp_ms(1058.8, 20.0), abs=600)
