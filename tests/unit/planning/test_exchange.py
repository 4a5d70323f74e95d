"""Exchange refinement, against the best of all sets."""

from itertools import combinations

import numpy as np
import pytest

from autonomy.planning.exchange import select_by_exchange
from autonomy.planning.information import mutual_information
from autonomy.planning.selection import select_by_dynamic_programming, select_greedily


def covariance(sites, lengthscale, noise):
    squared = np.sum((sites[:, None] - sites[None]) ** 2, axis=-1)
    return np.exp(-0.5 * squared / lengthscale**2) + noise * np.eye(len(sites))


def lattice(side):
    axis = np.arange(float(side))
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def small_case(seed):
    """Nine to fourteen sites scattered or on a lattice, a smooth field or a rough one, partly known or not at all."""
    rng = np.random.default_rng(seed)
    N = int(rng.integers(9, 15))
    sites = 3.0 * rng.random((N, 2)) if rng.random() < 0.5 else rng.permutation(lattice(4))[:N]
    S = covariance(sites, rng.uniform(0.5, 2.0), 10.0 ** rng.uniform(-2.5, -0.5))
    if rng.random() < 0.5:
        known = covariance(np.concatenate([sites, 3.0 * rng.random((3, 2))]), 1.0, 0.05)
        S = known[:N, :N] - known[:N, N:] @ np.linalg.solve(known[N:, N:], known[N:, :N])
    return S, int(rng.integers(2, 6))


def optimum(S, n):
    Lambda = np.linalg.inv(S)
    P = np.array(list(combinations(range(len(S)), n)))
    rows, columns = P[:, :, None], P[:, None, :]
    determinants = [np.linalg.slogdet(matrix[rows, columns])[1] for matrix in (S, Lambda)]
    return 0.5 * float(np.max(determinants[0] + determinants[1]))


def test_a_hundred_small_cases_come_within_a_five_hundredth_of_the_optimum():
    ratios = []
    for seed in range(100):
        S, n = small_case(seed)
        ratios.append(select_by_exchange(S, n, seed=seed).mutual_information / optimum(S, n))
    print(
        f"mean {np.mean(ratios):.5f}, worst {min(ratios):.4f}, optimal {np.mean(np.array(ratios) > 1 - 1e-9):.2f}"
    )
    assert max(ratios) <= 1.0 + 1e-9
    assert np.mean(ratios) >= 0.998
    assert min(ratios) >= 0.96


def test_no_swap_improves_what_is_returned():
    S = covariance(lattice(5), 1.3, 0.05)
    chosen = select_by_exchange(S, 6)
    for out in chosen.sites:
        for into in set(range(25)) - set(chosen.sites):
            swapped = [site for site in chosen.sites if site != out] + [into]
            assert mutual_information(S, swapped) <= chosen.mutual_information + 1e-9


def test_it_is_never_worse_than_what_it_began_from():
    S = covariance(lattice(6), 1.5, 0.05)
    programme, greedy = select_by_dynamic_programming(S, 8), select_greedily(S, 8)
    worst = list(range(8))
    for first in (programme.sites, greedy.sites, worst):
        chosen = select_by_exchange(S, 8, first=[first])
        for least in (greedy.mutual_information, mutual_information(S, first)):
            assert chosen.mutual_information >= least - 1e-9


def test_a_given_choice_that_is_as_good_as_any_is_kept():
    """On an empty lattice every set has mirror images that are worth the same."""
    S = covariance(lattice(4), 1.0, 0.05)
    best = select_by_exchange(S, 3)
    mirrored = [4 * (site // 4) + 3 - site % 4 for site in best.sites]
    assert sorted(mirrored) != list(best.sites)
    assert set(select_by_exchange(S, 3, first=[mirrored]).sites) == set(mirrored)


def test_the_figures_are_those_of_their_definitions():
    S, noise = covariance(lattice(4), 1.2, 0.07), 0.07
    for chosen in (
        select_by_exchange(S, 4, noise_variance=noise),
        select_greedily(S, 4, noise_variance=noise),
        select_by_dynamic_programming(S, 4, noise_variance=noise),
    ):
        P = list(chosen.sites)
        field = S - noise * np.eye(16)
        after = field - field[:, P] @ np.linalg.inv(S[np.ix_(P, P)]) @ field[P]
        assert chosen.variance_drop == pytest.approx(np.mean(np.diag(field) - np.diag(after)), abs=1e-12)
        # The information of readings about the field: log of the ratio of the volumes before and after them.
        field_P = field[np.ix_(P, P)]
        told = 0.5 * np.linalg.slogdet(np.eye(4) + field_P / noise)[1]
        assert chosen.field_information == pytest.approx(told, abs=1e-10)
        assert chosen.mutual_information == pytest.approx(mutual_information(S, P), abs=1e-10)


def test_the_fields_information_does_not_depend_on_the_lattice_but_mutual_information_does():
    coarse, sites = lattice(4), [0, 5, 10]
    fine = np.concatenate([coarse, coarse + 0.5])
    few = select_by_exchange(covariance(coarse, 1.2, 0.05), 3, first=[sites], noise_variance=0.05)
    S = covariance(fine, 1.2, 0.05)
    P = np.ix_(few.sites, few.sites)
    assert few.field_information == pytest.approx(0.5 * np.linalg.slogdet(S[P] / 0.05)[1], abs=1e-10)
    assert mutual_information(S, few.sites) > few.mutual_information + 0.1


def test_all_sites_one_site_and_equal_sites():
    S = covariance(lattice(3), 1.0, 0.1)
    assert select_by_exchange(S, 9).sites == tuple(range(9))
    assert select_by_exchange(S, 9).mutual_information == 0.0
    assert select_by_exchange(S, 1).sites == (4,)
    independent = select_by_exchange(np.eye(6), 3)
    assert independent.mutual_information == pytest.approx(0.0, abs=1e-12)
    assert select_by_exchange(np.ones((1, 1)), 1).sites == (0,)


def test_mistakes_are_told():
    S = covariance(lattice(3), 1.0, 0.1)
    with pytest.raises(ValueError, match="number of sites must be 1 … 9"):
        select_by_exchange(S, 10)
    for first in ([0, 0], [0, 9], [-1]):
        with pytest.raises(ValueError, match="first choices must be distinct sites in 0 … 8"):
            select_by_exchange(S, 2, first=[first])


def test_the_same_seed_gives_the_same_sites():
    S = covariance(np.random.default_rng(3).random((60, 2)), 0.2, 0.05)
    assert select_by_exchange(S, 9, seed=5) == select_by_exchange(S, 9, seed=5)
