"""Speed of the page's maps: against asking the model cell by cell, in the same run."""

import sys
from pathlib import Path

import numpy as np
import pytest

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.shore.server.land import inside
from autonomy.shore.server.maps import Extent, bounds_deg, evaluate, frame_of

sys.path.insert(0, str(Path(__file__).parents[1] / "process"))
from shore_helpers import field, model_snapshot

ROWS, COLUMNS = 351, 391
KERNELS = {
    "smooth, l = 1.5 km": (100, [Component(0.5, SquaredExponential((1500.0, 1500.0)))]),
    "smooth, l = 0.7 km": (100, [Component(0.5, SquaredExponential((700.0, 700.0)))]),
    "three parts, m = 200": (
        200,
        [Component(0.3, SquaredExponential((scale, scale))) for scale in (3000.0, 1000.0, 500.0)],
    ),
    "Matérn, l = 1 km": (100, [Component(0.5, Matern32((1000.0, 1000.0)))]),
}


def learnt(size, components):
    rng = np.random.default_rng(0)
    gp = SparseOnlineGP(Kernel(tuple(components), 1e-3), size, prior_mean=33.0)
    for point in np.cumsum(rng.normal(0, 400, (900, 2)), axis=0) % [12_000, 9_000]:
        gp.update(point, field(point) + rng.normal(0, 0.03))
    return model_snapshot(gp.model())


@pytest.mark.parametrize("name", KERNELS)
def test_a_map_of_12_by_9_km(report, seconds, name):
    snapshot = learnt(*KERNELS[name])
    extent = Extent(*bounds_deg(snapshot), ROWS, COLUMNS)

    def cell_by_cell():
        places = np.meshgrid(extent.latitudes, extent.longitudes, indexing="ij")
        snapshot.model.predict(frame_of(snapshot).to_local(*places).reshape(-1, 2))

    spent, reference = seconds(lambda: evaluate(snapshot, extent)), seconds(cell_by_cell, 2)
    report(
        f"map of {ROWS} × {COLUMNS}, {name}, {len(snapshot.model)} vectors", spent, "cell by cell", reference
    )


def test_land_of_a_long_coast(report, seconds):
    rng = np.random.default_rng(0)
    extent = Extent(0.0, 0.0, 1.0, 1.0, ROWS, COLUMNS)
    bearing = np.sort(rng.uniform(0, 2 * np.pi, 20_000))
    distance = 0.3 + 0.05 * np.cumsum(rng.standard_normal(20_000)) / 141.0
    coast = [(0.5 + d * np.cos(a), 0.5 + d * np.sin(a)) for a, d in zip(bearing, distance, strict=True)]
    snapshot = learnt(*KERNELS["smooth, l = 1.5 km"])
    window = Extent(*bounds_deg(snapshot), ROWS, COLUMNS)
    spent = seconds(lambda: inside([coast], extent.latitudes, extent.longitudes))
    report("land, a coast of 20 000 corners", spent, "map", seconds(lambda: evaluate(snapshot, window)))
