"""Mutual information of a set of sites with the rest of the sea."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotri

from autonomy.geometry import FloatArray

if TYPE_CHECKING:
    from autonomy.learning.field_model import FieldModel


def measurement_covariance(model: "FieldModel", sites_m: ArrayLike) -> FloatArray:
    """Posterior covariance S of noisy measurements at the sites, given everything the model has learnt.

    The noise variance enters here, once: the model's own covariance is that of the field without noise.

    Args:
        model: the frozen posterior.
        sites_m: shape (N, 2), local metres.

    Returns:
        Symmetric array of shape (N, N), in the sensor's units squared.
    """
    latent = np.asarray(model.covariance(np.asarray(sites_m, dtype=float)), dtype=float)
    S = 0.5 * (latent + latent.T)
    S[np.diag_indices_from(S)] += model.kernel.noise_variance
    return np.asarray(S)


def mutual_information(S: ArrayLike, sites: Iterable[int]) -> float:
    """True mutual information I(P) of the measurements at P with those everywhere else, in nats.

    I(Z_P; Z_{X∖P}) = ½(log|S_PP| + log|Λ_PP|) with Λ = S⁻¹, which is the paper's H(Z_P) − H(Z_P | Z_{X∖P}),
    since the covariance of P given the rest is the inverse of Λ_PP.

    Args:
        S: shape (N, N), covariance of the measurements over all sites X, noise included.
        sites: indices of P, each once.

    Raises:
        ValueError: S is no covariance matrix, or the sites are not distinct indices into it.
    """
    covariance, factor = factorise(S)
    chosen = np.array(list(sites), dtype=int)
    if chosen.ndim != 1 or len(np.unique(chosen)) != len(chosen):
        raise ValueError(f"sites must be distinct indices, not {chosen.tolist()}")
    if len(chosen) and not (chosen.min() >= 0 and chosen.max() < len(covariance)):
        raise ValueError(f"sites must lie in 0 … {len(covariance) - 1}, not {chosen.tolist()}")
    if len(chosen) in (0, len(covariance)):
        return 0.0
    # With S = L Lᵀ and W = L⁻¹ E_P, Λ_PP = Wᵀ W.
    W = solve_triangular(factor, np.eye(len(covariance))[:, chosen], lower=True)
    information = 0.5 * (log_determinant(covariance[np.ix_(chosen, chosen)]) + log_determinant(W.T @ W))
    return max(0.0, information)


def precision(S: ArrayLike) -> FloatArray:
    """Λ = S⁻¹, symmetric, in float64.

    Raises:
        ValueError: S is no covariance matrix.
    """
    _, factor = factorise(S)
    # A third of the work of solving for the identity; only the lower triangle is filled in.
    lower, _ = dpotri(factor, lower=1)
    inverse: FloatArray = np.tril(lower)
    inverse += np.tril(lower, -1).T
    return inverse


def factorise(S: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """S in float64 and its lower Cholesky factor.

    Raises:
        ValueError: S is not square, finite, symmetric and positive definite.
    """
    covariance = np.asarray(S, dtype=np.float64)
    if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1] or not covariance.size:
        raise ValueError(f"S must be a square matrix, not of shape {covariance.shape}")
    if not np.all(np.isfinite(covariance)):
        raise ValueError("S must be finite")
    if not np.allclose(covariance, covariance.T, rtol=0.0, atol=1e-9 * np.abs(covariance).max()):
        raise ValueError("S must be symmetric")
    try:
        return covariance, np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "S must be positive definite: it is the covariance of measurements, noise variance included once"
        ) from error


def log_determinant(matrix: FloatArray) -> float:
    """log|matrix| of a symmetric positive definite matrix; LinAlgError if it is none."""
    return 2.0 * float(np.sum(np.log(np.diag(np.linalg.cholesky(matrix)))))
