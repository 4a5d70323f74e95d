"""The nowcast of a large model as that of one field at fewer places: what a thin link carries."""

from dataclasses import replace

import numpy as np
from scipy.linalg import eigh, solve_triangular

from autonomy.learning.agreement import lattice
from autonomy.learning.basis import prior_factors
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Kernel
from autonomy.learning.numbers import FloatArray
from autonomy.learning.positions import coarsest_step_m, snapped
from autonomy.learning.temporal import Static

# A place of which the chosen leave no more than this share of σf² unexplained would teach rounding errors.
_LEAST = 1e-7
# Of σf: rounding to 8 bits costs as much.
_GOOD_ENOUGH = 5e-3


def thinned(model: FieldModel, most: int) -> FieldModel:
    """The marginal of the nowcast at no more than `most` places, between which the prior of the sum speaks.

    All that is believed now of f = Σ_g f_g at places Z is a Gaussian N(m(Z), C(Z, Z)): as the posterior of a
    single field with covariance k = Σ_g k_g it is a model again, of one group. It stands still: which part of the
    field moves, and how, it no longer knows. Of the basis and a lattice each next place is where the map is the
    most wrong without it, until that is nowhere more than 0.5 % of σf.

    A model that is as small already, and of one group, comes back as it is. ValueError for fewer than one place.
    """
    if most < 1:
        raise ValueError(f"a map needs at least one place, not {most!r}")
    if len(model) <= most and len(model.kernel.groups) == 1:
        return model
    kernel = standing(model.kernel)
    places = _worst_first(model, kernel, most)
    (factor,) = prior_factors(places, kernel, model.jitter)
    known = solve_triangular(factor, model.known(places).T, lower=True)
    gain = known[:, :-1] @ known[:, :-1].T
    # What is known of a place is at most all: by rounding, and by the jitter, it may seem a little more.
    values, vectors = eigh(gain)
    covariance = np.eye(len(places)) - (vectors * values.clip(0.0, 1.0)) @ vectors.T
    return FieldModel(
        kernel,
        model.prior_mean,
        model.jitter,
        places,
        (factor,),
        known[:, -1].copy(),
        covariance,
        model.transform,
    )


def standing(kernel: Kernel) -> Kernel:
    """The same covariance at one moment, of one group: nothing moves."""
    components = tuple(replace(component, time=Static()) for component in kernel.components)
    return Kernel(components, kernel.noise_variance)


def _worst_first(model: FieldModel, kernel: Kernel, most: int) -> FloatArray:
    """Places of the basis and of a lattice, each where those before it leave mean or deviation the most wrong.

    The mean, and the functions h_j whose squares are the change of the variance, are interpolated by the prior, all at
    once, in Newton's form: the vectorial greedy algorithm of Wirtz & Haasdonk 2013, whose rows v are the Cholesky
    factor's and whose coefficients are the whitened state; the error of the map itself is what is greedy here.
    """
    step = coarsest_step_m(model.basis)
    sites = lattice(model.basis)
    candidates = np.concatenate([model.basis, sites if step is None else snapped(sites, step)])
    signal, wanted = kernel.signal_variance, model.known(candidates)
    deviation = np.sqrt(np.maximum(signal - np.einsum("ij,ij->j", wanted[:-1], wanted[:-1]), 0.0))
    rows, coefficients = np.zeros((most, len(candidates))), np.zeros((most, len(wanted)))
    mean, change = np.zeros(len(candidates)), np.zeros(len(candidates))
    unexplained = np.full(len(candidates), signal * (1.0 + model.jitter))
    chosen: list[int] = []
    for k in range(most):
        error = np.abs(np.sqrt(np.maximum(signal - change, 0.0)) - deviation)
        np.maximum(error, np.abs(wanted[-1] - mean), out=error)
        error[chosen] = 0.0
        error[unexplained <= _LEAST * signal] = 0.0
        worst = int(error.argmax())
        if error[worst] <= _GOOD_ENOUGH * signal**0.5 and chosen:
            break
        chosen.append(worst)
        root, known = np.sqrt(unexplained[worst]), rows[:k]
        v = (kernel.covariance(candidates[[worst]], candidates)[0] - known[:, worst] @ known) / root
        c = (wanted[:, worst] - known[:, worst] @ coefficients[:k]) / root
        change += 2.0 * v * ((coefficients[:k, :-1] @ c[:-1]) @ known) + (c[:-1] @ c[:-1]) * v**2
        mean += c[-1] * v
        unexplained -= v**2
        rows[k], coefficients[k] = v, c
    return candidates[chosen]
