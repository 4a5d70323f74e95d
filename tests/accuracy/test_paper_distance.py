"""How many of the paper's kilometres `route` needs for the map that the paper has at the end of them.

The paper sails `LENGTH` × √(water area) on 12 × 12 sites, 20 spots a path, a new path when one is finished, reading
all along the legs every fiftieth. `route` is given shares of that budget, each a voyage of its own. A voyage's RMSE
scatters, so the share at which `route` reaches the paper's is read off a curve that only falls with the budget, the
isotonic regression of the logarithm of its RMSE: the first of several voyages that happens to be lucky would flatter.

Twice: all readings mapped by one Gaussian process fitted to the field itself (see `test_route`), and the paper's
learner on the paper's readings against the default learner on those of `route`. The paper is spared the search for
first hyperparameters: it plans with, and its learner starts from, a length-scale and a variance fitted to the field.
Found over these twelve runs: .742 ± 3.1 % and .452 ± 4.5 %, the latter with six runs already there at the least share.
"""

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from examinations import field_named
from forms import LONG, Say
from oracles import geometric_mean, rmse
from paper_voyages import Voyage, paper_learner, paper_profile, paper_voyage
from scipy.optimize import isotonic_regression
from sea_fields import FloatArray, SeaField
from seas import sea_of
from surveys import Survey, surveyed

from autonomy.learning.learner import Learner
from autonomy.planning.planners import route
from sim.trials import Readings, Sea, Trial

NAMES = ("patch-0", "bight-1", "nordic-temp-0", "sst-0", "ucla-temp-49", "txla-salt-9")
LENGTH = 10.0
SHARES = (0.4, 0.55, 0.7, 0.85, 1.0)
SEEDS = int(os.environ.get("HALOCLINE_SEEDS", "2"))


@dataclass(frozen=True, eq=False)
class Run:
    """One launch over one field."""

    field: SeaField
    sea: Sea
    launch: int

    def trial(self, share: float) -> Trial:
        return Trial(self.sea, self.sea.launch(self.launch), LENGTH * share, seed=self.launch)

    @cached_property
    def voyage(self) -> Voyage:
        """The paper's."""
        return paper_voyage(self.trial(1.0), paper_profile())

    @cached_property
    def papers(self) -> Readings:
        """What is read along it."""
        return self.trial(1.0).read(self.voyage.track_m)

    def routes(self, share: float) -> Readings:
        """What `route` reads with this share of the paper's way."""
        trial = self.trial(share)
        return trial.read(trial.sailed(route.plan))

    def by_judge(self, readings: Readings) -> float:
        """RMSE, as a share of the field's standard deviation, of the map that is the same for all."""
        return self.sea.error(readings) / self._unit

    def by_papers_learner(self) -> float:
        """The same of the paper's learner, of what the paper reads."""
        learner = paper_learner(self.trial(1.0), self.field, self.voyage, self.papers, paper_profile())
        return self._error(learner)

    def by_default_learner(self, readings: Readings) -> float:
        """The same of the default learner."""
        places, values = readings.points_m, readings.values
        return self._error(surveyed(Survey(self.field, 0, False, places, values, self.sea.noise)))

    @property
    def _unit(self) -> float:
        return float(self.field.truth.std())

    def _error(self, learner: Learner) -> float:
        return rmse(learner.model().predict(self.field.points).mean, self.field.truth) / self._unit


def _run(name: str, launch: int, directory: Path) -> Run:
    field = field_named(name, directory)
    return Run(field, sea_of(field), launch)


def share_needed(shares: FloatArray, errors: FloatArray, wanted: float) -> float:
    """Where errors (n,) at ascending shares (n,), made to fall, first come down to `wanted`.

    The first share if it is already there; infinity if no share is.
    """
    logs = np.asarray(isotonic_regression(np.log(errors), increasing=False).x)
    enough = np.flatnonzero(logs <= np.log(wanted))
    if not len(enough):
        return float("inf")
    k = int(enough[0])
    if k == 0:
        return float(shares[0])
    part = (logs[k - 1] - np.log(wanted)) / (logs[k - 1] - logs[k])
    return float(shares[k - 1] + part * (shares[k] - shares[k - 1]))


def test_the_share_needed_is_read_off_a_falling_curve() -> None:
    shares = np.array([0.4, 0.6, 0.8, 1.0])
    falling = np.exp([0.0, -1.0, -2.0, -3.0])
    assert share_needed(shares, falling, float(np.exp(-1.5))) == pytest.approx(0.7)
    assert share_needed(shares, falling, 2.0) == 0.4
    assert share_needed(shares, falling, 0.01) == float("inf")
    # One lucky voyage among worse ones is averaged with them.
    lucky = np.exp([0.0, -2.0, 0.0, -3.0])
    assert share_needed(shares, lucky, float(np.exp(-1.0))) == pytest.approx(0.6)
    assert share_needed(shares, lucky, float(np.exp(-1.9))) == pytest.approx(0.8 + 0.2 * 0.9 / 2.0)


def test_route_has_the_better_map_after_85_percent_of_the_papers_way() -> None:
    # One simulated coast, where the whole, below, finds .69 and .53 of the way enough: after .85 the errors are .72 and
    # .67 of the paper's. Elsewhere single launches need up to .91, so this shows a broken planner only.
    run = _run("bight-1", 0, Path())
    readings = run.routes(0.85)
    assert run.by_judge(readings) <= run.by_judge(run.papers)
    assert run.by_default_learner(readings) <= run.by_papers_learner()


@pytest.mark.skipif(not LONG, reason="whole voyages at five budgets a run: HALOCLINE_ACCURACY=long")
@pytest.mark.timeout(4 * 3600)
def test_route_needs_fewer_kilometres_than_the_paper(real_data_dir: Path, say: Say) -> None:
    found: dict[str, list[float]] = {"same learner": [], "own learners": []}
    for name in NAMES:
        for launch in range(SEEDS):
            run = _run(name, launch, real_data_dir)
            sailed = [run.routes(share) for share in SHARES]
            errors = {
                "same learner": (run.by_judge(run.papers), [run.by_judge(each) for each in sailed]),
                "own learners": (run.by_papers_learner(), [run.by_default_learner(each) for each in sailed]),
            }
            for title, (theirs, ours) in errors.items():
                share = share_needed(np.array(SHARES), np.array(ours), theirs)
                found[title].append(share)
                curve = " ".join(f"{error:.3f}" for error in ours)
                say(f"{name:13} {launch} {title}: paper {theirs:.3f}, route {curve}: {share:.3f} of the way")
    for title, shares in found.items():
        assert np.isfinite(shares).all(), f"{title}: {SHARES[-1]} of the paper's way are not enough somewhere"
        mean, deviation = geometric_mean(shares)
        say(f"{title}: {mean:.3f} ± {100 * deviation:.1f} % of the paper's way, {len(shares)} runs")
    assert geometric_mean(found["same learner"])[0] <= 0.85
    assert geometric_mean(found["own learners"])[0] <= 0.70
