"""Speed of the planner's parts: ratios against a literal or plainer way, in the same run."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import box

from autonomy.geometry import LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.planning.exchange import select_by_exchange
from autonomy.planning.information import measurement_covariance, mutual_information, precision
from autonomy.planning.passage import Passage
from autonomy.planning.planners.paper import plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.selection import select_by_dynamic_programming, select_greedily
from autonomy.planning.survey import SurveyArea
from autonomy.planning.sweeps import lawnmowers
from autonomy.planning.tour import closed_tour, open_tour

sys.path.insert(0, str(Path(__file__).parent))
from waters import archipelago, distances, lattice, nearest_neighbour


def log_determinant(S, sites):
    return np.linalg.slogdet(S[np.ix_(sites, sites)])[1] if len(sites) else 0.0


def literal_increment(S, x, path):
    """The entropies of the paper: ½ (log|S_{x,path}| − log|S_path| − log|S| + log|S_{X∖x}|)."""
    path = np.asarray(path, dtype=int)
    everything = np.arange(len(S))
    given_path = log_determinant(S, np.append(path, x)) - log_determinant(S, path)
    return 0.5 * (
        given_path - log_determinant(S, everything) + log_determinant(S, everything[everything != x])
    )


def frugal_increment(S, x, path, given_all):
    """The same with the entropy given all other sites taken from a table: two small determinants."""
    path = np.asarray(path, dtype=int)
    return 0.5 * (log_determinant(S, np.append(path, x)) - log_determinant(S, path) - given_all[x])


def literal_programme(S, n, increment):
    paths = {x: ([x], increment(S, x, [])) for x in range(len(S))}
    for _ in range(1, n):
        longer = {}
        for x in range(len(S)):
            ways = [(v + increment(S, x, path), path) for path, v in paths.values() if x not in path]
            if ways:
                # Ties go to the first, as in the fast programme: a lattice is full of them.
                best = max(value for value, _ in ways)
                value, path = next(way for way in ways if way[0] >= best - 1e-11)
                longer[x] = ([*path, x], value)
        paths = longer
    return max(value for _, value in paths.values())


def extrapolated(seconds, S, n, increment, rng, sample=20):
    """Seconds of the whole literal programme: its number of increments times their cost, stage by stage."""
    N, total = len(S), 0.0
    for i in range(n):
        paths = [rng.choice(N, i + 1, replace=False) for _ in range(sample)]
        spent = seconds(lambda: [increment(S, int(p[0]), p[1:]) for p in paths], 2) / sample  # noqa: B023
        # Stage 1 has N increments; a later one N (N − i): every last site, every predecessor not on its path.
        total += spent * (N if i == 0 else N * (N - i))
    return total


def test_the_dynamic_programme_against_the_literal_one_in_full_on_a_small_lattice(report, seconds):
    S, n = lattice(5), 6
    literal = seconds(lambda: literal_programme(S, n, literal_increment), 1)
    ours = seconds(lambda: select_by_dynamic_programming(S, n))
    guess = extrapolated(seconds, S, n, literal_increment, np.random.default_rng(0))
    gap = abs(select_by_dynamic_programming(S, n).objective - literal_programme(S, n, literal_increment))
    note = f"extrapolation would say {guess:.2g} s; values differ by {gap:.0e}"
    report("dynamic programme, 5 × 5, n = 6", ours, "the literal one in full", literal, note)


def test_the_dynamic_programme_against_the_literal_one_at_the_papers_size(report, seconds):
    S, n = lattice(12), 20
    ours = seconds(lambda: select_by_dynamic_programming(S, n))
    rng = np.random.default_rng(0)
    report(
        "dynamic programme, 12 × 12, n = 20",
        ours,
        "the literal one, extrapolated",
        extrapolated(seconds, S, n, literal_increment, rng),
    )
    table = -np.log(np.diag(np.linalg.inv(S)))
    frugal = extrapolated(seconds, S, n, lambda S, x, path: frugal_increment(S, x, path, table), rng)
    report("dynamic programme, the same", ours, "that with two small determinants each", frugal)


def test_the_mutual_information_of_a_plan(report, seconds):
    S, sites = lattice(12), list(range(0, 140, 7))
    report(
        "mutual information of 20 of 144 sites",
        seconds(lambda: mutual_information(S, sites), 7, 5),
        "inverting S",
        seconds(lambda: np.linalg.inv(S), 7, 5),
    )


@pytest.mark.parametrize(("side", "n", "scale"), [(30, 40, 3.0), (50, 50, 4.0)])
def test_sets_refined_by_exchange(side, n, scale, report, seconds):
    S, repeat = lattice(side, scale), 2
    inverse = seconds(lambda: precision(S), repeat)
    greedy, ours = select_greedily(S, n), select_by_exchange(S, n)
    report(
        f"exchange, {side} × {side}, n = {n}",
        seconds(lambda: select_by_exchange(S, n), repeat),
        "the inverse",
        inverse,
        f"I = {ours.mutual_information:.3f}, greedy {greedy.mutual_information:.3f}",
    )
    alone = seconds(lambda: select_greedily(S, n), repeat)
    report(f"greedy alone, {side} × {side}, n = {n}", alone, "the inverse", inverse)


@pytest.mark.parametrize("n", [41, 101, 301])
def test_a_round(n, report, seconds):
    D = distances(n)
    ours, plain = closed_tour(D), nearest_neighbour(D)
    shorter = 1.0 - length(D, [*ours, ours[0]]) / length(D, [*plain, plain[0]])
    report(
        f"closed tour of {n} nodes",
        seconds(lambda: closed_tour(D), 1),
        "nearest neighbour",
        seconds(lambda: nearest_neighbour(D), 3, 5),
        f"{shorter:.0%} shorter",
    )


@pytest.mark.parametrize("n", [13, 41])
def test_a_tour(n, report, seconds):
    D = distances(n)
    ours, plain = open_tour(D, 0), nearest_neighbour(D)
    shorter = 1.0 - length(D, ours) / length(D, plain)
    report(
        f"open tour through {n} nodes",
        seconds(lambda: open_tour(D, 0), 3),
        "nearest neighbour",
        seconds(lambda: nearest_neighbour(D), 5, 20),
        f"{shorter:.0%} shorter",
    )


def length(D, order):
    return float(sum(D[a, b] for a, b in pairwise(order)))


def test_the_raster(report, seconds):
    survey = archipelago(25)
    passage = Passage(survey)
    sites = passage.cells_of(survey.candidate_sites(12, 12)[:21])
    alone = seconds(lambda: dijkstra(passage.graph, indices=sites), 3)
    report(
        "raster of 200 × 200 and its graph", seconds(lambda: Passage(survey), 3), "Dijkstra from 21", alone
    )


def test_lawnmowers(report, seconds):
    start = archipelago(25).candidate_sites(12, 12)[0]
    built = seconds(lambda: Passage(archipelago(25)), 3)
    for islands, survey in (("no islands", open_water()), ("25 islands", archipelago(25))):
        length_m = 6.0 * survey.area_m2**0.5
        spent = seconds(lambda: lawnmowers(survey, start, length_m, nearest_corner=True), 1)  # noqa: B023
        report(f"two lawnmowers of six sides, {islands}", spent, "the raster", built)


def open_water():
    return SurveyArea.from_geometry(LocalFrame(33, -119), box(0, 0, 15_000, 15_000))


def test_a_whole_plan(report, seconds):
    survey = archipelago(25)
    model = FieldModel.prior(Hyperparameters(1.0, 0.01, (1500.0, 1500.0)))
    start = survey.candidate_sites(12, 12)[0]
    request = PlanRequest(model, start, 20, (12, 12), "benchmark", 0)
    made = plan(request, survey)
    S = measurement_covariance(model, survey.candidate_sites(12, 12))
    report(
        "a whole plan among 25 islands, n = 20",
        seconds(lambda: plan(request, survey), 3),
        "its dynamic programme",
        seconds(lambda: select_by_dynamic_programming(S, 20)),
        f"{len(made.route_m)} corners",
    )
