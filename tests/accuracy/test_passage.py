"""Ways over water on real coasts: no leg touches land or stand-off, and how much longer they are than need be.

The short form takes some hundred pairs of two coasts; HALOCLINE_ACCURACY=long over ten thousand of each of three,
with and without a stand-off. Truths are exact and share no code with the planner: see visibility.py.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from forms import LONG, Say
from numpy.typing import NDArray
from scipy import ndimage
from visibility import FloatArray, Shore, VisibilityGraph

from autonomy.geometry import LocalFrame
from autonomy.planning.passage import Passage, Ways
from autonomy.planning.survey import SurveyArea
from sim.field import open_field
from sim.land import land_polygons, water_outline

POINTS = 46
"""In a set, which has 1035 pairs."""
SETS = 10 if LONG else 1
FILES = {
    "sst": "scb_mur_sst_7dates_240x435.nc",
    "ucla": "ucla_roms_point_conception_joined_101x201.nc",
}
CASES = [(coast, standoff_m) for coast in ("bight", "sst", "ucla") for standoff_m in (0.0, 300.0)]
CASES = CASES if LONG else [("bight", 0.0), ("ucla", 300.0)]


@dataclass(frozen=True)
class Coast:
    """`land` is what the file of land says, without any stand-off, in local metres."""

    survey: SurveyArea
    land: shapely.Geometry

    @classmethod
    def named(cls, name: str, standoff_m: float, request: pytest.FixtureRequest) -> "Coast":
        """`bight` needs no file: it is the simulator's Southern California."""
        if name == "bight":
            field = open_field("synthetic")
        else:
            directory: Path = request.getfixturevalue("real_data_dir")
            field = open_field(directory / FILES[name])
        outline, land = water_outline(field), land_polygons(field)
        west, south, east, north = outline.bounds
        frame = LocalFrame((south + north) / 2, (west + east) / 2)

        def to_metres(degrees: FloatArray) -> FloatArray:
            return frame.to_local(degrees[:, 1], degrees[:, 0])

        metres = shapely.make_valid(shapely.transform(land, to_metres))
        area = shapely.transform(outline, to_metres)
        return cls(SurveyArea.from_geometry(frame, area, land=metres, standoff_m=standoff_m), metres)

    def points(self, count: int, rng: np.random.Generator) -> FloatArray:
        x_min, y_min, x_max, y_max = self.survey.bounds
        points = rng.uniform([x_min, y_min], [x_max, y_max], (20 * count, 2))
        return points[self.survey.is_navigable(points)][:count]


def legs_of(ways: Ways) -> tuple[FloatArray, FloatArray]:
    i, j = np.nonzero(np.triu(np.isfinite(ways.distances_m), 1))
    paths = [ways.path(a, b) for a, b in zip(i.tolist(), j.tolist(), strict=True)]
    legs = [(p, q) for path in paths for p, q in pairwise(path)]
    starts, ends = np.unique(np.array(legs), axis=0).transpose(1, 0, 2)
    return starts, ends


@pytest.mark.timeout(7200 if LONG else 120)
@pytest.mark.parametrize(("name", "standoff_m"), CASES)
def test_ways_are_clear_and_hardly_longer_than_the_shortest(
    name: str, standoff_m: float, request: pytest.FixtureRequest, say: Say
) -> None:
    coast = Coast.named(name, standoff_m, request)
    passage, graph, shore = (
        Passage(coast.survey),
        VisibilityGraph(coast.survey.navigable),
        Shore.of(coast.land),
    )
    ratios, clearance, missed = [], [], 0
    for seed in range(SETS):
        points = coast.points(POINTS, np.random.default_rng(seed))
        ways = passage.ways(points)
        shortest, found = graph.distances(points), ways.distances_m
        pairs = np.triu(np.ones_like(found, dtype=bool), 1)
        there = pairs & np.isfinite(found)
        assert np.isfinite(shortest[there]).all(), "a way was found where there is none"
        missed += int(np.count_nonzero(pairs & np.isfinite(shortest) & ~there))
        ratios.append(found[there] / shortest[there])
        starts, ends = legs_of(ways)
        assert not shore.contains(starts).any()
        clearance.append(shore.clearance(starts, ends, standoff_m + 1.0))
    ratio, least = np.concatenate(ratios), np.concatenate(clearance).min()
    say(
        f"{name}, stand-off {standoff_m:g} m: {len(ratio)} pairs, {missed} not found, length × {ratio.mean():.4f} on "
        f"average, {np.count_nonzero(ratio > 1 + 1e-9)} round land × {ratio[ratio > 1 + 1e-9].mean():.4f}, worst "
        f"{ratio.max():.4f}; least distance from land {least:.3f} m"
    )
    # A leg may leave the water by a millimetre; without a stand-off it must not so much as touch land.
    assert least > max(0.0, standoff_m - 2e-3)
    # The truth may cut a millimetre at every corner.
    assert ratio.min() >= 1 - 1e-6
    assert ratio.mean() <= 1.03
    assert ratio.max() <= 1.06
    assert missed <= 0.01 * len(ratio)


def chequered_sea(rng: np.random.Generator, side: int) -> NDArray[np.bool_]:
    """Land cells: blobs, single rocks, lakes of one cell, and rocks that touch at corners only."""
    land = ndimage.gaussian_filter(rng.normal(size=(side, side)), 2.5) > 0.03
    single = rng.random((side, side))
    land[single < 0.02] = True
    land[single > 0.97] = False
    for row, column in rng.integers(1, side - 3, (12, 2)):
        land[row : row + 2, column : column + 2] = [[True, False], [False, True]]
    return land


def diagonal_gaps(land: NDArray[np.bool_]) -> FloatArray:
    """Corners, in cells, at which two cells of land meet and nothing else, (n, 2)."""
    a, b, c, d = land[:-1, :-1], land[:-1, 1:], land[1:, :-1], land[1:, 1:]
    row, column = np.nonzero((a == d) & (b == c) & (a != b))
    return np.stack([column + 1.0, row + 1.0], axis=-1)


def squares(land: NDArray[np.bool_], cell_m: float) -> shapely.Geometry:
    row, column = np.nonzero(land)
    x, y = column * cell_m, row * cell_m
    return shapely.union_all(shapely.box(x, y, x + cell_m, y + cell_m))


@pytest.mark.timeout(7200 if LONG else 120)
@pytest.mark.parametrize("passage_cells", [40, 57, 80])
def test_islands_and_cut_off_lakes_are_never_targets(passage_cells: int, say: Say) -> None:
    """Cells of a mask that is its own truth: water is connected through sides of cells, never through corners."""
    side, cell_m, targets, possible = 40, 100.0, 0, 0
    for seed in range(100 if LONG else 4):
        rng = np.random.default_rng(seed)
        land = chequered_sea(rng, side)
        basin, _ = ndimage.label(~land)
        size = side * cell_m
        survey = SurveyArea.from_geometry(
            LocalFrame(33.0, -119.0),
            shapely.box(0, 0, size, size),
            land=squares(land, cell_m),
            passage_cells=passage_cells,
        )
        passage = Passage(survey)
        sites = survey.candidate_sites(side, side)
        column, row = (sites // cell_m).astype(int).T
        assert not land[row, column].any()
        largest = np.flatnonzero(basin[row, column] == np.argmax(np.bincount(basin.ravel())[1:]) + 1)
        start = sites[largest[int(rng.integers(len(largest)))]]
        reached = passage.reachable(start, sites)
        home = basin[int(start[1] // cell_m), int(start[0] // cell_m)]
        assert np.all(basin[row[reached], column[reached]] == home)
        targets, possible = targets + np.count_nonzero(reached), possible + len(largest)
        few = sites[reached][rng.choice(np.count_nonzero(reached), 25)]
        starts, ends = legs_of(passage.ways(np.unique(few, axis=0)))
        # Between cells' centres legs run through corners of single rocks to the bit: let them, but no further.
        assert Shore.of(survey.obstacles.buffer(-2e-3)).clearance(starts, ends, 1.0).min() > 0.0
        gaps = cell_m * diagonal_gaps(land)
        assert len(gaps) >= 12
        assert Shore(gaps, gaps).clearance(starts, ends, 1.0).min() > 5e-3
    say(f"{passage_cells} cells: {targets} sites reached of {possible} in the same water")
