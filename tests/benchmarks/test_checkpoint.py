"""How long the control loop stands still for a checkpoint of a full learner; its limit is 10 ms."""

import numpy as np
import pytest

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.learner import Learner
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import MaternMotion, Static
from autonomy.memory import capture

SPACE = SquaredExponential((400.0, 400.0))
KERNELS = {
    "static": Kernel((Component(1.0, SPACE, Static()),), 0.01),
    "moving": Kernel((Component(1.0, SPACE, Static()), Component(0.5, SPACE, MaternMotion(3600.0))), 0.01),
}


@pytest.mark.parametrize("name", KERNELS)
def test_a_full_learner_is_captured(report, seconds, name):
    rng = np.random.default_rng(0)
    learner = Learner(10_000.0, capacity=300, history_cells=2000)
    for i, point in enumerate(rng.uniform(0.0, 10_000.0, (2600, 2))):
        learner.history.add(point, float(rng.normal()), float(i))
    learner._gp = learner._build.rebuilt(learner.history.cells(), KERNELS[name], 0.0, 2600.0)
    assert (len(learner.basis), len(learner.history)) == (300, 2000)
    state = learner.gp._state.matrix
    report(
        f"capture of 300 basis vectors, 2000 cells, {name}",
        seconds(lambda: capture(learner), 20),
        "copies of the state",
        seconds(state.copy, 20),
    )
