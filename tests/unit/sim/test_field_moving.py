"""The moving sea as a field: a coast that nothing crosses, water that obeys its current, and no surprises."""

import math

import numpy as np
import pytest

from sim.currents import StreamFunction
from sim.field import Field, lattice, open_field, shrunk
from sim.synthetic import MOVING_CELL_M, MOVING_SPEEDS, moving_patch
from sim.vessel import SummedCurrent, UniformCurrent

HOUR_S = 3600.0


@pytest.fixture(scope="module")
def sea() -> Field:
    return moving_patch(3)


@pytest.fixture(scope="module")
def current() -> StreamFunction:
    return moving_patch(3)._current


def test_the_same_seed_gives_the_same_sea_whatever_was_asked_before(sea: Field) -> None:
    axes = lattice(sea, 500.0)
    late, early = 9.3 * HOUR_S, 1.1 * HOUR_S
    forwards = [sea.grid(*axes, time) for time in (early, late)]
    other = open_field("synthetic-moving:3")
    backwards = [other.grid(*axes, time) for time in (late, early)]
    assert np.array_equal(forwards[0], backwards[1], equal_nan=True)
    assert np.array_equal(forwards[1], backwards[0], equal_nan=True)
    different = open_field("synthetic-moving:4").grid(*axes, early)
    assert np.nanstd(different - forwards[0]) > 0.03


def test_it_moves_and_stays_a_sea(sea: Field) -> None:
    axes = lattice(sea, 300.0)
    start = sea.grid(*axes, 0.0)
    lat, lon = np.meshgrid(*axes, indexing="ij")
    assert np.array_equal(np.isnan(start), sea.is_land(lat, lon))
    for hours, least in ((6.0, 0.1), (48.0, 0.4)):
        later = sea.grid(*axes, hours * HOUR_S)
        changed = math.sqrt(np.nanmean((later - start) ** 2)) / np.nanstd(start)
        assert least < changed < 1.5
        assert 32.5 < np.nanmin(later) < np.nanmax(later) < 34.5
        assert 0.06 < np.nanstd(later) < 0.3
    np.testing.assert_array_equal(sea.grid(*axes, -5.0), start)


def test_between_two_frames_it_is_linear_in_time(sea: Field) -> None:
    lat, lon = np.array([33.95, 33.97]), np.array([-118.80, -118.84])
    a, b, c = (sea.value(lat, lon, time) for time in (1200.0, 1500.0, 1800.0))
    np.testing.assert_allclose(b, 0.5 * (a + c), atol=1e-12)


def test_nothing_flows_through_the_shore_and_nothing_is_lost(current: StreamFunction, sea: Field) -> None:
    land = sea.mask.land
    for time_s in (0.0, 5.0 * HOUR_S, 1e6):
        flow = current.flow(time_s)
        wall = np.pad(land, ((0, 0), (1, 1)), mode="edge")
        assert np.all(flow.east[wall[:, :-1] | wall[:, 1:]] == 0.0)
        wall = np.pad(land, ((1, 1), (0, 0)), mode="edge")
        assert np.all(flow.north[wall[:-1, :] | wall[1:, :]] == 0.0)
        gained = np.diff(flow.east, axis=1) + np.diff(flow.north, axis=0)
        assert np.abs(gained).max() < 1e-9 * flow.largest


def test_the_coastal_flow_has_its_speed_offshore_and_hastens_round_the_headland(
    current: StreamFunction,
) -> None:
    along = current.psi.patterns[0] / MOVING_CELL_M
    offshore = -np.diff(along[:40, 20:80], axis=0)
    assert np.abs(offshore - 1.0).max() < 0.5
    # Without whirls: the mean of the four neighbours, wherever none of them is fixed.
    inner = along[5:40, 5:95]
    neighbours = along[4:39, 5:95] + along[6:41, 5:95] + along[5:40, 4:94] + along[5:40, 6:96]
    np.testing.assert_allclose(inner, neighbours / 4.0, atol=1e-9)
    north_of_the_open_edge = np.abs(np.diff(along, axis=0)).max(axis=0)
    assert north_of_the_open_edge[35:50].max() > 1.3


def test_the_eddies_have_their_speed(current: StreamFunction) -> None:
    speeds = []
    for time_s in np.arange(40) * 10.0 * 86_400.0:
        weights = current.psi.weights(time_s)
        weights[:2] = 0.0
        psi = np.tensordot(weights, current.psi.patterns, axes=1)
        # Where they have not faded: more than 3 km from the shore.
        speeds.append(np.diff(psi[:40], axis=1).std() / MOVING_CELL_M)
    # 24 waves of random length: their mean square speed scatters by about a quarter from seed to seed.
    assert np.mean(speeds) == pytest.approx(MOVING_SPEEDS.eddy_mps, rel=0.4)


def test_the_water_carries_the_boat_as_it_carries_the_tracer(sea: Field, current: StreamFunction) -> None:
    time_s = 4.0 * HOUR_S
    from_start_s = time_s + sea._spun_up * 600.0  # type: ignore[attr-defined]
    flow = current.flow(from_start_s)
    for row, column in ((10, 50), (40, 70), (55, 20)):
        lat, lon = sea.mask.grid.positions(float(row), float(column))
        east, north = sea.current(float(lat), float(lon), time_s)
        assert east == pytest.approx(flow.east[row, column : column + 2].mean() / MOVING_CELL_M, abs=1e-9)
        assert north == pytest.approx(flow.north[row : row + 2, column].mean() / MOVING_CELL_M, abs=1e-9)
        assert 0.0 < math.hypot(east, north) < 0.4
    assert sea.current(34.03, -118.80, time_s) == (0.0, 0.0)  # on land
    assert sea.current(10.0, 0.0, time_s) == (0.0, 0.0)  # elsewhere on the globe


def test_a_boat_adrift_never_reaches_the_shore_between_whole_cells(
    current: StreamFunction, sea: Field
) -> None:
    """What normal flow a side has, a boat beside it has: beside land none."""
    land = sea.mask.land
    rows, columns = np.nonzero(~land[:-1] & land[1:])
    for row, column in list(zip(rows, columns, strict=True))[::5]:
        assert current.velocity(row + 0.4999999, column + 0.1, 7200.0)[1] == pytest.approx(0.0, abs=1e-6)


def test_currents_add_up_and_shrink_with_the_sea(sea: Field) -> None:
    place = 33.95, -118.80
    east, north = sea.current(*place, 0.0)
    together = SummedCurrent((sea, UniformCurrent(0.1, -0.2))).current(*place, 0.0)
    assert together == pytest.approx((east + 0.1, north - 0.2))
    small = shrunk(sea, 5000.0)
    lat0, lon0 = sea.bounds.centre
    nearer = lat0 + (place[0] - lat0) / 3.0, lon0 + (place[1] - lon0) / 3.0
    assert small.current(*nearer, 0.0) == pytest.approx((east / 3.0, north / 3.0), rel=1e-6)
    assert open_field("synthetic-patch").current(*place, 0.0) == (0.0, 0.0)


def test_many_days_are_kept_in_little_memory_and_any_of_them_can_be_asked_again() -> None:
    sea = moving_patch(5)
    sea._stride = 2  # as if a hundred times as many days had passed
    where = 33.95, -118.80
    first = [float(sea.value(*where, hours * HOUR_S)) for hours in (1.0, 30.0)]
    assert len(sea._checkpoints) <= 200
    assert len(sea._recent) <= 16
    assert [float(sea.value(*where, hours * HOUR_S)) for hours in (1.0, 30.0)] == first


def test_there_is_no_last_instant(sea: Field) -> None:
    assert sea.times_s == (0.0, math.inf)
    with pytest.raises(ValueError, match="time must be finite"):
        sea.value(33.95, -118.80, math.inf)
