"""A made-up sea that moves: salinity carried along a real coast by a current with tides and eddies.

What the current stirs is replenished: water of other origin comes in over the open edges, saltier water wells up along
the shore, a river runs out, and far from all of them the sea slowly returns to its usual state. So part of the field is
locked to the coast and part of it drifts, for ever.
"""

import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from sim.advection import Transport
from sim.currents import StreamFunction
from sim.field import FieldInfo, InterpolatedField
from sim.field_grid import FloatArray, LandMask
from sim.waves import Swings

_DAY_S = 86_400.0
FRAME_S = 600.0
"""Between two instants that are kept; in between the field is linear in time."""

_RECENT = 16
_CHECKPOINTS = 200


@dataclass(frozen=True)
class Supply:
    """What keeps the tracer from becoming the same everywhere.

    Attributes:
        usual: what the sea returns to, shape (rows, columns), finite on land too.
        return_per_s: how fast, shape (rows, columns).
        strange: by how much the water outside differs from that, patterns of shape (n, rows + 2, columns + 2): the ring
            of cells about the lattice, and all within, with which the sea begins.
    """

    usual: FloatArray
    return_per_s: FloatArray
    strange: Swings

    def incoming(self, time_s: float) -> FloatArray:
        """The tracer of the water outside, shape (rows + 2, columns + 2)."""
        return np.asarray(np.pad(self.usual, 1, mode="edge") + self.strange.at(time_s))


class MovingField(InterpolatedField):
    """A tracer and the current that carries it.

    Frames `FRAME_S` apart are computed when they are first asked for, one after the other: a day takes about half a
    second, and the first question `spin_up_s` more. A few recent ones are kept, and one now and then to begin from when
    an earlier time is asked for; values depend on the time only, not on what was asked before. Before
    time zero the field is that of time zero.
    """

    def __init__(
        self,
        info: FieldInfo,
        mask: LandMask,
        current: StreamFunction,
        transport: Transport,
        supply: Supply,
        spin_up_s: float = 1.5 * _DAY_S,
    ) -> None:
        super().__init__(info, mask, (0.0, math.inf))
        self._current = current
        self._transport = transport
        self._supply = supply
        self._spun_up = round(spin_up_s / FRAME_S)
        self._recent: OrderedDict[int, FloatArray] = OrderedDict()
        self._checkpoints: dict[int, FloatArray] = {0: supply.incoming(0.0)[1:-1, 1:-1]}
        self._stride = 36

    def _around(self, time_s: float) -> tuple[FloatArray, FloatArray, float]:
        if not math.isfinite(time_s):
            raise ValueError(f"the time must be finite, not {time_s!r}: this sea has no last instant")
        share, before = math.modf(max(0.0, time_s) / FRAME_S)
        first = self._frame(self._spun_up + int(before))
        return first, self._frame(self._spun_up + int(before) + 1) if share > 0.0 else first, share

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, m/s; none on land and outside the field."""
        row, column = self.mask.grid.locate(lat_deg, lon_deg)
        if not bool(self.mask.is_water(row, column)):
            return 0.0, 0.0
        return self._current.velocity(float(row), float(column), self._spun_up * FRAME_S + max(0.0, time_s))

    def _frame(self, number: int) -> FloatArray:
        """The tracer `number` frames after the start of the spin-up, shape (rows, columns)."""
        known = self._recent.get(number)
        if known is not None:
            self._recent.move_to_end(number)
            return known
        kept = self._recent.keys() | self._checkpoints.keys()
        last = max(earlier for earlier in kept if earlier <= number)
        tracer = self._recent[last] if last in self._recent else self._checkpoints[last]
        for each in range(last, number):
            tracer = self._next(tracer, each)
            self._keep(each + 1, tracer)
        return tracer

    def _next(self, tracer: FloatArray, number: int) -> FloatArray:
        middle_s = (number + 0.5) * FRAME_S
        flow = self._current.flow(middle_s)
        incoming = self._supply.incoming(middle_s)
        steps = math.ceil(FRAME_S / self._transport.longest_step_s(flow))
        for _ in range(steps):
            tracer = self._transport.advanced(tracer, flow, FRAME_S / steps, incoming)
        usual = self._supply.usual
        return usual + np.exp(-self._supply.return_per_s * FRAME_S) * (tracer - usual)

    def _keep(self, number: int, tracer: FloatArray) -> None:
        self._recent[number] = tracer
        if len(self._recent) > _RECENT:
            self._recent.popitem(last=False)
        if number % self._stride == 0:
            self._checkpoints[number] = tracer
        if len(self._checkpoints) > _CHECKPOINTS:
            self._stride *= 2
            self._checkpoints = {n: t for n, t in self._checkpoints.items() if n % self._stride == 0}
