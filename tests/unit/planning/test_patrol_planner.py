"""The round that is sailed for ever."""

from functools import cache

import numpy as np
import pytest
from shapely.geometry import Point, box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.learning import FieldModel, Hyperparameters
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck
from autonomy.planning.assembly import verify
from autonomy.planning.nowcast import nowcast_variance
from autonomy.planning.passage import passage_of
from autonomy.planning.planners import patrol
from autonomy.planning.request import PlanRequest
from autonomy.planning.spacing import lane_spacing_m
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)
ISLAND = Point(5000, 5000).buffer(1800)
SLOW_S = 200_000.0


@cache
def survey(land=None, **given):
    return SurveyArea.from_geometry(FRAME, box(0, 0, 10_000, 10_000), land=land, **given)


def request(start=(1250.0, 1250.0), lengthscale_m=2174.0, timescale_s=SLOW_S, **given):
    model = FieldModel.prior(Hyperparameters(1.0, 0.05, (lengthscale_m, lengthscale_m), timescale_s))
    return PlanRequest(model, np.array(start), 20, (12, 12), "a test", **given)


def test_on_a_square_the_round_is_as_long_as_its_lattice_allows():
    """An even number of sites on each side: as many legs as sites, back where it began."""
    made = patrol.plan(request(), survey())
    side = round(len(made.spots_m) ** 0.5)
    assert side % 2 == 0
    assert len(made.spots_m) == side**2
    assert made.length_m == pytest.approx(side * 10_000.0)
    assert made.route_m[-1].tolist() == made.start_m.tolist()
    assert made.mutual_information > 0.0


def test_every_place_is_visited_once_a_round_and_nothing_crosses_land():
    area = survey(ISLAND, standoff_m=150.0)
    made = patrol.plan(request((100.0, 100.0)), area)
    verify(made.start_m, made.route_m, area)
    spots = made.spots_m
    assert np.array_equal(spots[0], spots[-1])
    assert len(np.unique(spots, axis=0)) == len(spots) - 1
    across = len(np.unique(spots[:, 0])), len(np.unique(spots[:, 1]))
    assert {tuple(spot) for spot in spots} == {tuple(site) for site in area.candidate_sites(*across)}


def test_round_after_round_is_the_same_in_the_same_direction():
    area = survey(ISLAND, standoff_m=150.0)
    first = patrol.plan(request((100.0, 100.0)), area)
    second = patrol.plan(request(tuple(first.route_m[-1]), seed=3), area)
    assert np.array_equal(second.spots_m, first.spots_m[1:])


def test_a_round_under_way_is_gone_on_with_although_the_field_seems_a_little_different():
    area = survey()
    first = patrol.plan(request(), area)
    left, marks = first.route_m[5:], first.is_spot[5:]
    here = tuple(0.5 * (first.route_m[4] + first.route_m[5]))
    going_on = {"remainder_m": left, "remainder_is_spot": marks}
    for lengthscale_m in (2000.0, 2400.0):
        later = patrol.plan(request(here, lengthscale_m, **going_on), area)
        assert np.array_equal(later.spots_m[: len(left)], left)
        assert len(later.spots_m) == len(first.spots_m) + 1
    assert len(patrol.plan(request(here, 1000.0, **going_on), area).spots_m) > len(first.spots_m) + 1


def test_the_largest_part_that_moves_decides():
    static = Component(5.0, SquaredExponential((4000.0, 4000.0)))
    small = Component(0.2, SquaredExponential((500.0, 500.0)), OrnsteinUhlenbeck(SLOW_S))
    large = Component(1.0, SquaredExponential((1000.0, 1500.0)), OrnsteinUhlenbeck(SLOW_S))
    assert lane_spacing_m(Kernel((static, small, large), 0.1)) == pytest.approx(1150.0)
    assert lane_spacing_m(Kernel((static,), 0.1)) == pytest.approx(4600.0)


def test_the_faster_a_field_forgets_the_coarser_and_shorter_the_round():
    lengths = [patrol.plan(request(timescale_s=s), survey()).length_m for s in (2e6, 2e5, 2e4)]
    assert lengths[0] > lengths[1] > lengths[2]


def test_the_expected_variance_is_what_a_dense_process_leaves():
    """Literal: every reading of three rounds, at four moments, given the covariance of readings in space and time."""
    kernel = Hyperparameters(2.0, 0.05, (2500.0, 2500.0), 30_000.0).kernel
    corners = np.array([[2000.0, 2000.0], [8000.0, 2000.0], [8000.0, 8000.0], [2000.0, 8000.0]])
    points = survey().candidate_sites(5, 5)
    ours = nowcast_variance(kernel, corners, 1.5, 240.0, points)
    step_m, length_m = 240.0, 24_000.0
    behind_m = np.arange(0.5 * step_m, 3 * length_m, step_m)
    literal = []
    for moment in range(4):
        along_m = (moment * length_m / 4 - behind_m) % length_m
        leg, rest = np.divmod(along_m, 6000.0)
        leg = leg.astype(int)
        places = corners[leg] + (np.roll(corners, -1, axis=0)[leg] - corners[leg]) * (rest / 6000.0)[:, None]
        lag_s = np.abs(behind_m[:, None] - behind_m[None]) / 1.5
        squared = np.sum((places[:, None] - places[None]) ** 2, axis=-1)
        K = 2.0 * np.exp(-0.5 * squared / 2500.0**2 - lag_s / 30_000.0) + 0.05 * np.eye(len(places))
        squared = np.sum((places[:, None] - points[None]) ** 2, axis=-1)
        k = 2.0 * np.exp(-0.5 * squared / 2500.0**2 - behind_m[:, None] / 1.5 / 30_000.0)
        literal.append(np.mean(2.0 - np.sum(k * np.linalg.solve(K, k), axis=0)))
    assert ours == pytest.approx(np.mean(literal), rel=1e-6)


def test_of_a_round_longer_than_the_budget_the_first_part_is_sailed():
    area, home = survey(), np.array([1250.0, 1250.0])
    whole = patrol.plan(request(), area)
    made = patrol.plan(request(budget_m=20_000.0), area)
    assert made.length_m == pytest.approx(20_000.0, rel=1e-3)
    assert np.array_equal(made.route_m[:6], whole.route_m[:6])
    bound = patrol.plan(request(budget_m=20_000.0, home_m=home), area)
    way = path_length_m(passage_of(area).path(bound.route_m[-1], home))
    assert 19_900.0 <= bound.length_m + way <= 20_000.0


def test_a_field_larger_than_the_water_is_still_gone_round():
    made = patrol.plan(request(lengthscale_m=50_000.0), survey())
    assert len(np.unique(made.spots_m, axis=0)) >= 4


def test_only_the_vessels_own_basin():
    area = survey(box(4800, 0, 5200, 10_000))
    assert np.all(patrol.plan(request((500.0, 500.0)), area).spots_m[:, 0] < 4800)
    assert np.all(patrol.plan(request((9500.0, 500.0)), area).spots_m[:, 0] > 5200)
