"""The state in a snapshot, every number of it or in few bits, as plain CBOR values and back.

What is read may come from anybody: everything here that reads raises SnapshotError, and nothing else.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from autonomy.learning.agreement import StatedError, difference
from autonomy.learning.basis import prior_factors
from autonomy.learning.field_model import FieldModel, field_coordinates
from autonomy.learning.invariants import broken
from autonomy.learning.numbers import FloatArray
from autonomy.learning.packing import PackingError, pack, pack_fixed, unpack, unpack_fixed, width_of
from autonomy.learning.quantised import Bits, Quantised, quantised, root_step
from autonomy.learning.snapshot_parts import (
    Document,
    SnapshotError,
    array,
    from_triangle,
    list_of,
    triangle,
    typed,
)

# How far L Lᵀ may be from what it factors, in jitters and in σ²: beyond, variances could become negative.
_FACTOR_SLACK = (0.5, 1e-12)


def lossless_parts(model: FieldModel) -> Document:
    """Factors, μ and S as they are."""
    return {
        "factors": [triangle(factor) for factor in model.factors],
        "mean": typed(model.whitened_mean),
        "covariance": triangle(model.whitened_covariance),
    }


def lossless_from(document: Document, blank: FieldModel) -> FieldModel:
    """`blank` with what has been learnt. Raises SnapshotError if that is no posterior."""
    size, m = len(blank.whitened_mean), len(blank)
    mean = array(document.get("mean"), "mean", size)
    covariance = from_triangle(document.get("covariance"), "covariance", size)
    covariance += np.tril(covariance, -1).T
    fault = broken(np.asfortranarray(np.vstack([covariance, mean])))
    if fault is not None:
        raise SnapshotError(f"covariance: {fault}")
    given = document.get("factors")
    if not isinstance(given, list) or len(given) != len(blank.factors):
        raise SnapshotError(f"factors: a list of {len(blank.factors)} was expected")
    factors = []
    for g, (value, fresh, group) in enumerate(zip(given, blank.factors, blank.kernel.groups, strict=True)):
        factor = np.asfortranarray(from_triangle(value, f"factors[{g}]", m))
        apart = np.linalg.norm(factor @ factor.T - fresh @ fresh.T)
        if not apart <= max(_FACTOR_SLACK[0] * blank.jitter, _FACTOR_SLACK[1]) * group.variance:
            raise SnapshotError(f"factors[{g}]: it does not factor the covariance of the basis")
        factors.append(factor)
    return replace(blank, factors=tuple(factors), whitened_mean=mean, whitened_covariance=covariance)


def coarse_parts(model: FieldModel, small: FieldModel, bits: Bits) -> Document:
    """The nowcast of `small`, which stands for `model`."""
    factors = prior_factors(small.basis, small.kernel, small.jitter)
    state = quantised(*_whitened(small, factors), bits)
    error = difference(model, _nowcast(small, factors, *state.state()))
    width = width_of(state.mean)
    return {
        "thinned": small is not model,
        "mean": [state.mean_step, width, pack_fixed(state.mean, width)],
        "root": list(pack(state.root)),
        "error": [error.mean, error.sd],
    }


def coarse_from(document: Document, blank: FieldModel, bits: Bits) -> FieldModel:
    """`blank` with the nowcast; its factors are those that the state is whitened by."""
    state = _quantised(document, len(blank) * len(blank.kernel.groups), bits)
    return _nowcast(blank, blank.factors, *state.state())


def stated_from(document: Document) -> StatedError:
    """What the sender found to be wrong with the nowcast that it sent."""
    mean, sd = list_of(document, "error", (float, float))
    if not (0.0 <= mean <= 1e9 and 0.0 <= sd <= 1e9):
        raise SnapshotError(f"error: {mean!r} and {sd!r} are no shares of the field's deviation")
    return StatedError(mean, sd)


def _whitened(model: FieldModel, factors: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray]:
    """μ and S of the field, with respect to the `factors` that the other end will compute from the basis."""
    m, field = len(model), field_coordinates(model.kernel, len(model))
    mean = model.whitened_mean[field]
    covariance = model.whitened_covariance[np.ix_(field, field)]
    if m:
        for g, fresh in enumerate(factors):
            block = slice(g * m, (g + 1) * m)
            change = solve_triangular(fresh, model.factors[g], lower=True)
            mean[block] = change @ mean[block]
            covariance[block] = change @ covariance[block]
            covariance[:, block] = covariance[:, block] @ change.T
    return mean, covariance


def _nowcast(
    like: FieldModel, factors: tuple[FloatArray, ...], mean: FloatArray, covariance: FloatArray
) -> FieldModel:
    """The model with μ (n,) and S (n, n) of the field, the rates of change as the prior has them."""
    field, size = field_coordinates(like.kernel, len(like.basis)), len(like.basis) * like.kernel.states
    whole_mean, whole = np.zeros(size), np.eye(size)
    whole_mean[field] = mean
    whole[np.ix_(field, field)] = covariance
    return FieldModel(
        like.kernel, like.prior_mean, like.jitter, like.basis, factors, whole_mean, whole, like.transform
    )


def _quantised(document: Document, n: int, bits: Bits) -> Quantised:
    mean_step, width, mean = list_of(document, "mean", (float, int, bytes))
    lengths, root = list_of(document, "root", (bytes, bytes))
    if not 0.0 < mean_step <= 1e9:
        raise SnapshotError(f"mean: {mean_step!r} is no step")
    try:
        steps = unpack_fixed(mean, width, n)
    except PackingError as error:
        raise SnapshotError(f"mean: {error}") from None
    try:
        return Quantised(steps, mean_step, unpack(lengths, root, n * (n + 1) // 2), root_step(bits))
    except PackingError as error:
        raise SnapshotError(f"root: {error}") from None
