"""Tours against brute force, against an integer programme, and on awkward inputs."""

from itertools import pairwise, permutations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

from autonomy.planning.tour import EXACT_UP_TO, closed_tour, open_tour

Matrix = NDArray[np.float64]


def length(D: Matrix, order: tuple[int, ...]) -> float:
    return float(sum(D[a, b] for a, b in pairwise(order)))


def euclidean(rng: np.random.Generator, n: int) -> Matrix:
    points = rng.random((n, 2))
    return np.asarray(np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)))


def asymmetric(rng: np.random.Generator, n: int) -> Matrix:
    """A current: going one way costs up to twice the other."""
    points = rng.random((n, 2))
    step = points[None] - points[:, None]
    distance = np.hypot(step[..., 0], step[..., 1])
    return np.asarray(distance * (1.0 + 0.33 * step[..., 0] / np.where(distance == 0, 1, distance)))


def gyre(rng: np.random.Generator, n: int) -> Matrix:
    """Hours at speed 1 through water that turns round the middle at up to 0.6: a round one way is the shorter."""
    points = rng.random((n, 2))
    step = points[None] - points[:, None]
    middle = 0.5 * (points[None] + points[:, None]) - 0.5
    distance = np.hypot(step[..., 0], step[..., 1])
    along = (step[..., 0] * -middle[..., 1] + step[..., 1] * middle[..., 0]) / np.where(
        distance == 0, 1, distance
    )
    return np.asarray(distance / (1.0 + 0.85 * along))


def round_length(D: Matrix, order: tuple[int, ...]) -> float:
    return length(D, (*order, order[0]))


def as_open(D: Matrix) -> Matrix:
    """The round as a path that ends in a second copy of node 0, so dear to leave that it can only be the last."""
    n = len(D)
    copied = np.full((n + 1, n + 1), 1e3)
    copied[:n, :n], copied[:n, n] = D, D[:, 0]
    return copied


def brute_force(D: Matrix, start: int) -> float:
    others = np.array(list(permutations([k for k in range(len(D)) if k != start])), dtype=int)
    orders = np.concatenate([np.full((len(others), 1), start), others], axis=1)
    return float(D[orders[:, :-1], orders[:, 1:]].sum(axis=1).min())


def milp_optimum(D: Matrix, start: int) -> float:
    """Open path as directed arcs; subtours are cut off as they appear."""
    n = len(D)
    arcs = [(a, b) for a in range(n) for b in range(n) if a != b and b != start]
    tail, head = np.array(arcs).T
    cost = D[tail, head]
    enter = np.array([(head == b) for b in range(n) if b != start], dtype=float)
    leave = np.array([(tail == a) for a in range(n)], dtype=float)
    at_least = np.array([float(a == start) for a in range(n)])
    constraints = [LinearConstraint(enter, 1, 1), LinearConstraint(leave, at_least, 1)]
    while True:
        result = milp(cost, constraints=constraints, integrality=np.ones(len(arcs)), bounds=Bounds(0, 1))
        assert result.success
        successor = {int(tail[k]): int(head[k]) for k in np.flatnonzero(result.x > 0.5)}
        loops = _loops(successor, start)
        if not loops:
            return float(result.fun)
        for loop in loops:
            inside = np.isin(tail, loop) & np.isin(head, loop)
            constraints.append(LinearConstraint(inside.astype(float)[None], 0, len(loop) - 1))


def _loops(successor: dict[int, int], start: int) -> list[list[int]]:
    seen, node = {start}, start
    while node in successor:
        node = successor[node]
        seen.add(node)
    loops = []
    for first in successor:
        if first in seen:
            continue
        loop, node = [], first
        while node not in seen:
            seen.add(node)
            loop.append(node)
            node = successor[node]
        loops.append(loop)
    return loops


@pytest.mark.parametrize("make", [euclidean, asymmetric])
@pytest.mark.parametrize("n", [2, 3, 5, 8, 9])
def test_small_tours_equal_brute_force(make, n):
    rng = np.random.default_rng(n)
    for start in (0, n - 1):
        D = make(rng, n)
        order = open_tour(D, start)
        assert order[0] == start
        assert sorted(order) == list(range(n))
        assert length(D, order) == pytest.approx(brute_force(D, start), abs=1e-12)


@pytest.mark.parametrize("make", [euclidean, asymmetric])
@pytest.mark.parametrize("n", [10, 11, 12, 13])
def test_tours_up_to_the_exact_limit_equal_the_integer_programme(make, n):
    assert n <= EXACT_UP_TO
    D = make(np.random.default_rng(100 + n), n)
    assert length(D, open_tour(D, 3)) == pytest.approx(milp_optimum(D, 3), abs=1e-9)


@pytest.mark.parametrize(
    ("make", "slack"), [(euclidean, 0.005), (asymmetric, 0.005), (gyre, 0.01)], ids=["still", "drift", "gyre"]
)
@pytest.mark.parametrize("n", [20, 30, 40])
def test_larger_tours_come_close_to_the_integer_programme(make, slack, n):
    D = make(np.random.default_rng(200 + n), n)
    order = open_tour(D, 1)
    assert sorted(order) == list(range(n))
    assert length(D, order) <= (1.0 + slack) * milp_optimum(D, 1)
    order = closed_tour(D, 0)
    assert sorted(order) == list(range(n))
    assert round_length(D, order) <= (1.0 + slack) * milp_optimum(as_open(D), 0)


@pytest.mark.parametrize("make", [euclidean, gyre])
@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_small_rounds_equal_brute_force(make, n):
    D = make(np.random.default_rng(n), n)
    for start in (0, n - 1):
        order = closed_tour(D, start)
        assert order[0] == start
        assert sorted(order) == list(range(n))
        assert round_length(D, order) == pytest.approx(
            min(round_length(D, (0, *others)) for others in permutations(range(1, n))), abs=1e-12
        )


@pytest.mark.parametrize("n", [11, 13])
def test_rounds_up_to_the_exact_limit_equal_the_integer_programme(n):
    D = gyre(np.random.default_rng(300 + n), n)
    assert round_length(D, closed_tour(D)) == pytest.approx(milp_optimum(as_open(D), 0), abs=1e-9)


def test_a_round_of_many_nodes_is_close_to_the_shortest():
    """Round a lattice of even sides the shortest is as long as there are nodes."""
    axis = np.arange(12.0)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    D = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    assert round_length(D, closed_tour(D)) <= 1.03 * 144.0


def test_a_round_that_cannot_return_is_none():
    D = np.full((4, 4), np.inf)
    for a, b in [(0, 1), (1, 2), (2, 3)]:
        D[a, b] = 1.0
    assert open_tour(D, 0) == (0, 1, 2, 3)
    with pytest.raises(ValueError, match="no tour"):
        closed_tour(D, 0)
    D[3, 0] = 1.0
    assert closed_tour(D, 2) == (2, 3, 0, 1)


def test_the_integer_programme_itself_equals_brute_force():
    D = asymmetric(np.random.default_rng(7), 8)
    assert milp_optimum(D, 2) == pytest.approx(brute_force(D, 2), abs=1e-9)


def test_a_single_node_is_its_own_tour():
    assert open_tour([[0.0]], 0) == (0,)
    assert closed_tour([[0.0]]) == (0,)


@pytest.mark.parametrize("copies", [2, 4])
def test_duplicates_are_all_visited_at_no_cost(copies):
    rng = np.random.default_rng(5)
    D = euclidean(rng, 6)
    many = np.repeat(np.repeat(D, copies, axis=0), copies, axis=1)
    order = open_tour(many, 0)
    assert sorted(order) == list(range(6 * copies))
    assert length(many, order) == pytest.approx(brute_force(D, 0), abs=1e-9)


def test_all_nodes_in_one_place():
    assert sorted(open_tour(np.zeros((20, 20)), 4)) == list(range(20))


def test_a_one_way_street_is_respected():
    D = np.full((5, 5), np.inf)
    for a, b in [(2, 0), (0, 4), (4, 1), (1, 3)]:
        D[a, b] = 1.0
    assert open_tour(D, 2) == (2, 0, 4, 1, 3)


@pytest.mark.parametrize("n", [6, 20])
def test_an_unreachable_node_is_named(n):
    D = euclidean(np.random.default_rng(1), n)
    D[:, 5] = D[5, :] = np.inf
    with pytest.raises(ValueError, match="no way leads to node 5"):
        open_tour(D, 0)


@pytest.mark.parametrize("n", [6, 20])
def test_two_separate_seas_have_no_tour(n):
    D = euclidean(np.random.default_rng(1), n)
    D[: n // 2, n // 2 :] = D[n // 2 :, : n // 2] = np.inf
    with pytest.raises(ValueError, match="no tour"):
        open_tour(D, 0)


@pytest.mark.parametrize(
    ("distances", "start", "message"),
    [
        (np.zeros((2, 3)), 0, "square"),
        (np.zeros((0, 0)), 0, "square"),
        (np.zeros((3, 3)), 3, "start"),
        (np.zeros((3, 3)), -1, "start"),
        (np.full((3, 3), np.nan), 0, "numbers"),
        (np.full((3, 3), -1.0), 0, "not negative"),
    ],
)
def test_nonsense_is_refused(distances, start, message):
    with pytest.raises(ValueError, match=message):
        open_tour(distances, start)


def test_the_diagonal_is_ignored_and_the_input_left_alone():
    D = euclidean(np.random.default_rng(3), 7)
    with_diagonal = D + np.diag(np.full(7, np.inf))
    before = with_diagonal.copy()
    assert open_tour(with_diagonal, 0) == open_tour(D, 0)
    assert np.array_equal(with_diagonal, before)


def test_the_same_seed_gives_the_same_tour():
    D = asymmetric(np.random.default_rng(11), 25)
    assert open_tour(D, 0, seed=3) == open_tour(D, 0, seed=3)
