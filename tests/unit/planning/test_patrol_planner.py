"""The round that is sailed for ever."""

import numpy as np
import pytest
from shapely.geometry import Point, box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.learning import FieldModel, Hyperparameters
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck
from autonomy.planning.assembly import verify
from autonomy.planning.passage import passage_of
from autonomy.planning.planners import patrol
from autonomy.planning.request import PlanRequest
from autonomy.planning.spacing import lane_spacing_m, round_spacing_m
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)
ISLAND = Point(5000, 5000).buffer(1800)
SLOW_S = 200_000.0


def survey(land=None, **given):
    return SurveyArea.from_geometry(FRAME, box(0, 0, 10_000, 10_000), land=land, **given)


def request(start=(1250.0, 1250.0), lengthscale_m=2174.0, timescale_s=SLOW_S, **given):
    model = FieldModel.prior(Hyperparameters(1.0, 0.05, (lengthscale_m, lengthscale_m), timescale_s))
    return PlanRequest(model, np.array(start), 20, (12, 12), "a test", **given)


def test_on_a_square_the_round_is_as_long_as_its_lattice_allows():
    """Four by four sites 2.5 km apart: sixteen legs, back where it began."""
    made = patrol.plan(request(), survey())
    assert made.length_m == pytest.approx(16 * 2500.0)
    assert len(made.spots_m) == 16
    assert made.route_m[-1].tolist() == [1250.0, 1250.0]
    assert made.mutual_information > 0.0


def test_every_place_is_visited_once_a_round_and_nothing_crosses_land():
    area = survey(ISLAND, standoff_m=150.0)
    made = patrol.plan(request((100.0, 100.0)), area)
    verify(made.start_m, made.route_m, area)
    spots = made.spots_m
    assert np.array_equal(spots[0], spots[-1])
    assert len(np.unique(spots, axis=0)) == len(spots) - 1
    sites = area.candidate_sites(4, 4)
    assert {tuple(spot) for spot in spots} == {tuple(site) for site in sites}


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
    for lengthscale_m in (1850.0, 2174.0, 2600.0):
        later = patrol.plan(request(here, lengthscale_m, **going_on), area)
        assert np.array_equal(later.spots_m[: len(left)], left)
        assert len(later.spots_m) == 17
    for lengthscale_m in (1200.0, 4000.0):
        assert len(patrol.plan(request(here, lengthscale_m, **going_on), area).spots_m) != 17


def test_the_spacing_follows_the_largest_part_that_moves():
    static = Component(5.0, SquaredExponential((4000.0, 4000.0)))
    small = Component(0.2, SquaredExponential((500.0, 500.0)), OrnsteinUhlenbeck(SLOW_S))
    large = Component(1.0, SquaredExponential((1000.0, 1500.0)), OrnsteinUhlenbeck(SLOW_S))
    assert lane_spacing_m(Kernel((static, small, large), 0.1)) == pytest.approx(1150.0)
    assert lane_spacing_m(Kernel((static,), 0.1)) == pytest.approx(4600.0)


def test_a_field_that_forgets_faster_than_a_round_takes_is_seen_more_coarsely():
    slow, fast, faster = (
        Hyperparameters(1.0, 0.1, (1000.0, 1000.0), timescale_s).kernel
        for timescale_s in (1e6, 1e8 / 1.5 / 1600.0, 1e3)
    )
    assert round_spacing_m(slow, 1e8, 1.5) == pytest.approx(1150.0)
    assert round_spacing_m(fast, 1e8, 1.5) == pytest.approx(1600.0)
    assert round_spacing_m(faster, 1e8, 1.5) == pytest.approx(2000.0)
    still = Hyperparameters(1.0, 0.1, (1000.0, 1000.0)).kernel
    assert round_spacing_m(still, 1e8, 1.5) == pytest.approx(1150.0)


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
