"""Caution about the signal variance: how uncertain it is, against what statistics says, and what is made of that."""

import math

import numpy as np
import pytest

from autonomy.learning.caution import cautious, posterior_variance
from autonomy.learning.fitting import Method, doubt, fit
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.likelihood import Readings
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.structures import STRUCTURES

SPAN_M = 10_000.0
STRUCTURE = STRUCTURES["squared_exponential"]


def test_of_independent_places_the_doubt_is_two_over_their_number() -> None:
    # n independent normal values tell the log of their variance with the Fisher information n/2. Each place is
    # visited twice, so that noise is known apart.
    rng = np.random.default_rng(3)
    side = 12
    axis = np.linspace(0.0, SPAN_M, side)
    places = np.array([(x, y) for x in axis for y in axis])
    values = rng.normal(size=side**2)
    x, y = np.repeat(places, 2, axis=0), np.repeat(values, 2) + 0.05 * rng.normal(size=2 * side**2)
    readings = Readings.of(x, y, None, None, 0.0)
    short = Kernel((Component(1.0, SquaredExponential((100.0, 100.0))),), 0.0025)
    found = fit(readings, STRUCTURE, SPAN_M, short)
    unsure = doubt(readings, STRUCTURE, SPAN_M, found.kernel, Method())
    assert unsure == pytest.approx(2.0 / side**2, rel=0.2)


def test_the_doubt_falls_as_more_of_the_field_is_seen_and_does_not_depend_on_units() -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(0.0, SPAN_M, (250, 2))
    y = np.sin(x[:, 0] / 500.0) + np.cos(x[:, 1] / 400.0) + 0.02 * rng.normal(size=250)

    def of(width_m: float, scale: float = 1.0, offset: float = 0.0) -> float:
        inside = np.flatnonzero(x.max(axis=1) < width_m)
        readings = Readings.of(x[inside], offset + scale * y[inside], None, None, "gls")
        found = fit(readings, STRUCTURE, SPAN_M)
        return doubt(readings, STRUCTURE, SPAN_M, found.kernel, Method())

    assert of(3500.0) > 1.5 * of(SPAN_M)
    assert of(SPAN_M, 1e-3, 33.0) == pytest.approx(of(SPAN_M), rel=1e-2)


def test_without_priors_there_is_no_posterior_and_no_caution() -> None:
    x = np.random.default_rng(5).uniform(0.0, SPAN_M, (50, 2))
    readings = Readings.of(x, np.sin(x[:, 0] / 900.0), None, None, "gls")
    kernel = fit(readings, STRUCTURE, SPAN_M).kernel
    assert doubt(readings, STRUCTURE, SPAN_M, kernel, Method(priors=False)) == 0.0
    assert cautious(kernel, 0.0) == kernel


def test_only_the_signal_becomes_louder() -> None:
    parts = (Component(2.0, SquaredExponential((5.0, 6.0))), Component(1.0, Matern32((1.0, 1.0))))
    louder = cautious(Kernel(parts, 0.1), 0.5)
    assert louder.noise_variance == 0.1
    assert louder.signal_variance == pytest.approx(3.0 * math.exp(2.0))
    assert louder.components[0].variance / louder.components[1].variance == pytest.approx(2.0)
    assert [c.space for c in louder.components] == [c.space for c in parts]


def test_a_fit_that_tells_next_to_nothing_does_not_raise_it_without_end() -> None:
    kernel = Kernel((Component(2.0, SquaredExponential((5.0, 6.0))),), 0.1)
    assert cautious(kernel, 40.0) == cautious(kernel, 1.5)
    assert cautious(kernel, 1.4).signal_variance < cautious(kernel, 1.5).signal_variance


def test_the_prior_of_the_variance_adds_no_knowledge() -> None:
    # Readings far shorter than every length-scale in question: without its prior nothing bounds the variance, and
    # the doubt is larger than the prior's own variance of 1.
    rng = np.random.default_rng(8)
    x = np.column_stack([np.linspace(0.0, 300.0, 25), np.zeros(25)])
    readings = Readings.of(x, x[:, 0] / 300.0 + 0.05 * rng.normal(size=25), None, None, "gls")
    found = fit(readings, STRUCTURE, SPAN_M)
    assert doubt(readings, STRUCTURE, SPAN_M, found.kernel, Method()) > 1.0


def test_a_direction_that_nothing_is_known_of_counts_as_the_widest() -> None:
    assert posterior_variance(np.diag([4.0, 1.0]), 10.0) == pytest.approx(0.25)
    assert posterior_variance(np.diag([-1.0, 1.0]), 6.0) == pytest.approx(36.0)
