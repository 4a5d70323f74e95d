"""What a comparison says in numbers: scores, ratios with their intervals, the way to an error."""

import numpy as np
import pytest
from scipy.stats import norm, ttest_rel

from autonomy.learning.prediction import Prediction
from sim.experiment.compare_scores import kilometres_to, score
from sim.experiment.compare_statistics import pooled_deviation, ratio


def test_scores_are_those_of_readings_drawn_many_times() -> None:
    rng = np.random.default_rng(0)
    truth, unit, noise, believed_noise = rng.normal(5.0, 3.0, 40), 3.0, 0.6, 0.9
    mean, variance = truth + rng.normal(0.0, 1.0, 40), rng.uniform(0.1, 2.0, 40)
    found = score(Prediction(mean, variance), believed_noise, truth, noise, unit)
    readings = truth + noise * rng.normal(size=(10_000, 40))
    spread = np.sqrt(variance + believed_noise**2)
    density = norm.logpdf(readings, mean, spread) + np.log(unit)
    inside = np.abs(readings - mean) <= norm.ppf(0.975) * spread
    assert found.rmse == pytest.approx(np.sqrt(np.mean((mean - truth) ** 2)) / unit)
    # 400 000 draws: four standard errors.
    assert found.nlpd == pytest.approx(-density.mean(), abs=0.01)
    assert found.coverage == pytest.approx(inside.mean(), abs=0.004)


def test_a_perfect_prediction_covers_95_percent() -> None:
    truth = np.linspace(0.0, 1.0, 5)
    found = score(Prediction(truth, np.zeros(5)), 0.1, truth, 0.1, 1.0)
    assert found.coverage == pytest.approx(0.95)
    assert found.rmse == 0.0


def test_the_interval_is_students_over_fields() -> None:
    # Five voyages a field that all say the same are worth one: only fields are drawn independently.
    rng = np.random.default_rng(1)
    ours, theirs = rng.uniform(0.5, 1.0, 6), rng.uniform(0.5, 1.0, 6)
    pairs = {str(k): [(ours[k], theirs[k])] * 5 for k in range(6)}
    found = ratio(pairs)
    expected = ttest_rel(np.log(ours), np.log(theirs)).confidence_interval(0.95)
    assert found.mean == pytest.approx(np.exp(np.mean(np.log(ours / theirs))))
    assert (found.low, found.high) == pytest.approx((np.exp(expected.low), np.exp(expected.high)))
    assert found.within == pytest.approx(0.0, abs=1e-12)
    assert (found.voyages, found.fields) == (30, 6)
    assert found.better == 5 * np.count_nonzero(ours < theirs)


def test_of_one_field_there_is_no_interval() -> None:
    found = ratio({"a": [(1.0, 2.0), (1.0, 8.0)]})
    assert found.mean == pytest.approx(0.25)
    assert np.isnan(found.low)
    assert np.isnan(found.high)
    assert found.within == pytest.approx(np.log(4.0) / np.sqrt(2.0))


def test_nothing_to_compare_is_said() -> None:
    with pytest.raises(ValueError, match="no voyages"):
        ratio({"a": []})


def test_deviations_are_pooled_within_groups() -> None:
    rng = np.random.default_rng(2)
    groups = [level + rng.normal(0.0, 0.3, 4000) for level in (0.0, 10.0, -5.0)]
    assert pooled_deviation(groups) == pytest.approx(0.3, rel=0.03)
    assert np.isnan(pooled_deviation([np.zeros(1)]))


def test_the_way_to_an_error_is_where_it_stays_below() -> None:
    way = np.arange(5.0)
    assert kilometres_to(0.5, way, np.array([1.0, 0.8, 0.4, 0.2, 0.1])) == pytest.approx(1.75)
    # Below for a moment is not there.
    assert kilometres_to(0.5, way, np.array([1.0, 0.3, 0.9, 0.4, 0.1])) == pytest.approx(2.8)
    assert kilometres_to(0.5, way, np.array([0.4, 0.3, 0.3, 0.3, 0.3])) == 0.0
    assert kilometres_to(0.5, way, np.array([1.0, 0.4, 0.4, 0.4, 0.6])) == np.inf
