"""Re-planning under way: no way back at the seam, no change of course for nothing, no stop between stretches."""

import dataclasses

import numpy as np
import pytest
import shapely

from autonomy import jobs
from autonomy.planning.plan import Plan


def lane(*x_m, y_m=200.0):
    """Corners along the south of the area."""
    return np.array([(float(x), y_m) for x in x_m])


class Office:
    """Does the jobs, but answers with the plans that a test wants: the k-th of `answers`, the last again and again.

    An answer is made from the request.
    """

    def __init__(self, *answers, **fields):
        self.answers, self.fields, self.requests = answers, fields, []

    def __call__(self, name, request, survey):
        result = jobs.run(name, request, survey)
        self.requests.append(request.plan)
        corners = self.answers[min(len(self.requests), len(self.answers)) - 1](request.plan)
        is_spot = np.ones(len(corners), dtype=bool)
        reason = request.plan.reason
        made = Plan(request.plan.start_m, corners, is_spot, 1.0, "test", reason, **self.fields)
        return dataclasses.replace(result, plan=made)


def sailed(voyage, duration_s, until=lambda: False):
    """Positions of the boat, every half second, shape (n, 2)."""
    track = []
    end = voyage.now + duration_s
    while voyage.now < end and not until():
        voyage.advance(0.5)
        track.append(voyage.survey.frame.to_local(*voyage.autopilot.vessel.position))
    return np.array(track)


@pytest.mark.parametrize("job_s", [2.0, 30.0])
def test_a_new_plan_continues_the_old_way(make_voyage, job_s):
    """All plans lead east, so any metre to the west would be one to where the boat was expected and was not."""
    office = Office(
        lambda plan: lane(200, 900, 2800),
        lambda plan: plan.start_m + np.array([(200.0, 40.0), (1200.0, 60.0)]),
        lambda plan: lane(2900),
    )
    voyage = make_voyage(run_job=office, exploration={"minimum_basis": 8, "rho0": 0.3})
    voyage.job_s = job_s
    voyage.start()
    voyage.advance(
        120.0, until=lambda: voyage.survey.frame.to_local(*voyage.autopilot.vessel.position)[0] > 250
    )
    track = sailed(voyage, 400.0, until=lambda: voyage.verified >= 3)
    assert voyage.verified >= 3
    assert np.diff(track[:, 0]).min() > -0.05
    # And it was expected where it was, to within some seconds of sailing.
    line = shapely.LineString(track)
    start = office.requests[1].start_m
    assert line.distance(shapely.Point(start)) < 10.0


def test_what_is_left_and_what_is_known_go_with_the_request(make_voyage):
    office = Office(lambda plan: lane(200, 900, 2000, 2800))
    voyage = make_voyage(
        run_job=office, exploration={"minimum_basis": 8, "rho0": 0.3}, planning={"iterations": 7}
    )
    voyage.start()
    assert voyage.advance(400.0, until=lambda: len(office.requests) == 2)
    first, second = office.requests
    assert not len(first.remainder_m)
    assert first.measured is None
    assert first.model_version is None
    np.testing.assert_array_equal(second.remainder_m, lane(200, 900, 2000, 2800)[-len(second.remainder_m) :])
    assert 1 <= len(second.remainder_m) <= 3
    assert second.remainder_is_spot.all()
    assert second.measured.counts.sum() == second.model_version >= 8
    assert second.sample_spacing_m == 60.0
    assert second.speed_mps == pytest.approx(8.0, rel=0.3)
    assert second.iterations == 7


def test_a_small_gain_does_not_change_the_course(make_voyage):
    corners = lane(200, 900, 2000, 2800)
    office = Office(
        lambda plan: corners, lambda plan: corners[::-1], objective_before=1.0, objective_after=0.99
    )
    voyage = make_voyage(run_job=office, exploration={"minimum_basis": 8, "rho0": 0.3})
    voyage.start()
    voyage.until("the course is kept", patience_s=400.0)
    verified, began = voyage.verified, voyage.now
    voyage.advance(5.0)
    (line,) = voyage.lines("the course is kept")
    assert line.endswith("a new plan would gain 1.0 %")
    assert voyage.verified == verified
    assert not [each for each in voyage.traffic(began) if each.startswith("MISSION_COUNT")]
    assert len(voyage.plans) == 1
    assert voyage.health.rho < 0.3  # what was estimated anew is kept all the same


def test_a_long_route_is_sailed_in_stretches_without_a_stop(make_voyage):
    corners = np.array([(300.0 + 180.0 * k, 150.0 + 120.0 * (k % 2)) for k in range(14)])
    office = Office(lambda plan: corners)
    voyage = make_voyage(
        run_job=office, mavlink={"mission_items": 5, "acceptance_radius_m": 15.0}, exploration={"rho0": 1.0}
    )
    voyage.start()
    voyage.advance(120.0, until=lambda: voyage.autopilot.vessel.distance_sailed_m > 200.0)
    spare_m, track, end_m = [], [], corners[4]
    while len(office.requests) < 2 and len(track) < 2000:
        voyage.advance(0.5)
        track.append(voyage.survey.frame.to_local(*voyage.autopilot.vessel.position))
        if len(voyage.lines("the next stretch")) > len(spare_m):
            spare_m.append(np.hypot(*(end_m - track[-1])))
        end_m = voyage.on_board_m()[-1]
    # The next plan is asked for at the very end, and all corners were sailed to.
    assert office.requests[1].reason == "path finished"
    assert np.hypot(*(track[-1] - corners[-1])) < 40.0
    line = shapely.LineString(track)
    assert max(line.distance(shapely.Point(corner)) for corner in corners) < 16.0
    # A boat that has completed what is on board would stop there: more of it comes long before.
    assert min(spare_m) > 100.0
    assert len(spare_m) >= 2
    assert len(voyage.plans) == 1
    assert len(voyage.on_board_m()) <= 5
