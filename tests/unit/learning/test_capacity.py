import math
import pickle
from typing import get_args

import numpy as np
import pytest

from autonomy.config import Candidate, EstimationSection
from autonomy.learning.basis import select_basis
from autonomy.learning.capacity import (
    FEWEST,
    MOST,
    Budget,
    affordable,
    choose_capacity,
    replacement_us,
    state_bytes,
)
from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.spatial import SPATIAL, Matern32, SquaredExponential
from autonomy.learning.structures import STRUCTURES
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static

AREA_M2 = 1e6
AMPLE = Budget(1e4, 1e6)


STILL = (Static(),)


def kernel(space=SquaredExponential, scale=150.0, times=STILL):
    return Kernel(tuple(Component(1.0, space((scale, scale)), time) for time in times), 0.01)


def test_it_is_three_basis_vectors_a_patch_for_a_smooth_kernel():
    assert choose_capacity(kernel(scale=120.0), AREA_M2, AMPLE) == 209
    anisotropic = Hyperparameters(1.0, 0.1, (60.0, 240.0)).kernel
    assert choose_capacity(anisotropic, AREA_M2, AMPLE) == 209


def test_the_most_demanding_component_decides():
    long = Component(1.0, SquaredExponential((500.0, 500.0)))
    short = Component(0.1, SquaredExponential((120.0, 120.0)), OrnsteinUhlenbeck(100.0))
    for components in ((long, short), (short, long)):
        assert choose_capacity(Kernel(components, 0.01), AREA_M2, AMPLE) == 209


def test_a_rough_kernel_wants_two_to_three_hundred_where_a_smooth_one_wants_a_hundred():
    scale = math.sqrt(3.0 * AREA_M2 / 100.0)
    assert choose_capacity(kernel(scale=scale), AREA_M2, AMPLE) == pytest.approx(100, abs=1)
    assert 200 <= choose_capacity(kernel(Matern32, scale), AREA_M2, AMPLE) <= 300


@pytest.mark.parametrize("scale", [1e3, 1e5])
def test_however_long_a_rough_kernel_is_its_basis_follows_the_track(scale):
    # With 50 the error on real surveys was twice that of the exact process; a smooth kernel as long needs no more.
    smooth, rough = Component(1.0, SquaredExponential((1e5,) * 2)), Component(1.0, Matern32((scale,) * 2))
    assert choose_capacity(Kernel((smooth, rough), 0.01), AREA_M2, AMPLE) == 200
    assert choose_capacity(Kernel((smooth,), 0.01), AREA_M2, AMPLE) == FEWEST


def test_every_spatial_kernel_has_a_density():
    for space in SPATIAL.values():
        assert FEWEST <= choose_capacity(kernel(space), AREA_M2, AMPLE) <= MOST


def test_it_is_never_below_the_floor_nor_above_what_is_worth_it():
    assert choose_capacity(kernel(scale=1e5), AREA_M2, AMPLE) == FEWEST
    assert choose_capacity(kernel(scale=1.0), AREA_M2, AMPLE) == MOST
    assert choose_capacity(kernel(scale=1.0), AREA_M2, AMPLE, most=120) == 120
    assert choose_capacity(kernel(scale=1.0), AREA_M2, Budget(0.01, 81.0)) == FEWEST


@pytest.mark.parametrize("times", [STILL, (Static(), OrnsteinUhlenbeck(9.0)), (Static(), MaternMotion(9.0))])
@pytest.mark.parametrize("budget", [Budget(4.0, 1e6), Budget(1e4, 1000.0), Budget()])
def test_what_is_chosen_fits_the_budget_and_one_more_would_not(times, budget):
    field = kernel(times=times)
    D = field.states * affordable(field, budget)

    def fits(capacity):
        spent_us = replacement_us(field.states * capacity)
        return state_bytes(field, capacity) <= budget.memory_mb * 1e6 and spent_us <= budget.update_us

    assert fits(D // field.states)
    assert not fits(D // field.states + 1)


def test_more_states_leave_room_for_fewer_basis_vectors():
    budget = Budget(1e4, 1000.0)
    one, two, three = (
        affordable(kernel(times=times), budget)
        for times in (STILL, (Static(), OrnsteinUhlenbeck(9.0)), (Static(), MaternMotion(9.0)))
    )
    assert one == pytest.approx(2 * two, abs=2)
    assert one == pytest.approx(3 * three, abs=3)


def test_the_default_budget_carries_six_hundred_coordinates():
    """Static field plus moving anomaly at the largest capacity that is worth it."""
    assert affordable(kernel(times=(Static(), OrnsteinUhlenbeck(9.0))), Budget()) >= MOST


@pytest.mark.parametrize("scale", [100.0, 150.0, 250.0])
def test_a_basis_of_that_size_explains_nearly_all_of_a_smooth_field(scale):
    """Chosen by pivoted Cholesky from a fine lattice: what it leaves unexplained anywhere is a few percent."""
    h = Hyperparameters(1.0, 0.01, (scale, scale))
    axis = np.linspace(0, 1000, 41)
    lattice = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    capacity = choose_capacity(h.kernel, AREA_M2, AMPLE)
    basis = lattice[select_basis(lattice, h.kernel, capacity, 0.0)]
    L = np.linalg.cholesky(h.kernel.covariance(basis, basis) + 1e-8 * np.eye(capacity))
    explained = np.square(np.linalg.solve(L, h.kernel.covariance(basis, lattice))).sum(axis=0)
    print(f"l = {scale:.0f} m: {capacity} basis vectors, unexplained at most {1 - explained.min():.4f}")
    assert 1 - explained.min() < 0.05


@pytest.mark.parametrize("area_m2", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_area_is_refused(area_m2):
    with pytest.raises(ValueError, match="area_m2"):
        choose_capacity(kernel(), area_m2, AMPLE)


@pytest.mark.parametrize("numbers", [(0.0, 1.0), (1.0, -1.0), (math.nan, 1.0), (1.0, math.inf)])
def test_an_impossible_budget_is_refused(numbers):
    with pytest.raises(ValueError, match="positive"):
        Budget(*numbers)


def test_a_budget_travels_by_pickle():
    assert pickle.loads(pickle.dumps(Budget(3.0, 900.0))) == Budget(3.0, 900.0)


def test_the_candidates_of_the_configuration_are_the_structures_there_are():
    assert get_args(Candidate) == tuple(STRUCTURES)
    for name, structure in STRUCTURES.items():
        told = EstimationSection.model_validate({"candidates": [name]})
        if structure.moves:
            with pytest.raises(ValueError, match="tells no times"):
                EstimationSection(data="basis", candidates=told.candidates)
        else:
            EstimationSection(data="basis", candidates=told.candidates)
