"""When to plan anew: rho, the finished path, the longest interval; ours and the paper's."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.config import ExplorationSection
from autonomy.exploration import Exploration, Figures, Trigger

CAPACITY = 100
PAPER = ExplorationSection(rho0=0.6, minimum_basis=1, maximum_interval_s=None, reestimate_on_path_end=False)


def figures(
    basis_size=50, fresh=0, *, replaced=0, finished=False, time_s=0.0, cells=None, places=None, spread=1.0
):
    cells = basis_size if cells is None else cells
    places = cells if places is None else places
    return Figures(time_s, basis_size, CAPACITY, fresh, replaced, finished, cells, places, spread)


def some_figures():
    return st.builds(
        lambda size, share, replaced, finished, time_s: Figures(
            time_s, size, CAPACITY, round(share * size), replaced, finished, size, size, 1.0
        ),
        st.integers(0, CAPACITY),
        st.floats(0.0, 1.0),
        st.integers(0, 10 * CAPACITY),
        st.booleans(),
        st.floats(0.0, 1e7),
    )


@pytest.mark.parametrize(
    ("planner", "section", "share"),
    [
        ("paper", {}, None),
        ("route", {}, 1 / 7),
        ("route", {"replan_share": 1.0}, None),
        ("spots", {"replan_share": 0.5}, 0.5),
    ],
)
def test_a_share_of_the_path_sailed_asks_for_another_plan_where_that_pays(planner, section, share):
    decider = Exploration(ExplorationSection(maximum_interval_s=None, **section))
    for sailed_share in (0.0, 0.1, 0.142, 0.15, 0.49, 0.51, 0.99, 1.0):
        decision = decider.decide(dataclasses.replace(figures(), sailed_share=sailed_share, planner=planner))
        if share is None or sailed_share <= share:
            assert decision is None
        else:
            assert (decision.trigger, decision.reestimate) == (Trigger.SAILED, False)


def exploration(**section):
    return Exploration(ExplorationSection(**section))


@given(some_figures(), st.sampled_from(["added", "replaced"]))
def test_rho_is_a_share(figures, rule):
    assert 0.0 <= exploration(rho_rule=rule).rho(figures) <= 1.0


@given(some_figures(), st.sampled_from(["added", "replaced"]))
def test_a_threshold_of_one_is_never_exceeded(figures, rule):
    decision = exploration(rho0=1.0, rho_rule=rule, minimum_basis=1, maximum_interval_s=None).decide(figures)
    assert (decision is not None) == figures.path_finished


@given(some_figures())
def test_the_papers_rule_in_words(figures):
    decision = Exploration(PAPER).decide(figures)
    if figures.basis_size and figures.fresh / figures.basis_size > 0.6:
        assert decision is not None
        assert decision.trigger is Trigger.NOVELTY
        assert decision.reestimate
    elif figures.path_finished:
        assert decision is not None
        assert decision.trigger is Trigger.PATH_FINISHED
        assert not decision.reestimate
    else:
        assert decision is None


@given(some_figures())
def test_the_papers_rule_as_its_pseudo_code_has_it(figures):
    literal = PAPER.model_copy(update={"rho_rule": "replaced"})
    decision = Exploration(literal).decide(figures)
    fires = figures.basis_size >= 1 and figures.replaced / CAPACITY > 0.6
    assert (decision is not None and decision.trigger is Trigger.NOVELTY) == fires


@given(some_figures())
def test_nothing_but_a_finished_path_counts_before_there_is_a_basis(figures):
    decision = exploration(minimum_basis=CAPACITY, maximum_interval_s=1.0, rho0=0.01).decide(figures)
    if figures.basis_size < CAPACITY:
        assert (decision is not None) == figures.path_finished


def test_rho_waits_until_there_are_cells_enough_for_a_fit():
    # Neighbouring basis vectors share cells. A re-estimate from 19 of them would keep the hyperparameters, and rho
    # would have to grow from nothing once more while the model made of the first readings goes on.
    assert exploration().decide(figures(25, 25, cells=19)) is None
    assert exploration().decide(figures(25, 25, cells=20)).trigger is Trigger.NOVELTY
    assert exploration(minimum_basis=50).decide(figures(60, 60, cells=20)).trigger is Trigger.NOVELTY
    assert exploration(minimum_basis=12).decide(figures(25, 25, cells=9)).trigger is Trigger.NOVELTY
    assert Exploration(PAPER).decide(figures(25, 25, cells=1)).trigger is Trigger.NOVELTY


def test_a_fit_waits_until_the_readings_are_of_enough_places():
    # A slow boat's readings of one stretch fill many cells, one after the other; what is fitted to them is too sure of
    # the rest of the sea.
    for places, expected in ((19, False), (20, True)):
        rule = exploration(maximum_interval_s=100.0)
        quiet = figures(60, cells=200, places=places)
        assert rule.decide(quiet) is None
        for news in ({"fresh": 60}, {"model_time_s": 101.0}):
            assert (rule.decide(dataclasses.replace(quiet, **news)) is not None) == expected
        assert rule.decide(dataclasses.replace(quiet, path_finished=True)).reestimate == expected


def test_the_threshold_itself_does_not_fire():
    rule = exploration(rho0=0.6, minimum_basis=30)
    assert rule.decide(figures(50, 30)) is None
    assert rule.decide(figures(50, 31)).reason == "rho 0.62 > 0.60"
    assert rule.decide(figures(29, 29)) is None


@pytest.mark.parametrize("reestimate", [True, False])
def test_a_finished_path(reestimate):
    decision = exploration(reestimate_on_path_end=reestimate).decide(figures(finished=True))
    assert (decision.trigger, decision.reestimate) == (Trigger.PATH_FINISHED, reestimate)


def test_novelty_is_the_stronger_reason():
    decision = exploration(reestimate_on_path_end=False).decide(figures(50, 50, finished=True))
    assert (decision.trigger, decision.reestimate) == (Trigger.NOVELTY, True)


def test_the_interval_counts_from_the_first_figures_and_then_from_each_reestimate():
    rule = exploration(maximum_interval_s=100.0)
    assert rule.decide(figures(time_s=5000.0)) is None
    assert rule.decide(figures(time_s=5100.0)) is None
    decision = rule.decide(figures(time_s=5100.5))
    assert (decision.trigger, decision.reestimate) == (Trigger.MAXIMUM_INTERVAL, True)
    rule.reestimated(5101.0, cells=0)
    assert rule.decide(figures(time_s=5200.0)) is None
    assert rule.decide(figures(time_s=5202.0)).trigger is Trigger.MAXIMUM_INTERVAL


def test_readings_that_vary_more_than_the_model_allows_bring_a_reestimate_once_in_a_doubling():
    rule = exploration()
    assert rule.decide(figures(cells=19, spread=50.0)) is None, "too few for a fit"
    assert rule.decide(figures(cells=20, spread=3.9)) is None
    assert rule.decide(figures(cells=20, spread=50.0)).trigger is Trigger.OUTGROWN
    rule.reestimated(1000.0, cells=20)
    assert rule.decide(figures(cells=39, spread=50.0)) is None
    assert rule.decide(figures(cells=40, spread=50.0)).reestimate


def test_no_interval_brings_a_reestimate_that_could_fit_nothing():
    # Readings that are dense for their cells: a missed fit would cost another interval.
    for cells, expected in ((19, None), (20, Trigger.MAXIMUM_INTERVAL)):
        rule = exploration(maximum_interval_s=100.0)
        rule.decide(figures(basis_size=25, cells=cells))
        decision = rule.decide(figures(time_s=101.0, basis_size=25, cells=cells))
        assert (decision and decision.trigger) == expected
    sooner = exploration(maximum_interval_s=100.0, minimum_basis=5)
    sooner.decide(figures(basis_size=6, cells=6))
    assert sooner.decide(figures(time_s=101.0, basis_size=6, cells=6)).trigger is Trigger.MAXIMUM_INTERVAL


def test_the_interval_counts_as_soon_as_the_basis_or_the_history_has_grown():
    for cells, expected in ((29, None), (30, Trigger.MAXIMUM_INTERVAL)):
        rule = exploration(maximum_interval_s=100.0, minimum_basis=30)
        rule.decide(figures(basis_size=4, cells=cells))
        decision = rule.decide(figures(time_s=101.0, basis_size=4, cells=cells))
        assert (decision and decision.trigger) == expected
