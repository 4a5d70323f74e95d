"""Whole voyages over water that moves: the service as it is by default against greedy mutual information on tours.

The rules are those of `sim experiment compare`: equal launch, distance and readings; the other's map is an exact
process ashore. Its one synthetic sea, of seed 0, is not among these: an endless survey was mended on it. From sea to
sea the ratio of the errors scatters by some .1.
"""

import math
from dataclasses import asdict

import numpy as np
import pytest
from forms import LONG, Say

from sim.experiment.compare_cells import sail
from sim.experiment.compare_seas import SeaChoice
from sim.experiment.compare_ways import OURS

pytestmark = pytest.mark.timeout(3600)
SEEDS = (1, 2)
SIDES = 12.0


def sailed(seed: int, strategy: str) -> tuple[float, float]:
    """RMSE and coverage of 95 % intervals over the second half of a voyage of `SIDES` √(water area)."""
    sea = SeaChoice(f"moving {seed}", f"synthetic-moving:{seed}", moves=True)
    arguments = {"sea": asdict(sea), "strategy": strategy, "launch": 0, "seed": 0, "sides": SIDES}
    told = sail({**arguments, "budget_m": None})
    return float(np.asarray(told["final_rmse"])), float(np.asarray(told["final_coverage"]))


@pytest.mark.skipif(not LONG, reason="two minutes of CPU time")
def test_an_endless_survey_of_moving_water_is_as_good_as_greedy_information_and_knows_its_error(
    say: Say,
) -> None:
    ratios, coverages = [], []
    for seed in SEEDS:
        (ours, coverage), (others, their_coverage) = sailed(seed, OURS), sailed(seed, "information")
        say(
            f"moving {seed}: RMSE {ours:.3f} and {others:.3f}, coverage {coverage:.3f} and {their_coverage:.3f}"
        )
        ratios.append(ours / others)
        coverages.append(coverage)
    mean = math.exp(float(np.mean(np.log(ratios))))
    say(f"mean ratio {mean:.3f}, mean coverage {np.mean(coverages):.3f}")
    assert mean <= 1.05
    assert 0.9 <= np.mean(coverages) <= 0.99
