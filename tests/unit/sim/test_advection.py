"""The transport alone, against what must hold for any flow and against an exact solution."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.advection import Flow, Transport

ROWS, COLUMNS, CELL_M = 18, 23, 50.0


def coast(rng: np.random.Generator) -> np.ndarray:
    """Land in a corner, an island and some rocks."""
    land = np.zeros((ROWS, COLUMNS), dtype=bool)
    land[12:, :9] = True
    land[4:7, 14:17] = True
    land[tuple(rng.integers(0, (ROWS, COLUMNS), (6, 2)).T)] = True
    return land


def stream_function(rng: np.random.Generator, land: np.ndarray, closed: bool) -> np.ndarray:
    """Rough, and 0 wherever it touches land."""
    psi = 40.0 * rng.standard_normal((ROWS + 1, COLUMNS + 1))
    for rows in (slice(0, -1), slice(1, None)):
        for columns in (slice(0, -1), slice(1, None)):
            psi[rows, columns][land] = 0.0
    if closed:
        psi[[0, -1], :] = 0.0
        psi[:, [0, -1]] = 0.0
    return psi


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), diffusivity=st.sampled_from([0.0, 1.0, 30.0]))
def test_in_a_closed_sea_nothing_is_lost_and_nothing_crosses_land(seed: int, diffusivity: float) -> None:
    rng = np.random.default_rng(seed)
    land = coast(rng)
    flow = Flow.of(stream_function(rng, land, closed=True))
    transport = Transport(land, CELL_M, diffusivity)
    tracer = np.where(land, 1e6, rng.standard_normal((ROWS, COLUMNS)))  # a trace of land would be seen
    before = tracer.copy()
    for _ in range(20):
        tracer = transport.advanced(
            tracer, flow, transport.longest_step_s(flow), np.full((ROWS + 2, COLUMNS + 2), 1e6)
        )
    assert tracer[~land].sum() == pytest.approx(before[~land].sum(), abs=1e-10)
    assert np.array_equal(tracer[land], before[land])
    assert np.abs(tracer[~land]).max() < 10.0


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), diffusivity=st.sampled_from([0.0, 1.0, 30.0]))
def test_no_new_extremes_at_the_longest_step(seed: int, diffusivity: float) -> None:
    rng = np.random.default_rng(seed)
    land = coast(rng)
    flow = Flow.of(stream_function(rng, land, closed=False))
    transport = Transport(land, CELL_M, diffusivity)
    tracer = np.where(land, 50.0, rng.choice([-1.0, 1.0], (ROWS, COLUMNS)))
    inflow = rng.uniform(-1.0, 1.0, (ROWS + 2, COLUMNS + 2))
    for _ in range(20):
        tracer = transport.advanced(tracer, flow, transport.longest_step_s(flow), inflow)
        assert np.abs(tracer[~land]).max() <= 1.0 + 1e-12


def test_uniform_water_stays_uniform() -> None:
    rng = np.random.default_rng(0)
    land = coast(rng)
    flow = Flow.of(stream_function(rng, land, closed=False))
    transport = Transport(land, CELL_M)
    tracer = np.full((ROWS, COLUMNS), 33.5)
    for _ in range(50):
        tracer = transport.advanced(
            tracer, flow, transport.longest_step_s(flow), np.full((ROWS + 2, COLUMNS + 2), 33.5)
        )
    np.testing.assert_allclose(tracer, 33.5, atol=1e-11)


def disc_error(cells: int) -> float:
    """Mean error of a smooth bump after one turn of a rotating disc, relative to the bump's own mean."""
    side_m, turn_s = 1000.0, 1000.0
    cell_m = side_m / cells
    edge = np.linspace(-side_m / 2.0, side_m / 2.0, cells + 1)
    middle = 0.5 * (edge[1:] + edge[:-1])
    # ψ = Ω r² / 2 turns anticlockwise: u = −∂ψ/∂y = −Ω y, v = Ω x.
    flow = Flow.of(math.pi / turn_s * (edge[:, None] ** 2 + edge[None, :] ** 2))
    bump = np.exp(-((middle[None, :] - 200.0) ** 2 + middle[:, None] ** 2) / (2.0 * 70.0**2))
    transport = Transport(np.zeros((cells, cells), dtype=bool), cell_m)
    steps = math.ceil(turn_s / transport.longest_step_s(flow))
    tracer, calm = bump, np.zeros((cells + 2, cells + 2))
    for _ in range(steps):
        tracer = transport.advanced(tracer, flow, turn_s / steps, calm)
    return float(np.abs(tracer - bump).sum() / bump.sum())


def test_a_turning_disc_brings_a_bump_back_the_better_the_finer_the_cells() -> None:
    errors = [disc_error(cells) for cells in (32, 64, 128)]
    # A limited scheme of second order: at least 1.5 in the mean (it clips the top of the bump).
    assert errors[0] / errors[1] > 2.0**1.5
    assert errors[1] / errors[2] > 2.0**1.5
    assert errors[2] < 0.03


def test_a_quarter_turn_goes_the_right_way() -> None:
    cells = 40
    edge = np.linspace(-500.0, 500.0, cells + 1)
    middle = 0.5 * (edge[1:] + edge[:-1])
    flow = Flow.of(math.pi / 1000.0 * (edge[:, None] ** 2 + edge[None, :] ** 2))
    transport = Transport(np.zeros((cells, cells), dtype=bool), 25.0)
    tracer = np.exp(-((middle[None, :] - 250.0) ** 2 + middle[:, None] ** 2) / (2.0 * 90.0**2))
    steps = math.ceil(250.0 / transport.longest_step_s(flow))
    for _ in range(steps):
        tracer = transport.advanced(tracer, flow, 250.0 / steps, np.zeros((cells + 2, cells + 2)))
    row, column = np.unravel_index(int(np.argmax(tracer)), tracer.shape)
    assert (middle[column], middle[row]) == pytest.approx((0.0, 250.0), abs=26.0)


def test_diffusion_spreads_as_it_should() -> None:
    cells, diffusivity, duration_s = 60, 5.0, 2000.0
    middle = (np.arange(cells) + 0.5) * 20.0
    start = np.exp(-((middle - 600.0) ** 2) / (2.0 * 60.0**2))
    transport = Transport(np.zeros((cells, cells), dtype=bool), 20.0, diffusivity)
    still = Flow(np.zeros((cells, cells + 1)), np.zeros((cells + 1, cells)))
    steps = math.ceil(duration_s / transport.longest_step_s(still))
    tracer = np.tile(start, (cells, 1))
    for _ in range(steps):
        tracer = transport.advanced(tracer, still, duration_s / steps, np.zeros((cells + 2, cells + 2)))
    spread = float((tracer[30] * (middle - 600.0) ** 2).sum() / tracer[30].sum())
    assert spread == pytest.approx(60.0**2 + 2.0 * diffusivity * duration_s, rel=0.01)


def test_bad_input_is_refused() -> None:
    land = np.zeros((4, 5), dtype=bool)
    with pytest.raises(ValueError, match="side of a cell must be positive"):
        Transport(land, 0.0)
    with pytest.raises(ValueError, match="diffusivity must not be negative"):
        Transport(land, 10.0, -1.0)
    flow = Flow.of(np.arange(30.0).reshape(5, 6))
    with pytest.raises(ValueError, match=r"too long for this flow: at most 4\.16"):
        Transport(land, 10.0).advanced(np.zeros((4, 5)), flow, 5.0, np.zeros((6, 7)))
