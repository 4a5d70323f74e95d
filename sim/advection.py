"""A tracer carried by an incompressible current round a coast: finite volumes on a square lattice.

What flows through a side of a cell is the difference of the stream function between the side's two ends, so every
cell receives exactly what it gives, and a coast along which the stream function is constant lets nothing through. The
tracer on a side is the upstream cell's, with a limited slope (van Leer 1974); in time the scheme is Heun's, a mean of
Euler steps (Shu & Osher 1988). While no side carries more than a quarter of a cell in a step, the new value
of a cell is a mean of values that were there before, weighted with positive weights (as in Zhang & Shu 2010), hence
there are no new extremes.
"""

from dataclasses import dataclass

import numpy as np

from sim.field_grid import BoolArray, FloatArray

LARGEST_SHARE = 0.25
"""Of a cell's content that may pass one of its sides in a step."""


@dataclass(frozen=True)
class Flow:
    """What passes the sides of the cells, m²/s (per metre of depth): nothing is lost, nothing crosses land.

    Attributes:
        east: through the sides of constant column, shape (rows, columns + 1), positive to the east.
        north: through the sides of constant row, shape (rows + 1, columns), positive to the north.
    """

    east: FloatArray
    north: FloatArray

    @classmethod
    def of(cls, psi: FloatArray) -> "Flow":
        """The flow along a stream function, m²/s, at the corners: shape (rows + 1, columns + 1).

        u = −∂ψ/∂y, v = ∂ψ/∂x, rows counted from the south.
        """
        return cls(east=psi[:-1, :] - psi[1:, :], north=psi[:, 1:] - psi[:, :-1])

    @property
    def largest(self) -> float:
        """The most that passes any side, m²/s."""
        return max(float(np.abs(self.east).max()), float(np.abs(self.north).max()))


class Transport:
    """Moves a tracer on the water of a lattice with square cells; rows from the south, columns from the west.

    Over the edges of the lattice what flows out takes the tracer along, and what flows in brings that of `inflow`.
    """

    def __init__(self, land: BoolArray, cell_m: float, diffusivity_m2ps: float = 0.0) -> None:
        """Take the lattice.

        Args:
            land: shape (rows, columns).
            cell_m: side of a cell.
            diffusivity_m2ps: of the tracer, between cells of water.
        """
        if not cell_m > 0.0:
            raise ValueError(f"the side of a cell must be positive, got {cell_m} m")
        if not diffusivity_m2ps >= 0.0:
            raise ValueError(f"the diffusivity must not be negative, got {diffusivity_m2ps} m2/s")
        self._cell_m = cell_m
        self._diffusivity = diffusivity_m2ps
        water = ~land
        # 1 between two cells of water, 0 at a coast: there neither a slope nor diffusion reaches across.
        self._open_east = (water[:, :-1] & water[:, 1:]).astype(float)
        self._open_north = (water[:-1, :] & water[1:, :]).astype(float)

    def longest_step_s(self, flow: Flow) -> float:
        """The longest step for which `advanced` makes no new extremes."""
        area = self._cell_m**2
        advection = LARGEST_SHARE * area / max(flow.largest, 1e-12)
        if self._diffusivity == 0.0:
            return advection
        # Heun's Euler steps take both at once: together they may take all that a cell has.
        return 1.0 / (1.0 / advection + 4.0 * self._diffusivity / area)

    def advanced(self, tracer: FloatArray, flow: Flow, dt_s: float, inflow: FloatArray) -> FloatArray:
        """The tracer after a step.

        Args:
            tracer: shape (rows, columns); what stands on land is never looked at.
            flow: constant during the step; it must not cross land.
            dt_s: at most `longest_step_s`.
            inflow: what comes over the edges, shape (rows + 2, columns + 2): the ring of cells about the lattice.

        Raises:
            ValueError: the step is too long.
        """
        if dt_s > self.longest_step_s(flow) * (1.0 + 1e-9):
            raise ValueError(
                f"a step of {dt_s:g} s is too long for this flow: at most {self.longest_step_s(flow):g} s"
            )
        share = dt_s / self._cell_m**2
        once = tracer + share * self._gain(tracer, flow, inflow)
        twice = once + share * self._gain(once, flow, inflow)
        return np.asarray(0.5 * (tracer + twice))

    def _gain(self, tracer: FloatArray, flow: Flow, inflow: FloatArray) -> FloatArray:
        """What each cell gains, tracer × m²/s."""
        difference = (tracer[:, 1:] - tracer[:, :-1]) * self._open_east
        half = _half_slopes(difference, axis=1)
        low = np.concatenate([inflow[1:-1, :1], tracer + half], axis=1)
        high = np.concatenate([tracer - half, inflow[1:-1, -1:]], axis=1)
        east = np.where(flow.east > 0.0, low, high) * flow.east
        if self._diffusivity > 0.0:
            east[:, 1:-1] -= self._diffusivity * difference
        difference = (tracer[1:, :] - tracer[:-1, :]) * self._open_north
        half = _half_slopes(difference, axis=0)
        low = np.concatenate([inflow[:1, 1:-1], tracer + half], axis=0)
        high = np.concatenate([tracer - half, inflow[-1:, 1:-1]], axis=0)
        north = np.where(flow.north > 0.0, low, high) * flow.north
        if self._diffusivity > 0.0:
            north[1:-1, :] -= self._diffusivity * difference
        return np.asarray(east[:, :-1] - east[:, 1:] + north[:-1, :] - north[1:, :])


def _half_slopes(difference: FloatArray, axis: int) -> FloatArray:
    """From a cell's middle to its sides: half the harmonic mean of both differences, 0 at extremes and edges.

    It is at most as large as either, so that no side lies beyond a neighbour (van Leer 1974).
    """
    count = difference.shape[axis]
    left = difference[:, :-1] if axis else difference[:-1]
    right = difference[:, 1:] if axis else difference[1:]
    product = left * right
    half = np.zeros([size + (i == axis) for i, size in enumerate(difference.shape)])
    inner = half[:, 1:count] if axis else half[1:count]
    np.divide(product, left + right, out=inner, where=product > 0.0)
    return half
