"""Voyages: what is recorded is what was sailed, read and believed."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from experiment_seas import small_sea

from autonomy.config import Configuration
from autonomy.planning.plan import NO_SPOTS, Plan
from sim.experiment.orders import Orders, on_rails
from sim.experiment.probe import READINGS_PER_SAMPLE
from sim.experiment.voyage import sail
from sim.experiment.waters import nearest_water, waters_of

SPACING_M = 250.0
SETTINGS = {
    "survey": {"area": [[33.0, -118.1], [33.0, -118.0], [33.1, -118.0]]},
    "sampling": {"spacing_m": SPACING_M},
    "model": {"capacity": 40, "centring_samples": 12},
    "exploration": {"rho0": 0.5, "minimum_basis": 20, "maximum_interval_s": None},
    "planning": {"planner": "paper", "lattice": [6, 6], "spots": 6},
}


@pytest.fixture(scope="module")
def waters():
    return waters_of(small_sea(), 30, 32, standoff_m=80.0, passage_cells=40)


@pytest.fixture(scope="module")
def orders(waters):
    launch_m = nearest_water(waters, (3000.0, -3000.0))
    configuration = Configuration.model_validate(SETTINGS)
    return Orders(waters, configuration, launch_m, samples=90, judgements=10, keep_models=True)


@pytest.fixture(scope="module")
def voyage(orders):
    return sail(orders)


def test_samples_lie_at_the_configured_spacing(voyage):
    """Along the wake; a turn delays a sample by at most one reading, and a chord is never longer than the way."""
    apart_m = np.hypot(*np.diff(voyage.samples.points_m, axis=0).T)
    assert apart_m.min() >= SPACING_M
    assert np.median(apart_m) == pytest.approx(SPACING_M, rel=0.01)
    assert apart_m.max() <= SPACING_M * (1.0 + 1.5 / READINGS_PER_SAMPLE)


def test_samples_are_what_the_field_has_where_they_were_taken(voyage, waters):
    lat_deg, lon_deg = waters.survey.frame.to_geodetic(voyage.samples.points_m).T
    # The wire carries single precision, and positions to a centimetre.
    assert voyage.samples.values == pytest.approx(waters.field.value(lat_deg, lon_deg, 0.0), abs=2e-5)
    assert voyage.refused == 0


def test_every_sample_is_recorded_and_the_voyage_ends_in_time(voyage, orders):
    last = voyage.judgements[-1]
    assert len(voyage.samples) in (orders.samples, orders.samples + 1)
    assert last.samples == orders.samples
    assert np.all(np.diff(voyage.samples.time_s) > 0.0)


def test_the_error_is_that_of_the_model_over_the_water(voyage, waters):
    """Cell by cell, by another way through the model, and by the field's own mask instead of the survey's polygons."""
    x_m, y_m = np.meshgrid(waters.x_axis_m, waters.y_axis_m)
    points = np.column_stack([x_m.ravel(), y_m.ravel()])
    lat_deg, lon_deg = waters.survey.frame.to_geodetic(points).T
    truth = waters.field.value(lat_deg, lon_deg, 0.0)
    for judgement in voyage.curve[:: len(voyage.curve) // 3]:
        error = judgement.model.predict(points).mean - truth
        assert judgement.rmse == pytest.approx(np.sqrt(np.nanmean(error**2)), rel=1e-9)
    assert voyage.field_std == pytest.approx(np.nanstd(truth), rel=1e-9)


def test_the_map_is_judged_at_equal_parts_of_the_voyage(voyage):
    counts = [each.samples for each in voyage.curve]
    assert counts == [12, *range(18, 91, 9)]


def test_plans_and_re_estimates_come_when_rho_says_so(voyage):
    assert [each.plan.reason for each in voyage.plans[:2]] == ["first plan", "rho 1.00 > 0.50"]
    for replan in voyage.plans[1:]:
        assert (replan.rho > 0.5) == replan.plan.reason.startswith("rho")
        assert voyage.samples.points_m.shape[0] >= replan.samples
    fits = [each for each in voyage.plans if each.plan.reason.startswith("rho")]
    assert [each.samples for each in voyage.reestimates] == [each.samples for each in fits]
    pairs = [each.occasion for each in voyage.judgements if each.occasion != "under way"]
    assert pairs == ["before re-estimate", "after re-estimate"] * len(voyage.reestimates)


def test_another_run_gives_the_same(voyage, orders):
    again = sail(orders)
    assert again.samples.values.tolist() == voyage.samples.values.tolist()
    assert [each.rmse for each in again.judgements] == [each.rmse for each in voyage.judgements]
    assert again.log == voyage.log


def following(route_m):
    """A planner of one plan: these waypoints, once; the voyage ends with them."""
    routes = [route_m]

    def plan(request, survey):
        if not routes:
            return None
        route = routes.pop()
        return Plan(
            request.start_m, route, np.ones(len(route), dtype=bool), NO_SPOTS, "given", request.reason
        )

    return plan


def test_given_waypoints_are_sailed_once_and_the_voyage_ends_with_them(orders):
    west, south = orders.launch_m[0] - 2500.0, orders.launch_m[1] - 700.0
    route = np.array([[west, orders.launch_m[1]], [west, south], [orders.launch_m[0], south]])
    given = Orders(
        orders.waters,
        on_rails(orders.configuration),
        orders.launch_m,
        distance_m=1e6,
        planner=following(route),
    )
    sailed = sail(given)
    way = shapely.LineString([orders.launch_m, *route])
    assert sailed.distance_m == pytest.approx(way.length, abs=100.0)
    assert shapely.distance(way, shapely.points(sailed.track_m)).max() < 60.0
    assert len(sailed.samples) == pytest.approx(way.length / SPACING_M, abs=2)
    assert not sailed.reestimates
    assert len(sailed.plans) == 1


def test_a_probe_may_be_read_at_the_spots_alone(orders):
    configuration = orders.configuration.model_copy(
        update={"model": orders.configuration.model.model_copy(update={"centring_samples": 4})}
    )
    at_spots = Orders(orders.waters, configuration, orders.launch_m, distance_m=25_000.0, spots_only=True)
    sailed = sail(at_spots)
    spots = np.vstack([each.plan.spots_m for each in sailed.plans])
    away_m = np.linalg.norm(sailed.samples.points_m[:, None] - spots, axis=-1).min(axis=1)
    assert len(sailed.samples) >= 4
    assert away_m.max() <= 30.0


def test_what_is_known_before_the_launch_is_learnt_with_the_samples(orders, waters, voyage):
    """Far off the way only what was known tells of the field."""
    rng, truth = np.random.default_rng(5), waters.truth(0.0)
    rows, columns = np.nonzero(np.isfinite(truth))
    chosen = rng.choice(len(rows), 12, replace=False)
    places_m = np.column_stack([waters.x_axis_m[columns[chosen]], waters.y_axis_m[rows[chosen]]])
    known = truth[rows[chosen], columns[chosen]]
    found = sail(replace(orders, samples=40, known_m=places_m, known=known))
    assert len(found.samples) in (28, 29)
    assert found.curve[0].samples < voyage.curve[0].samples + 1
    error = np.abs(found.model.predict(places_m).mean - known)
    assert np.median(error) < 0.3 * voyage.field_std
    with pytest.raises(ValueError, match="known_m, the places"):
        replace(orders, known=known)


def test_orders_without_an_end_or_a_spacing_are_refused(orders):
    with pytest.raises(ValueError, match="needs an end"):
        Orders(orders.waters, orders.configuration, orders.launch_m)
    dense = orders.configuration.model_copy(update={"sampling": type(orders.configuration.sampling)()})
    with pytest.raises(ValueError, match="spacing_m"):
        Orders(orders.waters, dense, orders.launch_m, samples=10)
