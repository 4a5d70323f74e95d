"""Choosing sampling spots: the paper's dynamic programme, and a greedy choice."""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import index

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.geometry import FloatArray
from autonomy.planning.information import mutual_information, precision

_TIE_NATS = 1e-11
"""Values this close are equal: round-off must not decide between sites that symmetry makes equal."""


@dataclass(frozen=True)
class Selection:
    """Chosen sites, in the order in which the method took them; iterating over it gives the sites.

    Attributes:
        sites: distinct indices into the candidate sites.
        objective: the sum that the method maximised, in nats. The dynamic programme's is an upper bound of
            the mutual information; greedy's is the mutual information itself.
        mutual_information: true I(P) of the sites, in nats: the figure to report.
    """

    sites: tuple[int, ...]
    objective: float
    mutual_information: float

    def __iter__(self) -> Iterator[int]:
        return iter(self.sites)

    def __len__(self) -> int:
        return len(self.sites)


def select_by_dynamic_programming(S: ArrayLike, n: int) -> Selection:
    """The paper's dynamic programme over sequences of n distinct sites (Ma, Liu & Sukhatme 2017, sec. III-C).

    V_1(x) = I(Z_x; Z_rest); V_i(x) = max over the predecessor p of V_{i−1}(p) + I(Z_x; Z_rest | Z_path(p)),
    where path(p) is the best path that ends in p, and x is not on it. Every increment is
    ½ log(var(x | path)·Λ_xx), because H(Z_x | everything else) does not depend on the path. Ties go to the
    lowest index.

    The variances given every state's path are kept and downdated by rank one; states with the same
    predecessor share one solve. O(n²N²) time, O(N²) memory.

    Args:
        S: shape (N, N), posterior covariance of the measurements over the candidates, noise included.
        n: how many sites, 1 … N.

    Raises:
        ValueError: S is no covariance matrix, or n is out of range.
    """
    covariance, n = np.asarray(S, dtype=np.float64), index(n)
    Lambda = precision(covariance)
    _check_size(n, len(covariance))
    half_log_precision = 0.5 * np.log(np.diag(Lambda))
    states = _States.first(covariance, half_log_precision)
    for _ in range(1, n):
        states = states.extended(covariance, half_log_precision)
    last = _lowest_maximum(states.value[:, None])[0]
    sites = tuple(int(site) for site in states.paths[:, last])
    return Selection(sites, float(states.value[last]), mutual_information(covariance, sites))


@dataclass(frozen=True, eq=False)
class _States:
    """Stage i of the dynamic programme, one state for every last site.

    Attributes:
        value: shape (N,), V_i; −inf where no path of i distinct sites ends in the site (a dead state).
        paths: shape (i, N), column x is the best path that ends in x; what back-tracing would give.
        variance: shape (N, N), row x: var(· | path of x).
        visited: shape (N, N), row x: which sites are on the path of x.
    """

    value: FloatArray
    paths: NDArray[np.intp]
    variance: FloatArray
    visited: NDArray[np.bool_]

    @classmethod
    def first(cls, S: FloatArray, half_log_precision: FloatArray) -> "_States":
        diagonal = np.diag(S)
        variance = diagonal[None, :] - S**2 / diagonal[:, None]
        paths = np.arange(len(S))[None, :]
        return cls(0.5 * np.log(diagonal) + half_log_precision, paths, variance, np.eye(len(S), dtype=bool))

    def extended(self, S: FloatArray, half_log_precision: FloatArray) -> "_States":
        """The next stage."""
        sites = np.arange(len(S))
        with np.errstate(divide="ignore", invalid="ignore"):
            increment = 0.5 * np.log(self.variance) + half_log_precision
        # A visited site's variance is round-off about 0 and its logarithm anything: it is never a successor.
        score = np.where(self.visited, -np.inf, self.value[:, None] + increment)
        predecessor = _lowest_maximum(score)
        value = score[predecessor, sites]
        variance = self.variance[predecessor]
        for p in np.unique(predecessor[np.isfinite(value)]):
            group = np.flatnonzero((predecessor == p) & np.isfinite(value))
            path = self.paths[:, p]
            given = np.linalg.solve(S[np.ix_(path, path)], S[np.ix_(path, group)])
            cross = S[group] - given.T @ S[path]
            variance[group] -= cross**2 / self.variance[p, group][:, None]
        visited = self.visited[predecessor]
        visited[sites, sites] = True
        paths = np.concatenate([self.paths[:, predecessor], sites[None, :]])
        return _States(value, paths, variance, visited)


def select_greedily(S: ArrayLike, n: int) -> Selection:
    """Take the site that raises the true mutual information most, n times (Krause et al. 2008).

    The gain of x is ½(log var(x | P) + log var_Λ(x | P)), with Schur complements of S and of Λ. It may be
    negative: mutual information is not monotone. Ties go to the lowest index. O(n²N) time after the inverse.

    Args:
        S: shape (N, N), posterior covariance of the measurements over the candidates, noise included.
        n: how many sites, 1 … N.

    Raises:
        ValueError: S is no covariance matrix, or n is out of range.
    """
    covariance, n = np.asarray(S, dtype=np.float64), index(n)
    sides = (_Conditioned(covariance, n), _Conditioned(precision(covariance), n))
    _check_size(n, len(covariance))
    free = np.ones(len(covariance), dtype=bool)
    sites: list[int] = []
    for _ in range(n):
        gain = np.full(len(covariance), -np.inf)
        gain[free] = 0.5 * sum(np.log(side.variance[free]) for side in sides)
        site = int(_lowest_maximum(gain[:, None])[0])
        for side in sides:
            side.condition_on(site)
        free[site] = False
        sites.append(site)
    information = mutual_information(covariance, sites)
    return Selection(tuple(sites), information, information)


class _Conditioned:
    """The diagonal of a positive definite matrix conditioned on a growing set of indices."""

    def __init__(self, matrix: FloatArray, capacity: int) -> None:
        self._matrix = matrix
        self._rows = np.empty((max(0, capacity), len(matrix)))
        self._count = 0
        self.variance = np.diag(matrix).copy()

    def condition_on(self, site: int) -> None:
        rows = self._rows[: self._count]
        row = (self._matrix[site] - rows[:, site] @ rows) / np.sqrt(self.variance[site])
        self._rows[self._count] = row
        self._count += 1
        self.variance = self.variance - row**2


def _check_size(n: int, available: int) -> None:
    if not 1 <= n <= available:
        raise ValueError(f"the number of sites must be 1 … {available}, the number of candidates, not {n}")


def _lowest_maximum(score: FloatArray) -> NDArray[np.intp]:
    """Per column the lowest row whose score is the maximum, up to `_TIE_NATS`."""
    best = score.max(axis=0)
    # In a column of −inf alone every row ties: −inf ≥ −inf − tie.
    chosen: NDArray[np.intp] = np.argmax(score >= best - _TIE_NATS, axis=0)
    return chosen
