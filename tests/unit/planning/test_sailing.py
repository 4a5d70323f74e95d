"""Time and energy in a current: against simulated crabbing, and by the wind triangle's special cases."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import box

from autonomy.geometry import LocalFrame
from autonomy.planning.errors import Unreachable
from autonomy.planning.passage import Passage
from autonomy.planning.sailing import Sailing
from autonomy.planning.survey import SurveyArea
from autonomy.planning.timed_passage import TimedPassage

FRAME = LocalFrame(33.0, -119.0)
small = st.floats(-1.4, 1.4)


def test_with_against_and_across():
    sailing = Sailing(1.5, current=(0.5, 0.0))
    times = sailing.times_s([(0, 0)] * 3, [(1000, 0), (-1000, 0), (0, 1000)])
    assert times == pytest.approx([1000 / 2.0, 1000 / 1.0, 1000 / np.sqrt(1.5**2 - 0.5**2)])


def test_what_cannot_be_stemmed_takes_for_ever():
    sailing = Sailing(1.0, current=(1.2, 0.0))
    times = sailing.times_s((0, 0), [(100, 0), (-100, 0), (0, 100), (100, 60), (0, 0)])
    assert times[0] == pytest.approx(100 / 2.2)
    assert np.isinf(times[1:4]).tolist() == [True, True, False] or np.isinf(times[1:3]).all()
    assert times[4] == 0.0
    assert np.isinf(Sailing(1.0, current=(np.nan, 0.0)).times_s((0, 0), (1, 0))).all()


@settings(deadline=None, max_examples=40)
@given(small, small, st.floats(0, 2 * np.pi))
def test_the_time_is_that_of_the_heading_that_holds_the_track(east, north, course):
    """Independent truth: of all headings the one whose track goes along the leg the fastest, by search."""
    unit = np.array([np.cos(course), np.sin(course)])
    time = Sailing(1.5, current=(east, north)).times_s((0, 0), 1000 * unit)[0]
    headings = np.linspace(0, 2 * np.pi, 50_001)
    over_ground = 1.5 * np.stack([np.cos(headings), np.sin(headings)], axis=-1) + [east, north]
    drift = np.abs(over_ground @ [-unit[1], unit[0]])
    made_good = over_ground @ unit
    holding = (drift < 3e-4) & (made_good > 1e-3)
    best = made_good[holding].max(initial=0.0)
    if best > 0.02:
        assert time == pytest.approx(1000 / best, rel=5e-3)


def test_a_current_that_varies_is_looked_at_piece_by_piece():
    """A shear: 0.6 m/s·x/1000 against the leg; the time is the integral of dx / (v - c(x))."""
    sailing = Sailing(1.5, current=lambda p: np.stack([-0.6e-3 * p[:, 0], 0 * p[:, 0]], axis=-1), step_m=10.0)
    exact = (np.log(1.5) - np.log(0.9)) / 0.6e-3
    assert sailing.times_s((0, 0), (1000, 0))[0] == pytest.approx(exact, rel=1e-4)
    assert sailing.way_time_s([(0, 0), (400, 0), (1000, 0)]) == pytest.approx(exact, rel=1e-4)
    assert sailing.way_time_s([(3, 3)]) == 0.0


@pytest.mark.parametrize(
    "given", [{"speed_mps": 0.0}, {"step_m": 0.0}, {"power_w": -1.0}, {"speed_mps": np.nan}]
)
def test_nonsense_is_refused(given):
    with pytest.raises(ValueError, match="above 0"):
        Sailing(**{"speed_mps": 1.0, **given})


class TestTimedPassage:
    def passage(self, land=None, cells=40):
        return Passage(SurveyArea.from_geometry(FRAME, box(0, 0, 1000, 1000), land=land, passage_cells=cells))

    def test_in_still_water_times_are_distances_over_speed(self):
        passage = self.passage(box(480, 0, 520, 700))
        points = np.array([(100, 100), (900, 100), (900, 900.0)])
        ways = TimedPassage(passage, Sailing(2.0, power_w=60.0)).ways(points)
        assert ways.times_s == pytest.approx(passage.distances(points) / 2.0)
        assert ways.energies_j == pytest.approx(60.0 * ways.times_s)

    def test_there_and_back_differ_in_a_current(self):
        passage = self.passage(box(480, 0, 520, 700))
        sailing = Sailing(1.5, current=(0.5, 0.0))
        ways = TimedPassage(passage, sailing).ways([(100, 100), (900, 100)])
        assert ways.times_s[0, 1] < 0.7 * ways.times_s[1, 0]
        for i, j in ((0, 1), (1, 0)):
            assert ways.times_s[i, j] == pytest.approx(sailing.way_time_s(ways.path(i, j)))
            assert ways.path(i, j)[0].tolist() == ways.points_m[i].tolist()
            assert ways.path(i, j)[-1].tolist() == ways.points_m[j].tolist()

    def test_a_jet_that_cannot_be_stemmed_is_gone_round(self):
        """A jet of 2 m/s to the south in the middle third; the way north leads through the slack water beside it."""

        def jet(points):
            inside = (points[:, 0] > 350) & (points[:, 0] < 650) & (points[:, 1] > 300) & (points[:, 1] < 700)
            return np.stack([np.zeros(len(points)), np.where(inside, -2.0, 0.0)], axis=-1)

        sailing = Sailing(1.0, current=jet, step_m=20.0)
        ways = TimedPassage(self.passage(), sailing).ways([(500, 100), (500, 900)])
        assert np.isinf(sailing.times_s((500, 100), (500, 900)))[0]
        # The shortest way round the jet bends at its two western or eastern corners.
        shortest = 2 * np.hypot(150, 200) + 400
        assert shortest <= ways.times_s[0, 1] <= 1.12 * shortest
        assert ways.times_s[1, 0] < 800
        assert len(ways.path(0, 1)) > 2

    def test_against_a_current_everywhere_there_is_no_way(self):
        passage = self.passage()
        ways = TimedPassage(passage, Sailing(1.0, current=(1.5, 0.0))).ways([(100, 500), (900, 500)])
        assert np.isfinite(ways.times_s[0, 1])
        assert np.isinf(ways.times_s[1, 0])
        assert np.isinf(ways.energies_j[1, 0])
        with pytest.raises(Unreachable, match="against this current"):
            ways.path(1, 0)

    def test_every_leg_is_clear(self):
        rng = np.random.default_rng(3)
        islands = [shapely.Point(p).buffer(60) for p in rng.uniform(100, 900, (15, 2))]
        passage = self.passage(shapely.union_all(islands))
        sailing = Sailing(
            1.0, current=lambda p: 0.6 * np.stack([np.sin(p[:, 1] / 150), np.cos(p[:, 0] / 90)], -1)
        )
        points = rng.uniform(0, 1000, (40, 2))
        points = points[passage.reachable((1, 1), points)][:12]
        ways = TimedPassage(passage, sailing).ways(points)
        area = shapely.union_all(islands)
        for i, j in zip(*np.nonzero(np.isfinite(ways.times_s)), strict=True):
            assert not shapely.LineString(ways.path(i, j)).intersects(area.buffer(-2e-3))
