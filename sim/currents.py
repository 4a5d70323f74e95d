"""The current of a made-up sea: along the coast, with tides and eddies; incompressible, never through the shore.

Its stream function is a sum of patterns that never change, each times a number that swings about a mean. Every pattern
is constant on land.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import spsolve

from sim.advection import Flow
from sim.field_grid import BoolArray, FloatArray
from sim.waves import Swarm, Swings

TIDE_S = 12.4206 * 3600.0
"""The principal lunar tide."""


@dataclass(frozen=True)
class Speeds:
    """How fast the water moves: speeds in m/s, sizes in metres, times in seconds.

    Attributes:
        mean_mps: along the shore, far from it, land to the left for positive values.
        swing_mps: by which that changes with the weather, `swing_s` being the period.
        tide_mps: of the tide, which runs along the shore too.
        eddy_mps: standard deviation of either component of the eddies.
        eddy_m: size of the eddies: they vary over this length.
        eddy_s: shortest and longest period of the waves that make up the eddies.
        waves: how many waves.
        shore_m: over this distance from the shore the eddies fade.
    """

    mean_mps: float
    swing_mps: float
    swing_s: float
    tide_mps: float
    eddy_mps: float
    eddy_m: float
    eddy_s: tuple[float, float]
    waves: int
    shore_m: float


@dataclass(frozen=True)
class TidalCurrent:
    """A tide that runs to and fro, the same everywhere: strongest at first, and then towards `towards_deg`, true."""

    speed_mps: float
    towards_deg: float

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, in m/s."""
        speed = self.speed_mps * math.cos(2.0 * math.pi * time_s / TIDE_S)
        towards = math.radians(self.towards_deg)
        return speed * math.sin(towards), speed * math.cos(towards)


@dataclass(frozen=True)
class StreamFunction:
    """ψ, m²/s, at the corners of square cells: its patterns have the shape (n, rows + 1, columns + 1)."""

    cell_m: float
    psi: Swings

    def flow(self, time_s: float) -> Flow:
        """What passes the sides of the cells at an instant."""
        return Flow.of(self.psi.at(time_s))

    def velocity(self, row: float, column: float, time_s: float) -> tuple[float, float]:
        """East and north, m/s, at fractional indices of the cells, whose middles are whole numbers.

        Within a cell each component is linear between the two sides that carry it: what carries the tracer there
        carries the boat.
        """
        rows, columns = self.psi.patterns.shape[1] - 1, self.psi.patterns.shape[2] - 1
        i, j = min(rows - 1, math.floor(row + 0.5)), min(columns - 1, math.floor(column + 0.5))
        corners = self.psi.patterns[:, i : i + 2, j : j + 2]
        (sw, se), (nw, ne) = np.tensordot(self.psi.weights(time_s), corners, axes=1).tolist()
        up, right = row + 0.5 - i, column + 0.5 - j
        east = (sw - nw) * (1.0 - right) + (se - ne) * right
        north = (se - sw) * (1.0 - up) + (ne - nw) * up
        return east / self.cell_m, north / self.cell_m


def coastal_current(
    land: BoolArray, cell_m: float, speeds: Speeds, rng: np.random.Generator
) -> StreamFunction:
    """A current for a lattice of cells, rows from the south: shape of `land` (rows, columns)."""
    shore_m = _distance_from_land(land) * cell_m
    along = _around(shore_m)
    # For these eddies, the ratio of the variances of ψ and of its gradient is the size squared.
    swarm = Swarm(speeds.eddy_mps * speeds.eddy_m, speeds.eddy_m, speeds.eddy_s, speeds.waves)
    eddies = swarm.draw((land.shape[0] + 1, land.shape[1] + 1), cell_m, rng)
    # Flat at the shore, so that the eddies' water slows down there.
    fading = 1.0 - np.exp(-((shore_m / speeds.shore_m) ** 2))
    psi = Swings(
        patterns=np.concatenate([[along, along], eddies.patterns * fading]),
        mean=np.concatenate([[speeds.mean_mps, 0.0], eddies.mean]),
        swing=np.concatenate([[speeds.swing_mps, speeds.tide_mps], eddies.swing]),
        rate_per_s=np.concatenate([2.0 * math.pi / np.array([speeds.swing_s, TIDE_S]), eddies.rate_per_s]),
        phase=np.concatenate([rng.uniform(0.0, 2.0 * math.pi, 2), eddies.phase]),
    )
    return StreamFunction(cell_m, psi)


def _distance_from_land(land: BoolArray) -> FloatArray:
    """Of the corners, in cells: 0 at every corner of a cell of land; without land, from the northern edge."""
    beside = np.zeros((land.shape[0] + 1, land.shape[1] + 1), dtype=bool)
    for rows in (slice(0, -1), slice(1, None)):
        for columns in (slice(0, -1), slice(1, None)):
            beside[rows, columns] |= land
    if not beside.any():
        beside[-1] = True
    return np.asarray(ndimage.distance_transform_edt(~beside))


def _around(shore_m: FloatArray) -> FloatArray:
    """The flow without eddies round a coast: ∇²ψ = 0, ψ = 0 on land, and on the open edges the distance from it.

    Far from land its speed is 1; round a headland it is faster, in a bay slower.
    """
    fixed = shore_m == 0.0
    fixed[[0, -1], :] = fixed[:, [0, -1]] = True
    number = np.full(shore_m.shape, -1)
    number[~fixed] = np.arange(int((~fixed).sum()))
    inner = np.argwhere(~fixed)
    here = number[~fixed]
    matrix = [sparse.identity(len(here), format="csr") * 4.0]
    known = np.zeros(len(here))
    for step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        there = tuple((inner + step).T)
        free = ~fixed[there]
        known += np.where(free, 0.0, shore_m[there])
        ones = -np.ones(int(free.sum()))
        matrix.append(sparse.csr_matrix((ones, (here[free], number[there][free])), (len(here), len(here))))
    psi = shore_m.copy()
    psi[~fixed] = spsolve(sum(matrix[1:], matrix[0]).tocsc(), known)
    return psi
