"""Properties of information and of the two selections, over random covariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.planning.information import mutual_information
from autonomy.planning.selection import select_by_dynamic_programming, select_greedily


@st.composite
def covariances(draw, largest=14):
    """Measurements of a smooth field at random sites, duplicates among them, with little noise or much."""
    n = draw(st.integers(2, largest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sites = np.round(rng.random((n, 2)), draw(st.integers(1, 3)))
    squared = np.sum((sites[:, None] - sites[None]) ** 2, axis=-1)
    lengthscale = draw(st.sampled_from([0.01, 0.1, 0.4, 2.0]))
    noise = draw(st.sampled_from([1e-3, 0.1, 3.0]))
    scale = draw(st.sampled_from([1e-4, 1.0, 1e3]))
    return scale * (np.exp(-0.5 * squared / lengthscale**2) + noise * np.eye(n))


@settings(deadline=None, max_examples=150)
@given(covariances(), st.data())
def test_a_set_tells_of_the_rest_what_the_rest_tells_of_it(S, data):
    P = data.draw(st.lists(st.integers(0, len(S) - 1), unique=True, max_size=len(S)))
    R = [k for k in range(len(S)) if k not in P]
    information = mutual_information(S, P)
    assert information >= 0.0
    assert information == pytest.approx(mutual_information(S, R), abs=1e-8)
    if P and R:
        parts = [np.linalg.slogdet(S[np.ix_(part, part)])[1] for part in (P, R)]
        assert information == pytest.approx(0.5 * (sum(parts) - np.linalg.slogdet(S)[1]), abs=1e-8)


@settings(deadline=None, max_examples=100)
@given(covariances(), st.data())
def test_selections_are_sets_of_distinct_sites_whose_figures_are_true(S, data):
    n = data.draw(st.integers(1, len(S)))
    Lambda = np.linalg.inv(S)
    for select in (select_by_dynamic_programming, select_greedily):
        selection = select(S, n)
        sites = list(selection.sites)
        assert len(set(sites)) == n
        assert set(sites) <= set(range(len(S)))
        assert selection.mutual_information == pytest.approx(mutual_information(S, sites), abs=1e-10)
        assert selection.mutual_information <= selection.objective + 1e-9
    sites = list(select_by_dynamic_programming(S, n).sites)
    J = 0.5 * (np.linalg.slogdet(S[np.ix_(sites, sites)])[1] + np.log(np.diag(Lambda)[sites]).sum())
    assert select_by_dynamic_programming(S, n).objective == pytest.approx(J, abs=1e-8)


@settings(deadline=None, max_examples=60)
@given(covariances(), st.sampled_from([1e-3, 7.0, 1e4]), st.data())
def test_units_do_not_matter(S, factor, data):
    n = data.draw(st.integers(1, len(S)))
    a, b = select_by_dynamic_programming(S, n), select_by_dynamic_programming(S * factor, n)
    assert a.objective == pytest.approx(b.objective, abs=1e-7)


@settings(deadline=None, max_examples=60)
@given(covariances(largest=9))
def test_two_spots_are_the_best_pair_of_the_programmes_own_sum(S):
    half_log_precision = 0.5 * np.log(np.diag(np.linalg.inv(S)))
    best = -np.inf
    for a in range(len(S)):
        for b in range(a):
            joint = 0.5 * np.linalg.slogdet(S[np.ix_([a, b], [a, b])])[1]
            best = max(best, joint + half_log_precision[a] + half_log_precision[b])
    assert select_by_dynamic_programming(S, 2).objective == pytest.approx(best, abs=1e-8)
