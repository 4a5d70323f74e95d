"""The whitened posterior that the filter carries: factors of the prior, and the state they whiten.

For each group g of components f_g(B) = L_g z_{g,0} with L_g L_gᵀ = K_g,BB + jitter·σ_g²·I, and z ~ N(μ, S).
The prior of z is standard normal and S stays between 0 and I. Layout: see `arithmetic`.
"""

from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from autonomy.learning import arithmetic, motion
from autonomy.learning.basis import prior_factors
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Kernel
from autonomy.learning.members import Members
from autonomy.learning.numbers import FloatArray

# Readings that `absorb` takes in at once: enough for matrix products to pay.
_BATCH = 128
# What follows from the rest, and travels in no pickle.
_DERIVED = ("_other", "_a", "_parts", "_shares")


class WhitenedState:
    """S and μ with the factors L_g, and diag Q_g = diag (L_g L_gᵀ)⁻¹ kept from step to step."""

    def __init__(self, kernel: Kernel, jitter: float) -> None:
        self._kernel, self._jitter = kernel, jitter
        self._groups = kernel.groups
        self._matrix: FloatArray
        self._other: FloatArray
        self._blocks = tuple(g for g, group in enumerate(self._groups) for _ in range(group.time.states))
        self._fields = tuple(self._blocks.index(g) for g in range(len(self._groups)))
        self._variances = tuple(group.variance for group in self._groups)
        self._removals = 0
        self._reset(0)
        self._factors = [np.ones((1, 1), order="F") for _ in self._groups]
        self._precisions = [np.zeros(1) for _ in self._groups]

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _DERIVED}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._borrow()

    def __len__(self) -> int:
        return self._n - 1

    @property
    def matrix(self) -> FloatArray:
        """S and below it μ (D + 1, D), spare coordinates included, in place."""
        return self._matrix

    @property
    def diagonal(self) -> FloatArray:
        """diag S (D,), spare coordinates included, in place."""
        result: FloatArray = self._matrix.ravel(order="K")[:: self._matrix.shape[1] + 2]
        return result

    def start(self, points: FloatArray) -> None:
        """Begin with basis vectors at `points` (m, d), of which nothing is known yet. Raises LinAlgError."""
        n = len(points) + 1
        factors = prior_factors(points, self._kernel, self._jitter)
        self._reset(len(points))
        self._factors = [np.asfortranarray(np.eye(n)) for _ in factors]
        for mine, factor in zip(self._factors, factors, strict=True):
            mine[:-1, :-1] = factor
        self._refresh_precisions()

    def advance(self, dt_s: float) -> None:
        """Let time pass; see `motion.advance`."""
        motion.advance(self._matrix, self._groups, dt_s)

    def whiten(self, members: Members, point: FloatArray) -> tuple[FloatArray, list[float]]:
        """a (D,), borrowed until the next call, and of each group γ_g, what the basis leaves unexplained.

        a holds a_g = L_g⁻¹k_g(B, x) where the field of group g is, 0 elsewhere. γ_g = σ_g²(1 + jitter) −
        |a_g|²: the jitter is part of a basis vector's prior variance, and with it here too a reduced update
        is exactly what adding and deleting would have been.
        """
        gammas = []
        members.covariances(point, self._parts)
        for part, factor, variance in zip(self._parts, self._factors, self._variances, strict=True):
            part[-1] = 0.0
            arithmetic.whiten(factor, part)
            gammas.append(max(variance - arithmetic.product(part, part), 0.0) + self._jitter * variance)
        return self._a, gammas

    def take_spare(self, gammas: list[float], p: FloatArray) -> None:
        """Make the place of the last `whiten` the last basis vector; `p` (D + 1,) gets its covariances."""
        self._shares.clear()
        for g, (part, gamma) in enumerate(zip(self._parts, gammas, strict=True)):
            share = part.copy()
            arithmetic.unwhiten(self._factors[g], share)
            share *= share
            share *= 1.0 / gamma
            share[-1] = 1.0 / gamma
            self._precisions[g] += share
            self._shares.append(share)
            arithmetic.take_spare(self._factors[g], part, gamma)
            p[(self._fields[g] + 1) * self._n - 1] = part[-1] = gamma**0.5

    def give_spare_back(self) -> None:
        """Marginalise out what `take_spare` has just made a basis vector."""
        for precision, share in zip(self._precisions, self._shares, strict=True):
            precision -= share
            precision[-1] = 0.0
        arithmetic.free_spare(self._matrix, self._factors)

    def scores(self, count: int) -> FloatArray:
        """How much the nowcast's mean at each of the first `count` basis vectors changes if it is deleted.

        |Σ_g alpha_{g,i} / Q_{g,ii}| (Csató & Opper 2002, for one group).
        """
        changes = []
        for factor, precision, field in zip(self._factors, self._precisions, self._fields, strict=True):
            alpha = self._matrix[-1, field * self._n : (field + 1) * self._n].copy()
            arithmetic.unwhiten(factor, alpha)
            changes.append(alpha[:count] / precision[:count])
        return np.abs(changes[0] if len(changes) == 1 else np.sum(changes, axis=0))

    def remove(self, index: int) -> None:
        """Marginalise a basis vector out; the last coordinate of every block is spare then."""
        for factor, precision, variance in zip(self._factors, self._precisions, self._variances, strict=True):
            arithmetic.drop_precision(factor, precision, index, 1.0 / (variance * (1.0 + self._jitter)))
        arithmetic.remove(self._matrix, self._other, self._factors, self._blocks, index)
        self._matrix, self._other = self._other, self._matrix
        self._removals += 1
        if self._removals % self._n == 0:
            # Against the slow drift of running differences; once in m removals this is still O(m²) each.
            self._refresh_precisions()
            S = self._matrix[:-1]
            S[...] = 0.5 * (S + S.T)

    def resize(self, change: int) -> None:
        """Give every block one coordinate more (a new spare one) or less (one of two spare ones)."""
        old, n = self._matrix, self._n
        kept = (np.arange(len(self._blocks))[:, None] * n + np.arange(min(n, n + change))).ravel()
        self._reset(n - 1 + change)
        new = (np.arange(len(self._blocks))[:, None] * self._n + np.arange(min(n, n + change))).ravel()
        self._matrix[np.ix_(new, new)] = old[np.ix_(kept, kept)]
        self._matrix[-1, new] = old[-1, kept]
        size, least = self._n, min(n, self._n)
        for g, factor in enumerate(self._factors):
            self._factors[g] = np.asfortranarray(np.eye(size))
            self._factors[g][:least, :least] = factor[:least, :least]
            self._precisions[g] = np.append(self._precisions[g][:least], np.zeros(size - least))

    def absorb(self, members: Members, points: FloatArray, residuals: FloatArray, noise: FloatArray) -> None:
        """Condition on many readings of one moment: a block of reduced updates at a time, O(N D²)."""
        for start in range(0, len(points), _BATCH):
            part = slice(start, start + _BATCH)
            A, gamma = self._whiten_all(members, points[part])
            P = self._matrix @ A
            innovations = residuals[part] - P[-1]
            variance = A.T @ P[:-1]
            variance.ravel()[:: len(gamma) + 1] += noise[part] + gamma
            root = np.linalg.cholesky(0.5 * (variance + variance.T))
            W = solve_triangular(root, P[:-1].T, lower=True, check_finite=False)
            self._matrix[-1] += solve_triangular(root, innovations, lower=True, check_finite=False) @ W
            self._matrix[:-1] -= W.T @ W

    def model(self, members: Members, prior_mean: float) -> FieldModel:
        """A frozen copy."""
        n, m = self._n, self._n - 1
        blocks = [(b * n, b * m) for b in range(len(self._blocks))]
        # Block by block and in column order: a third of the time that picking entries would take.
        S, mean = np.empty((m * len(blocks),) * 2, order="F"), np.empty(m * len(blocks))
        for left, to in blocks:
            mean[to : to + m] = self._matrix[-1, left : left + m]
            for top, down in blocks:
                S[down : down + m, to : to + m] = self._matrix[top : top + m, left : left + m]
        symmetric = S.T.copy(order="F")
        symmetric += S
        symmetric *= 0.5
        return FieldModel(
            self._kernel,
            prior_mean,
            self._jitter,
            members.points,
            tuple(factor[:-1, :-1].copy(order="F") for factor in self._factors),
            mean,
            symmetric,
        )

    def _whiten_all(self, members: Members, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """a (D, N) and Σγ_g (N,) for many places."""
        n = self._n
        A = np.zeros((self._matrix.shape[1], len(points)))
        gamma = np.zeros(len(points))
        for g, (group, field) in enumerate(zip(self._groups, self._fields, strict=True)):
            k = group.covariance(members.points, points)
            a = solve_triangular(self._factors[g][:-1, :-1], k, lower=True, check_finite=False)
            gamma += np.maximum(group.variance - np.einsum("ij,ij->j", a, a), 0.0)
            gamma += self._jitter * group.variance
            A[field * n : (field + 1) * n - 1] = a
        return A, gamma

    def _refresh_precisions(self) -> None:
        self._precisions = [arithmetic.precision_diagonal(factor) for factor in self._factors]
        for precision in self._precisions:
            precision[-1] = 0.0

    def _reset(self, count: int) -> None:
        """The prior of the state for `count` basis vectors."""
        self._n = count + 1
        size = self._n * len(self._blocks)
        self._matrix = np.zeros((size + 1, size), order="F")
        self.diagonal[...] = 1.0
        self._borrow()

    def _borrow(self) -> None:
        """Memory to work in."""
        self._other = np.zeros_like(self._matrix, order="F")
        self._a = np.zeros(self._matrix.shape[1])
        self._shares: list[FloatArray] = []
        self._parts = [self._a[field * self._n : (field + 1) * self._n] for field in self._fields]
