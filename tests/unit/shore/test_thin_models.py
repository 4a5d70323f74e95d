"""A map that came over a thin link stands still; what is told of the field is what is believed on board."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from autonomy.effects import Topic
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck
from autonomy.shore.server import plain
from autonomy.shore.words import belief
from autonomy.wire import ModelSnapshot, decode, encode

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import model_snapshot

KERNEL = Kernel(
    (
        Component(0.4, SquaredExponential((3000.0, 2500.0))),
        Component(0.1, SquaredExponential((900.0, 800.0)), OrnsteinUhlenbeck(6e3)),
    ),
    1e-3,
)


def test_what_moves_on_board_is_told_of_a_map_that_stands_still() -> None:
    gp = SparseOnlineGP(KERNEL, 30, prior_mean=33.0)
    for point in np.random.default_rng(3).uniform([0.0, 0.0], [12_000.0, 9_000.0], (60, 2)):
        gp.update(point, 33.0 + np.sin(point[0] / 2000.0))
    on_board = model_snapshot(gp.model())
    payload = encode(replace(on_board, precision="8 bit"), packed=True, inducing=20)
    ashore = decode(Topic.MODEL, payload)
    assert isinstance(ashore, ModelSnapshot)
    assert ashore.model.kernel != KERNEL, "the map itself stands still"
    assert ashore.kernel == on_board.kernel == KERNEL
    assert belief(ashore) == belief(on_board)
    told = [component["timescale_s"] for component in plain.model(ashore, 0.0)["kernel"]]
    assert told == [np.inf, 6e3]
