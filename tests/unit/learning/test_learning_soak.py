"""Months of readings: the state stays sound, and what was learnt one by one is what all at once would tell.

By default some ten thousand readings; HALOCLINE_SOAK_UPDATES=1000000 makes it the long run.
"""

import os

import numpy as np
import pytest

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP, Update
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck

UPDATES = int(os.environ.get("HALOCLINE_SOAK_UPDATES", "20000"))
REBUILT = min(UPDATES, 100_000)
SCALE_M, NOISE = 1000.0, 0.1
STATIC = Kernel((Component(1.0, SquaredExponential((SCALE_M, SCALE_M))),), NOISE**2)
MOVING = Kernel(
    (
        Component(0.8, SquaredExponential((1.5 * SCALE_M, 1.5 * SCALE_M))),
        Component(0.2, SquaredExponential((SCALE_M, SCALE_M)), OrnsteinUhlenbeck(5000.0)),
    ),
    NOISE**2,
)
pytestmark = [
    pytest.mark.timeout(120 + UPDATES // 100),
    pytest.mark.parametrize("kernel", [STATIC, MOVING], ids=["static", "static + moving"]),
]


def voyage(extent_m, apart_m, n):
    """Among sixty places a vessel comes back to: a reading every `apart_m`, and long stops exactly where it is."""
    rng = np.random.default_rng(1)
    places = rng.uniform(0.0, extent_m, (60, 2))
    legs, count, at = [], 0, places[0]
    while count < n:
        if rng.random() < 0.2:
            leg = np.repeat(at[None], rng.integers(50, 1000), axis=0)
        else:
            goal = places[rng.integers(60)]
            steps = max(1, int(np.hypot(*(goal - at)) / apart_m))
            leg = at + np.linspace(0.0, 1.0, steps)[:, None] * (goal - at)
            at = goal
        legs.append(leg)
        count += len(leg)
    return np.concatenate(legs)[:n]


def truth(points, time_s, moving):
    """What stays, and on a moving sea a wave that goes round in about a day."""
    x, y = points.T / SCALE_M
    field = np.sin(0.9 * x + 0.3) * np.cos(0.7 * y) + 0.5 * np.cos(0.6 * x - 0.8 * y)
    if moving:
        phase = time_s / 8000.0
        field = field + 0.4 * np.sin(x + phase) * np.cos(1.1 * y - 0.7 * phase)
    return field


def sail(kernel, extent_m, apart_m, n, novelty):
    """A reading a second; the model that learnt them, the places, the readings and how often what became of them."""
    points, times, moving = voyage(extent_m, apart_m, n), np.arange(float(n)), not kernel.is_static
    values = truth(points, times, moving) + NOISE * np.random.default_rng(2).normal(size=n)
    gp, outcomes = SparseOnlineGP(kernel, 100, novelty), dict.fromkeys(Update, 0)
    for i in range(n):
        gp.advance(1.0 if i else 0.0)
        outcomes[gp.update(points[i], values[i])] += 1
    return gp, points, values, outcomes


def test_a_long_voyage_leaves_the_state_sound(kernel):
    """Twelve length-scales across: the basis never suffices, and is replaced all the time."""
    gp, _, _, outcomes = sail(kernel, 12.0 * SCALE_M, 10.0, UPDATES, 1e-3)
    assert gp.check() is None
    assert min(outcomes.values()) > 10
    axis = np.linspace(-0.1, 1.1, 60) * 12.0 * SCALE_M
    prediction = gp.predict_grid(axis, axis)
    assert np.isfinite(prediction.mean).all()
    assert np.abs(prediction.mean).max() < 10.0
    assert prediction.variance.min() > -1e-6
    assert prediction.variance.max() < 1.0 + 1e-6
    eigenvalues = np.linalg.eigvalsh(gp.model().whitened_covariance)
    assert eigenvalues[0] > -1e-9
    assert eigenvalues[-1] < 1.0 + 1e-9
    raw = gp._state.matrix[:-1]
    assert np.abs(raw - raw.T).max() < 1e-9
    for factor, group in zip(gp.model().factors, kernel.groups, strict=True):
        prior = group.covariance(gp.basis, gp.basis) + 1e-8 * group.variance * np.eye(len(gp))
        assert np.abs(factor @ factor.T - prior).max() < 1e-10
    print(
        f"\n{UPDATES} updates: {', '.join(f'{what.value} {n}' for what, n in outcomes.items())}; eigenvalues of S from "
        f"{eigenvalues[0]:.2e} to 1 − {1.0 - eigenvalues[-1]:.2e}, asymmetry {np.abs(raw - raw.T).max():.1e}"
    )


def test_a_stream_ends_where_telling_everything_to_its_last_basis_does(kernel):
    """Three length-scales across: the basis suffices, so hardly anything was lost on the way.

    On the track the error against the truth may differ by 1 % of itself. On the whole square, parts of which the
    vessel has not seen, the errors are those of an extrapolation: there the maps may differ by 1 % of σf.
    """
    extent = 3.0 * SCALE_M
    gp, points, values, _ = sail(kernel, extent, 2.0, REBUILT, 1e-6)
    fresh = SparseOnlineGP(kernel, gp.capacity, gp.novelty, gp.jitter, gp.prior_mean)
    fresh.start_basis(gp.basis, gp.basis_readings, gp.basis_counts)
    if kernel.is_static:
        fresh.absorb(points, values, np.full(REBUILT, kernel.noise_variance))
    else:
        for i in range(REBUILT):
            fresh.advance(1.0 if i else 0.0)
            fresh.project(points[i], values[i])
    axis = np.linspace(0.0, extent, 50)
    for what, places in (
        ("track", points[:: REBUILT // 2000]),
        ("square", np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)),
    ):
        expected = truth(places, REBUILT - 1.0, not kernel.is_static)
        one, all_at_once = gp.predict(places).mean, fresh.predict(places).mean
        error, rebuilt, apart = (
            float(np.sqrt(np.mean(difference**2)))
            for difference in (one - expected, all_at_once - expected, one - all_at_once)
        )
        print(f"\n{REBUILT} readings, {what}: RMSE {error:.5f}, rebuilt {rebuilt:.5f}, apart {apart:.6f}")
        assert what == "square" or abs(error / rebuilt - 1.0) < 0.01
        assert apart < 0.01
