"""The plain work that parts are held against, and what it works on."""

import numpy as np
from scipy.linalg.blas import dgemm, dgemv, dger
from scipy.linalg.lapack import dpotrf
from waters import full

from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.likelihood import Readings
from autonomy.learning.spatial import SquaredExponential

KERNEL = Kernel((Component(1.0, SquaredExponential((40.0, 40.0))),), 0.01)
H = Hyperparameters(1.0, 0.01, (40.0, 40.0))
SPAN_M = 391.0


def passes(m):
    """What no update can do without: a product with the state, and a change of rank one to it."""
    S, a = np.asfortranarray(np.eye(m)), np.full(m, 1e-6)
    return lambda: dger(-1.0, a, dgemv(1.0, S, a), a=S, overwrite_a=1)


def product(m, cells):
    """One matrix product of (m, m) and (m, cells): what the variance of a map can't do without."""
    rng = np.random.default_rng(2)
    A, B = rng.normal(size=(m, m)), np.asfortranarray(rng.normal(size=(m, cells)))
    C = np.zeros_like(B, order="F")
    return lambda: dgemm(1.0, A, B, beta=0.0, c=C, overwrite_c=1)


def cholesky(n):
    """The factor of a covariance of n readings."""
    x = np.random.default_rng(3).uniform(0, SPAN_M, (n, 2))
    K = np.asfortranarray(H.kernel.covariance(x, x) + 0.01 * np.eye(n))
    return lambda: dpotrf(K, lower=1)


def readings(n):
    """A draw of n readings from the prior, with noise."""
    rng = np.random.default_rng(3)
    x = rng.uniform(0, SPAN_M, (n, 2))
    root = np.linalg.cholesky(H.kernel.covariance(x, x) + 1e-8 * np.eye(n))
    y = root @ rng.normal(size=n) + 0.1 * rng.normal(size=n)
    return Readings.of(x, y, None, 10.0 * np.arange(n), "gls")


def projecting(m):
    """A reading that a full basis explains: it is learned, and no basis vector comes or goes."""
    gp = full(KERNEL, m, 20.0 * m)
    return lambda: gp.project((50.0, 60.0), 0.1)
