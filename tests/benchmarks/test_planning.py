"""Speed of the planner's parts as ratios against references measured in the same run."""

import timeit

import numpy as np
import pytest
import shapely
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import box

from autonomy.geometry import LocalFrame
from autonomy.planning.passage import Passage
from autonomy.planning.selection import select_by_dynamic_programming
from autonomy.planning.survey import SurveyArea
from autonomy.planning.tour import open_tour


def seconds(function, repeat=5):
    """The best of several runs: what the work takes when nobody else wants the core."""
    return min(timeit.repeat(function, number=1, repeat=repeat))


@pytest.fixture
def report(capsys):
    def say(text):
        with capsys.disabled():
            print(f"\n{text}")

    return say


def lattice(side, lengthscale=1.5, noise=0.05):
    axis = np.arange(float(side))
    sites = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    squared = np.sum((sites[:, None] - sites[None]) ** 2, axis=-1)
    return np.exp(-0.5 * squared / lengthscale**2) + noise * np.eye(side**2)


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


def extrapolated(S, n, increment, rng, sample=20):
    """Seconds of the whole literal programme: its number of increments times their cost, stage by stage."""
    N, total = len(S), 0.0
    for i in range(n):
        paths = [rng.choice(N, i + 1, replace=False) for _ in range(sample)]
        spent = seconds(lambda: [increment(S, int(p[0]), p[1:]) for p in paths], repeat=2) / sample  # noqa: B023
        # Stage 1 has N increments; a later one N (N − i): every last site, every predecessor not on its path.
        total += spent * (N if i == 0 else N * (N - i))
    return total


def test_the_dynamic_programme_against_the_literal_one_in_full_on_a_small_lattice(report):
    S, n = lattice(5), 6
    literal = seconds(lambda: literal_programme(S, n, literal_increment), repeat=1)
    ours = seconds(lambda: select_by_dynamic_programming(S, n))
    guess = extrapolated(S, n, literal_increment, np.random.default_rng(0))
    gap = abs(select_by_dynamic_programming(S, n).objective - literal_programme(S, n, literal_increment))
    report(
        f"5 × 5, n = 6: {ours * 1e3:.2f} ms, literal {literal:.2f} s (extrapolation says {guess:.2f} s) = "
        f"1/{literal / ours:.0f}; values differ by {gap:.1e}"
    )


def test_the_dynamic_programme_against_the_literal_one_at_the_papers_size(report):
    S, n = lattice(12), 20
    ours = seconds(lambda: select_by_dynamic_programming(S, n))
    rng = np.random.default_rng(0)
    literal = extrapolated(S, n, literal_increment, rng)
    table = -np.log(np.diag(np.linalg.inv(S)))
    frugal = extrapolated(S, n, lambda S, x, path: frugal_increment(S, x, path, table), rng)
    report(
        f"12 × 12, n = 20: {ours * 1e3:.0f} ms; literal, extrapolated: {literal:.0f} s "
        f"= 1/{literal / ours:.0f}; with two small determinants each {frugal:.1f} s = 1/{frugal / ours:.0f}"
    )


@pytest.mark.parametrize("n", [13, 21, 41])
def test_a_tour_against_its_distance_matrix(n, report):
    points = np.random.default_rng(n).random((n, 2))
    D = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    spent = seconds(lambda: open_tour(D, 0), repeat=3)
    reference = seconds(lambda: D @ D @ D, repeat=20)
    report(
        f"open tour through {n} nodes: {spent * 1e3:.0f} ms = {spent / reference:.0f} × two matrix products"
    )


def test_ways_between_the_spots_of_a_plan_against_dijkstra_alone(report):
    rng = np.random.default_rng(1)
    islands = [
        shapely.Point(*rng.uniform(1000, 14_000, 2)).buffer(rng.uniform(100, 1500), 64) for _ in range(25)
    ]
    land = shapely.union_all(islands)
    survey = SurveyArea.from_geometry(
        LocalFrame(33, -119), box(0, 0, 15_000, 15_000), land=land, standoff_m=60.0
    )
    built = seconds(lambda: Passage(survey), repeat=3)
    passage = Passage(survey)
    points = rng.uniform(0, 15_000, (60, 2))
    points = points[survey.is_navigable(points)]
    points = points[passage.reachable(points[0], points)][:21]
    assert len(points) == 21
    spent = seconds(lambda: passage.ways(points), repeat=3)
    graph, cells = passage.raster.graph(), passage.raster.numbers_at(points)
    reference = seconds(lambda: dijkstra(graph, indices=cells[cells >= 0]), repeat=3)
    report(
        f"raster of 200 × 200 and its graph: {built * 1e3:.0f} ms; all ways between 21 points: "
        f"{spent * 1e3:.0f} ms = {spent / reference:.1f} × Dijkstra from all ({reference * 1e3:.0f} ms)"
    )
