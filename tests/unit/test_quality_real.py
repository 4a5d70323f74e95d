"""What quality control makes of a lawnmower over real salinity: of clean readings, and of bad ones among them."""

import math

import numpy as np
import pytest
import shapely

from autonomy.config import QualitySection
from autonomy.geometry import LocalFrame
from autonomy.quality import Check, Flag, QualityControl, Reading, Waters

SEA = Waters(shapely.box(-1e6, -1e6, 1e6, 1e6), shapely.Polygon(), 0.0)
SPEED_MPS = 2.0
LEG_M, LANE_M = 20_000.0, 1000.0
COUNT = 20_000


@pytest.fixture(scope="module")
def track(real_data_dir):
    """Times, places (n, 2) and salinity along 40 km across the steepest fronts of the file; a reading a second."""
    from sim.field import open_field

    field = open_field(real_data_dir / "txla_roms_native_top10levels.nc", "salt")
    frame = LocalFrame(
        (field.bounds.south + field.bounds.north) / 2, (field.bounds.west + field.bounds.east) / 2
    )
    sailed = np.arange(COUNT) * SPEED_MPS
    leg, along = np.divmod(sailed, LEG_M + LANE_M)
    x = np.minimum(along, LEG_M)
    x = np.where(leg % 2 == 0, x, LEG_M - x) + 70_000.0
    y = leg * LANE_M + np.maximum(0.0, along - LEG_M) - 10_000.0
    degrees = frame.to_geodetic(np.stack([x, y], axis=-1))
    salinity = field.value(degrees[:, 0], degrees[:, 1], 0.0)
    assert np.isfinite(salinity).all()
    assert np.ptp(salinity) > 15.0
    return np.arange(COUNT, dtype=float), np.stack([x, y], axis=-1), salinity


def judge(track, noise_std, spoil=lambda values, rng: np.zeros(len(values), dtype=bool)):
    """Flags of the readings, and which of them were spoilt."""
    times, places, salinity = track
    rng = np.random.default_rng(7)
    values = salinity + noise_std * rng.standard_normal(COUNT)
    bad = spoil(values, rng)
    values = values.astype(np.float32).astype(float)
    quality = QualityControl(QualitySection(), (-math.inf, math.inf), SEA)
    judged = []
    for time_s, (x, y), value in zip(times.tolist(), places.tolist(), values.tolist(), strict=True):
        judged += quality.add(Reading(time_s, x, y, value), None)
    judged += quality.flush()
    return judged, bad


def refused(judged):
    return np.array([one.flag is not Flag.GOOD for one in judged])


@pytest.mark.parametrize("noise_std", [1e-3, 7e-3, 5e-2])
def test_clean_readings_are_good(track, noise_std):
    judged, _ = judge(track, noise_std)
    assert refused(judged).mean() <= 1e-3


def test_without_any_noise_only_what_does_not_change_at_all_is_refused(track):
    """A model's field is constant here and there, between grid points with one value; no probe says so."""
    judged, _ = judge(track, 0.0)
    others = [
        one for one in judged if max(flag for k, flag in enumerate(one.flags) if k != Check.FLAT_LINE) > 2
    ]
    assert len(others) <= 1e-3 * COUNT


def spikes(smallest, largest, length=1):
    """Of a size log-uniform between two multiples of the track's standard deviation, every hundred readings."""

    def spoil(values, rng):
        bad, sd = np.zeros(COUNT, dtype=bool), values.std()
        for start in range(50, COUNT - 50, 100):
            height = sd * math.exp(rng.uniform(math.log(smallest), math.log(largest)))
            values[start : start + length] += rng.choice([-1, 1]) * height * rng.uniform(0.8, 1.2, length)
            bad[start : start + length] = True
        return bad

    return spoil


def replaced(value, length, period):
    """Readings are `value`, or with None that before them, for `length` of `period`."""

    def spoil(values, rng):
        bad = np.zeros(COUNT, dtype=bool)
        for start in range(period, COUNT - length, period):
            values[start : start + length] = values[start - 1] if value is None else value
            bad[start : start + length] = True
        return bad

    return spoil


@pytest.mark.parametrize(
    ("spoil", "least"),
    [
        (spikes(5.0, 1000.0), 1.0),
        (spikes(5.0, 1000.0, length=3), 1.0),
        (replaced(0.0, 1, 100), 1.0),
        (replaced(0.0, 20, 500), 1.0),
        (replaced(3.4e38, 2, 100), 1.0),
        (replaced(math.nan, 5, 100), 1.0),
        (replaced(None, 60, 1000), 0.93),  # the first four of a run pass
        (replaced(None, 300, 2000), 0.98),
    ],
    ids=["spikes", "rows of spikes", "a zero", "zeros", "3.4e38", "NaN", "stuck", "stuck for long"],
)
def test_bad_readings_are_caught_and_good_ones_among_them_kept(track, spoil, least):
    judged, bad = judge(track, 7e-3, spoil)
    caught = refused(judged)
    assert caught[bad].mean() >= least
    # After a stuck probe, nothing is said about repeats for a minute; everything else stays good.
    assert caught[~bad].mean() <= 1e-3


@pytest.mark.parametrize(
    ("smallest", "largest", "least"), [(5.0, 7.0, 0.4), (7.0, 10.0, 0.75), (10.0, 1e3, 0.99)]
)
def test_spikes_not_much_larger_than_the_noise_are_caught_for_the_most_part(track, smallest, largest, least):
    noise_std = 7e-3
    sd = (track[2] + noise_std * np.random.default_rng(7).standard_normal(COUNT)).std()
    judged, bad = judge(track, noise_std, spikes(smallest * noise_std / sd, largest * noise_std / sd))
    caught = refused(judged)
    assert caught[bad].mean() >= least
    assert caught[~bad].mean() <= 1e-3
