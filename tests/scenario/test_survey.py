"""The whole loop of Algorithm 1 at sea: from the first plan to a map that has become sharp."""

import numpy as np
import pytest

from autonomy.effects import Topic
from autonomy.geometry import path_length_m
from autonomy.learning import snapshot
from sim.autopilot import Mode


def test_one_mission_waits_on_board_for_the_operator(make_voyage):
    voyage = make_voyage()
    voyage.advance(300.0)
    assert voyage.verified == 1
    assert len(voyage.said("MISSION_COUNT")) == 1
    assert len(voyage.plans) == 1
    assert voyage.autopilot.navigator.mode is Mode.MANUAL
    assert not voyage.autopilot.navigator.armed
    np.testing.assert_allclose(voyage.on_board_m(), voyage.plan_m(), atol=0.05)
    assert voyage.health.state == "waiting_for_vehicle"
    assert "arm and select AUTO" in voyage.health.reason


def test_we_never_arm_and_never_select_a_mode(voyage):
    voyage.advance(900.0)
    commands = {each.command for each in voyage.said("COMMAND_LONG")}
    assert commands <= {511, 512, 224}  # streams, a message, the current mission item
    assert not voyage.said("SET_MODE")
    assert not voyage.said("COMMAND_INT")


def test_nothing_is_learnt_on_deck_or_when_somebody_sails_before_the_start(make_voyage):
    voyage = make_voyage()
    voyage.advance(60.0)
    voyage.arm()
    voyage.select(Mode.GUIDED)
    _steer(voyage, 1000.0, 400.0)
    voyage.advance(120.0)
    assert voyage.autopilot.vessel.distance_sailed_m > 500.0
    assert voyage.samples == 0


def test_nothing_is_learnt_outside_the_area(voyage):
    inside = voyage.advance(200.0, until=lambda: _north_m(voyage) > 0.0)
    assert inside
    assert voyage.autopilot.vessel.distance_sailed_m > 200.0
    assert voyage.health.samples <= 1
    voyage.advance(60.0)
    assert voyage.samples > 3


def test_nothing_is_learnt_while_standing_still(voyage):
    voyage.advance(150.0)
    voyage.select(Mode.HOLD)
    voyage.advance(20.0)
    before = voyage.samples
    assert before > 5
    voyage.advance(300.0)
    assert voyage.samples == before


def test_samples_keep_their_distance(voyage):
    voyage.advance(400.0)
    notices = [each for batch in voyage.published[Topic.OBSERVATIONS] for each in batch]
    points = voyage.survey.frame.to_local(*np.transpose([(n.lat_deg, n.lon_deg) for n in notices]))
    gaps = np.hypot(*np.diff(points, axis=0).T)
    assert len(points) > 20
    assert gaps.min() >= 60.0
    assert np.median(gaps) < 100.0


def test_novelty_brings_a_reestimate_and_a_mission_that_is_sailed(voyage):
    first = voyage.plan_m()
    voyage.until("rho 1.00 > 0.60")
    assert voyage.lines("re-estimated")
    second = voyage.plan_m()
    assert second.shape != first.shape or not np.allclose(second, first, atol=1.0)
    np.testing.assert_allclose(voyage.on_board_m(), second, atol=0.05)
    navigator = voyage.autopilot.navigator
    assert (navigator.current, navigator.mission_state.name) == (1, "ACTIVE")
    reached = voyage.advance(600.0, until=lambda: _distance_m(voyage, second[0]) < 20.0)
    assert reached
    assert voyage.autopilot.navigator.mode is Mode.AUTO


@pytest.mark.parametrize("estimates", [True, False])
def test_a_finished_path_brings_another(make_voyage, estimates):
    voyage = make_voyage(exploration={"rho0": 1.0, "reestimate_on_path_end": estimates})
    voyage.start()
    voyage.until("(path finished)")
    assert bool(voyage.lines("re-estimated")) is estimates
    assert voyage.autopilot.navigator.mission_state.name == "ACTIVE"
    assert [plan.reason for plan in voyage.plans] == ["first plan", "path finished"]
    voyage.until("(path finished)")
    assert len(voyage.plans) == 3


def test_the_longest_interval_brings_a_reestimate(make_voyage):
    voyage = make_voyage(exploration={"rho0": 1.0, "maximum_interval_s": 250.0, "minimum_basis": 10})
    voyage.start()
    started = voyage.now
    voyage.until("s since the last re-estimate")
    assert 250.0 < voyage.now - started < 265.0
    again = voyage.now
    voyage.until("s since the last re-estimate")
    assert 250.0 < voyage.now - again < 265.0


def test_the_map_sharpens_and_no_leg_touches_land(make_voyage, legs_over_land):
    voyage = make_voyage()
    voyage.start()
    track = [voyage.survey.frame.to_local(*voyage.autopilot.vessel.position)]
    errors = []
    for _ in range(4):
        for _ in range(60):
            voyage.advance(8.0)
            track.append(voyage.survey.frame.to_local(*voyage.autopilot.vessel.position))
        errors.append(voyage.rmse())
    assert errors[-1] < 0.35 * errors[0]
    assert errors[-1] < 0.08  # a third of the field's standard deviation
    assert len(voyage.plans) >= 3
    assert path_length_m(track) > 10_000.0
    assert legs_over_land(np.array(track)) == 0
    assert not voyage.autopilot.vessel.aground
    for plan in voyage.plans:
        route = voyage.survey.frame.to_local(*np.transpose([plan.start_deg, *plan.route_deg]))
        assert legs_over_land(route) == 0
    assert not voyage.lines("land lies before")


def test_the_belief_ashore_is_the_belief_on_board(voyage):
    voyage.advance(500.0)
    newest = voyage.published[Topic.MODEL][-1]
    again = snapshot.decode(snapshot.encode(newest.model))
    points = np.random.default_rng(0).uniform((0.0, 0.0), (3000.0, 2400.0), (50, 2))
    np.testing.assert_allclose(again.predict(points).mean, newest.model.predict(points).mean, atol=2e-3)
    assert [each.sequence for each in voyage.published[Topic.MODEL]] == list(
        range(1, len(voyage.published[Topic.MODEL]) + 1)
    )


def test_equal_seeds_give_equal_runs_bit_for_bit(make_voyage):
    def run(seed):
        voyage = make_voyage(seed=seed)
        voyage.start()
        voyage.advance(500.0)
        models = [snapshot.encode(each.model) for each in voyage.published[Topic.MODEL]]
        sent = [(time, message.to_json()) for time, message in voyage.sent]
        return voyage.log, models, sent

    first, second, other = run(3), run(3), run(4)
    assert first == second
    assert first[1] != other[1]


def test_a_fast_clock_gives_the_same_survey_for_fewer_messages(make_voyage):
    voyage = make_voyage()
    voyage.speedup = 20.0
    voyage.start()
    voyage.advance(100.0)
    assert len(voyage.plans) >= 4
    assert voyage.rmse() < 0.1
    assert voyage.health.clock_rate == pytest.approx(20.0, rel=0.05)


def _steer(voyage, x, y):
    lat_deg, lon_deg = voyage.survey.frame.to_geodetic((x, y)).tolist()
    from sim.vessel import Position

    voyage.autopilot.navigator.guide_to(Position(lat_deg, lon_deg))


def _distance_m(voyage, point):
    return float(np.hypot(*(voyage.survey.frame.to_local(*voyage.autopilot.vessel.position) - point)))


def _north_m(voyage):
    return float(voyage.survey.frame.to_local(*voyage.autopilot.vessel.position)[1])


def test_a_signal_variance_that_is_far_too_small_is_mended_long_before_the_path_ends(make_voyage):
    """Set by hand to what the first metres of a path vary by: a fiftieth of what the sea does."""
    guess = {"signal_variance": 0.002, "noise_variance": 4e-4, "lengthscales_m": (300.0, 300.0)}
    voyage = make_voyage(
        sampling={"spacing_m": 0.0},
        model={"capacity": 40, "centring_samples": 8, "history_cells": 400, "hyperparameters": guess},
        exploration={"outgrown_ratio": 4.0, "rho0": 1.0, "minimum_basis": 30, "maximum_interval_s": None},
    )
    voyage.start()
    voyage.until("times more than the model allows")
    finished = voyage.core._helm.headway.path_finished
    voyage.until("re-estimated")
    assert not finished
    h = voyage.core._learner.gp.kernel.hyperparameters
    assert voyage.core._learner.history.variance < 4.0 * h.signal_variance
