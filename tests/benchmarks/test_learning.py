"""Speed of the learner as ratios against BLAS on the same machine in the same minute."""

import timeit

import numpy as np
import pytest
from scipy.linalg.blas import dgemm, dgemv, dger
from scipy.linalg.lapack import dpotrf

from autonomy.learning.hyperparameters import loo_log_likelihood
from autonomy.learning.kernel import Hyperparameters, covariance
from autonomy.learning.sparse_gp import SparseOnlineGP, Update

M = 100
H = Hyperparameters(1.0, 0.01, (40.0, 40.0))


def seconds(function, number, repeat=7):
    """The best of several runs: what the work takes when nobody else wants the core."""
    return min(timeit.repeat(function, number=number, repeat=repeat)) / number


@pytest.fixture
def report(capsys):
    def say(what, spent, reference, name):
        with capsys.disabled():
            ratio = spent / reference
            print(f"\n{what}: {spent * 1e6:.0f} µs = {ratio:.2f} × {name} ({reference * 1e6:.0f} µs)")

    return say


def full_model(extent=391.0):
    rng = np.random.default_rng(0)
    gp = SparseOnlineGP(H, M)
    while len(gp) < M:
        gp.update(rng.uniform(0, extent, 2), rng.normal())
    return gp


def rank_one():
    """The two passes over the state that no update can do without."""
    S, a = np.asfortranarray(np.eye(M)), np.full(M, 1e-6)

    def passes():
        dger(-1.0, a, dgemv(1.0, S, a), a=S, overwrite_a=1)

    return passes


def test_a_reduced_update(report):
    gp = full_model()
    report(
        "reduced update",
        seconds(lambda: gp.project((50.0, 60.0), 0.1), 500),
        seconds(rank_one(), 2000),
        "dgemv + dger",
    )


def test_an_update_that_replaces(report):
    gp, rng = full_model(2000.0), np.random.default_rng(1)
    spent = []
    for point in rng.uniform(0, 2000.0, (3000, 2)):
        value = rng.normal()
        began = timeit.default_timer()
        outcome = gp.update(point, value)
        took = timeit.default_timer() - began
        if outcome is Update.REPLACED:
            spent.append(took)
    report("replacing update", float(np.median(spent)), seconds(rank_one(), 2000), "dgemv + dger")


def test_a_map_of_351_by_391(report):
    gp = full_model()
    x, y = np.arange(351.0), np.arange(391.0)
    rng = np.random.default_rng(2)
    A, B = rng.normal(size=(M, M)), np.asfortranarray(rng.normal(size=(M, len(x) * len(y))))
    C = np.zeros_like(B, order="F")
    gemm = seconds(lambda: dgemm(1.0, A, B, beta=0.0, c=C, overwrite_c=1), 1, 5)
    report(
        "map, mean and variance", seconds(lambda: gp.predict_grid(x, y), 1, 5), gemm, "GEMM of the same flops"
    )


@pytest.mark.parametrize("n", [100, 300])
def test_leave_one_out_with_gradient(report, n):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 391, (n, 2)), rng.normal(size=n)
    K = np.asfortranarray(covariance(x, x, H) + 0.01 * np.eye(n))
    spent = seconds(lambda: loo_log_likelihood(x, y, H), 5)
    report(
        f"leave-one-out with gradient, n = {n}", spent, seconds(lambda: dpotrf(K, lower=1), 20), "Cholesky"
    )
