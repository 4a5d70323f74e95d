"""The dynamic programme against a literal one made of determinants, and greedy against literal gains."""

import numpy as np
import pytest

from autonomy.planning.information import mutual_information
from autonomy.planning.selection import select_by_dynamic_programming, select_greedily


def field_covariance(rng, n, lengthscale=0.3, noise=0.1):
    """Measurements at irregular sites: no symmetry, hence no ties."""
    sites = rng.random((n, 2))
    squared = np.sum((sites[:, None] - sites[None]) ** 2, axis=-1)
    signal = 1.0 + rng.random(n)
    return np.sqrt(signal[:, None] * signal[None]) * np.exp(-0.5 * squared / lengthscale**2) + noise * np.eye(
        n
    )


def lattice_covariance(n_side, lengthscale, noise=0.1):
    axis = np.arange(float(n_side))
    sites = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    squared = np.sum((sites[:, None] - sites[None]) ** 2, axis=-1)
    return np.exp(-0.5 * squared / lengthscale**2) + noise * np.eye(n_side**2)


def entropy(S, sites):
    """H(Z_A) by the determinant of the paper's equation."""
    sites = list(sites)
    if not sites:
        return 0.0
    return 0.5 * np.log(np.linalg.det(2 * np.pi * np.e * S[np.ix_(sites, sites)]))


def literal_increment(S, x, path):
    """I(Z_x; Z_rest | Z_path) = H(x | path) − H(x | path, rest), from joint entropies."""
    rest = [k for k in range(len(S)) if k != x and k not in path]
    given_path = entropy(S, [x, *path]) - entropy(S, path)
    given_all = entropy(S, [x, *path, *rest]) - entropy(S, [*path, *rest])
    return given_path - given_all


def literal_programme(S, n):
    """The recursion as printed, one determinant after the other; the best path and its value."""
    paths = {x: ((x,), literal_increment(S, x, ())) for x in range(len(S))}
    for _ in range(1, n):
        longer = {}
        for x in range(len(S)):
            ways = [
                (value + literal_increment(S, x, path), path)
                for path, value in paths.values()
                if x not in path
            ]
            if ways:
                # Ties go to the first. Which path survives a tie decides what can follow it, hence the value.
                best = max(value for value, _ in ways)
                value, path = next(way for way in ways if way[0] >= best - 1e-11)
                longer[x] = ((*path, x), value)
        paths = longer
    best = max(value for _, value in paths.values())
    return next(state for state in paths.values() if state[1] >= best - 1e-11)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 9])
@pytest.mark.parametrize("seed", range(4))
def test_values_equal_the_literal_programme(seed, n):
    S = field_covariance(np.random.default_rng(seed), 9)
    path, value = literal_programme(S, n)
    selection = select_by_dynamic_programming(S, n)
    assert selection.objective == pytest.approx(value, abs=1e-9)
    assert set(selection.sites) == set(path)


@pytest.mark.parametrize("lengthscale", [0.05, 0.3, 3.0])
def test_values_equal_the_literal_programme_from_nearly_independent_to_nearly_equal_sites(lengthscale):
    S = field_covariance(np.random.default_rng(3), 16, lengthscale, noise=0.02)
    path, value = literal_programme(S, 4)
    selection = select_by_dynamic_programming(S, 4)
    assert selection.objective == pytest.approx(value, abs=1e-9)
    assert set(selection.sites) == set(path)


@pytest.mark.parametrize(("side", "lengthscale", "n"), [(3, 1.0, 6), (4, 1.5, 4), (4, 0.7, 5)])
def test_on_a_lattice_full_of_ties_the_sequence_itself_is_the_literal_one(side, lengthscale, n):
    S = lattice_covariance(side, lengthscale)
    path, value = literal_programme(S, n)
    selection = select_by_dynamic_programming(S, n)
    assert selection.sites == path
    assert selection.objective == pytest.approx(value, abs=1e-9)


def test_the_objective_is_the_sum_over_the_path_and_an_upper_bound_of_the_information():
    S = lattice_covariance(6, 1.5)
    selection = select_by_dynamic_programming(S, 8)
    sites = list(selection.sites)
    Lambda = np.linalg.inv(S)
    J = 0.5 * (np.linalg.slogdet(S[np.ix_(sites, sites)])[1] + np.log(np.diag(Lambda)[sites]).sum())
    assert selection.objective == pytest.approx(J, abs=1e-9)
    assert selection.mutual_information == pytest.approx(mutual_information(S, sites), abs=1e-12)
    assert selection.mutual_information <= selection.objective


def test_a_single_spot_is_the_most_informative_site():
    S = field_covariance(np.random.default_rng(8), 20)
    every = [mutual_information(S, [x]) for x in range(20)]
    for select in (select_by_dynamic_programming, select_greedily):
        assert select(S, 1).sites == (int(np.argmax(every)),)
        assert select(S, 1).mutual_information == pytest.approx(max(every), abs=1e-10)


@pytest.mark.parametrize("select", [select_by_dynamic_programming, select_greedily])
def test_ties_go_to_the_lowest_index(select):
    """Sites too far apart to know of each other: the first plan under lengths of a map cell."""
    assert sorted(select(2.5 * np.eye(30), 7).sites) == list(range(7))


@pytest.mark.parametrize("select", [select_by_dynamic_programming, select_greedily])
def test_round_off_does_not_break_ties(select):
    S = lattice_covariance(5, 1.2)
    sites = select(S, 6).sites
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(size=S.shape) * 1e-15
        assert select(S + noise + noise.T, 6).sites == sites


@pytest.mark.parametrize("select", [select_by_dynamic_programming, select_greedily])
def test_all_sites_can_be_taken_and_then_tell_nothing_of_the_rest(select):
    selection = select(field_covariance(np.random.default_rng(2), 8), 8)
    assert sorted(selection.sites) == list(range(8))
    assert selection.mutual_information == 0.0


def test_dead_states_do_no_harm():
    """One site is on every good path early on: later it has no predecessor, which must not become NaN."""
    S = np.eye(4) + 0.02
    S[0] *= 3.0
    S[:, 0] *= 3.0
    selection = select_by_dynamic_programming(S, 3)
    assert 0 in selection.sites
    assert len(set(selection.sites)) == 3
    assert np.isfinite(selection.objective)
    assert selection.objective == pytest.approx(literal_programme(S, 3)[1], abs=1e-9)


def test_greedy_takes_the_best_next_site():
    S = field_covariance(np.random.default_rng(5), 15)
    taken = []
    for _ in range(6):
        gains = [-np.inf if x in taken else mutual_information(S, [*taken, x]) for x in range(15)]
        taken.append(int(np.argmax(gains)))
    selection = select_greedily(S, 6)
    assert selection.sites == tuple(taken)
    assert selection.objective == pytest.approx(mutual_information(S, taken), abs=1e-10)


def test_spots_spread_where_nothing_is_known_and_avoid_what_is():
    S = lattice_covariance(7, 1.0, noise=0.05)
    known = [8, 9, 15, 16]
    gain = S[:, known] @ np.linalg.solve(S[np.ix_(known, known)], S[known])
    selection = select_by_dynamic_programming(S - gain + 0.05 * np.eye(49), 5)
    assert not set(selection.sites) & set(known)


@pytest.mark.parametrize("select", [select_by_dynamic_programming, select_greedily])
@pytest.mark.parametrize(
    ("S", "n", "message"),
    [
        (np.eye(4), 0, r"1 … 4"),
        (np.eye(4), -1, r"1 … 4"),
        (np.eye(4), 5, r"1 … 4"),
        (np.ones((3, 3)), 2, "positive definite"),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), 1, "positive definite"),
        (np.array([[1.0, 0.5], [0.0, 1.0]]), 1, "symmetric"),
        (np.array([[1.0, np.nan], [np.nan, 1.0]]), 1, "finite"),
        (np.zeros((0, 0)), 1, "square"),
        (np.ones((2, 3)), 1, "square"),
    ],
)
def test_nonsense_is_refused(select, S, n, message):
    with pytest.raises(ValueError, match=message):
        select(S, n)


@pytest.mark.parametrize("sites", [[0, 0], [4], [-1]])
def test_information_of_impossible_sets_is_refused(sites):
    with pytest.raises(ValueError, match="sites must"):
        mutual_information(np.eye(4), sites)
