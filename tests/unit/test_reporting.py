"""What is told ashore, and when."""

import math

import numpy as np
import pytest
import shapely

from autonomy.config import Configuration
from autonomy.effects import Level, Log, Publish, Topic
from autonomy.geometry import LocalFrame
from autonomy.learning.learner import Learner
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.telemetry import Telemetry
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from autonomy.quality import Check, Flag
from autonomy.reporting import Reporter, Status

FRAME = LocalFrame(33.5, -118.5)
SURVEY = SurveyArea.from_geometry(FRAME, shapely.box(0, 0, 1000, 500))
AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
TALLY = {"aggregate": (7, 0, 1, 2, 0)}
STATUS = Status(
    "exploring", "in AUTO", 0.25, 3, worker_busy=True, in_touch=True, distance_m=1234.0, quality=TALLY
)
FLAGS = tuple(Flag.SUSPECT if check is Check.SPIKE else Flag.GOOD for check in Check)


class Desk:
    def __init__(self):
        configuration = Configuration.model_validate(
            {
                "survey": {"area": AREA},
                "vehicle": {"name": "tern"},
                "shore": {"model_period_s": 4.0, "health_period_s": 1.0},
            }
        )
        self.learner = Learner(SURVEY.span_m, centring_samples=3)
        self.reporter = Reporter(configuration, SURVEY, Telemetry("SALT"), self.learner)
        self.asked = 0
        for x in (100.0, 400.0, 700.0):
            self.learner.add((x, 100.0), 33.0 + x * 1e-3, x)

    def status(self):
        self.asked += 1
        return STATUS

    def step(self, now):
        self.reporter.step(now, self.status)
        return {each.topic: each.payload for each in self.reporter.take()}


@pytest.fixture
def desk():
    return Desk()


def test_everything_is_told_at_once_and_then_at_its_period(desk):
    assert set(desk.step(50.0)) == {Topic.HEALTH, Topic.MODEL}
    told = {now: set(desk.step(now)) for now in np.arange(50.5, 58.25, 0.5).tolist()}
    assert [now for now, topics in told.items() if Topic.HEALTH in topics] == [
        51.0,
        52.0,
        53.0,
        54.0,
        55.0,
        56.0,
        57.0,
        58.0,
    ]
    assert [now for now, topics in told.items() if Topic.MODEL in topics] == [54.0, 58.0]
    assert desk.reporter.next_deadline() == 59.0


def test_nobody_is_asked_for_what_is_not_due(desk):
    desk.step(50.0)
    asked = desk.asked
    assert desk.step(50.9) == {}
    assert desk.asked == asked


def test_after_a_stall_each_is_told_once(desk):
    desk.step(50.0)
    assert set(desk.step(500.0)) == {Topic.HEALTH, Topic.MODEL}
    assert desk.step(500.5) == {}
    assert desk.reporter.next_deadline() == 501.0


def test_observations_go_ashore_in_order_and_once(desk):
    desk.step(50.0)
    for k in range(3):
        desk.reporter.observed(Observation(float(k), 33.5, -118.5, 33.0 + k), FLAGS)
    batch = desk.step(51.0)[Topic.OBSERVATIONS]
    assert [(each.model_time_s, each.value) for each in batch] == [(0.0, 33.0), (1.0, 34.0), (2.0, 35.0)]
    assert {(each.flag, each.checks) for each in batch} == {(3, (1, 1, 1, 1, 3, 1, 1))}
    assert Topic.OBSERVATIONS not in desk.step(52.0)


def test_health_and_model_say_the_same(desk):
    for k in range(5):
        desk.learner.add((100.0 * k, 350.0), 33.0 + k, 1000.0 + k)
    told = desk.step(50.0)
    health, model = told[Topic.HEALTH], told[Topic.MODEL]
    assert (health.state, health.reason, health.worker_busy, health.link_ok) == (
        "exploring",
        "in AUTO",
        True,
        True,
    )
    assert (
        (health.samples, health.rho, health.replans)
        == (model.samples, model.rho, model.replans)
        == (8, 0.25, 3)
    )
    assert health.basis_size == len(model.model.basis) == 8
    assert (model.vehicle, model.sequence, model.bounds_m) == ("tern", 1, (0.0, 0.0, 1000.0, 500.0))
    assert health.quality == TALLY
    assert (health.mode, health.lat_deg, health.distance_m) == ("unknown", None, 1234.0)
    assert (model.origin_lat_deg, model.origin_lon_deg) == (33.5, -118.5)
    assert model.utc_s is None
    assert health.calibration == model.calibration == desk.learner.calibration.figures
    assert health.ahead == model.ahead
    assert (health.calibration.count, health.repairs) == (8, 0)


def test_before_the_model_is_born_nothing_is_said_of_the_field():
    desk = Desk()
    desk.learner = Learner(SURVEY.span_m, centring_samples=3)
    desk.reporter._learner = desk.learner
    health = desk.step(50.0)[Topic.HEALTH]
    assert (health.kernel, health.calibration.count) == ("", 0)
    assert math.isnan(health.calibration.coverage_95)


def test_a_plan_is_told_in_degrees(desk):
    route = np.array([(100.0, 0.0), (200.0, 50.0), (300.0, 0.0)])
    marks = np.array([True, False, True])
    desk.reporter.planned(Plan(np.array([10.0, 20.0]), route, marks, 4.5, "paper", "rho"), 7)
    (plan, *lines) = desk.reporter.take()
    notice = plan.payload
    np.testing.assert_allclose(FRAME.to_local(*np.transpose(notice.route_deg)), route, atol=1e-3)
    np.testing.assert_allclose(FRAME.to_local(*notice.start_deg), (10.0, 20.0), atol=1e-3)
    assert (notice.sequence, notice.is_spot, notice.reason) == (7, (True, False, True), "rho")
    assert "plan 7 (rho): 2 spots" in lines[0].text


def test_debugging_lines_stay_on_board(desk):
    desk.reporter.log(Level.DEBUG, "details")
    desk.reporter.log(Level.WARNING, "trouble")
    effects = desk.reporter.take()
    assert [each.text for each in effects if isinstance(each, Log)] == ["details", "trouble"]
    (published,) = [each.payload for each in effects if isinstance(each, Publish)]
    assert published.level == "warning"


def test_the_last_words_leave_nothing_untold(desk):
    desk.step(50.0)
    desk.reporter.observed(Observation(1.0, 33.5, -118.5, 33.0), FLAGS)
    desk.reporter.flush(STATUS)
    topics = [each.topic for each in desk.reporter.take()]
    assert topics == [Topic.HEALTH, Topic.OBSERVATIONS, Topic.MODEL]
