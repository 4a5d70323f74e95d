"""Maps and values from the models of a fleet, made beside the event loop."""

import zlib
from collections.abc import Hashable
from dataclasses import dataclass
from functools import partial

import numpy as np

from autonomy.effects import Topic
from autonomy.shore.server.atelier import Atelier
from autonomy.shore.server.fleet import Fleet
from autonomy.shore.server.land import Ring, inside
from autonomy.shore.server.maps import Extent, FieldMap, evaluate, is_outside, predict
from autonomy.wire import ModelSnapshot, decode


class NoModelError(Exception):
    """The vehicle has not published a model yet."""


@dataclass(frozen=True, eq=False)
class Found:
    """A model of a vehicle, and the slider's stop that it belongs to; `key` tells it from all others."""

    key: Hashable
    stop_s: float
    snapshot: ModelSnapshot


@dataclass(frozen=True)
class Value:
    """The field at a place: mean and standard deviation in the variable's units.

    They are None where the map has none either: on `land`, and `outside` of the survey's rectangle.
    """

    mean: float | None
    sd: float | None
    land: bool
    outside: bool


class Nowcasts:
    """Answers from models. All methods raise BusyError if more is asked for than can be made in time."""

    def __init__(self, fleet: Fleet, atelier: Atelier) -> None:
        self._fleet, self._atelier = fleet, atelier

    async def find(self, vehicle: str, at_s: float | None) -> Found:
        """The model of a moment, the newest for None.

        Raises:
            UnknownVehicleError: the vehicle has not been heard of.
            NoModelError: it has not published one yet.
        """
        model = self._fleet.model(vehicle, at_s)
        if model is None:
            raise NoModelError(f"{vehicle} has not published a model yet")
        stop_s, payload = model
        key = ("model", vehicle, stop_s, zlib.crc32(payload))
        snapshot = await self._atelier.make(key, partial(_decoded, payload), _model_bytes)
        return Found(key, stop_s, snapshot)

    async def map(self, found: Found, extent: Extent) -> FieldMap:
        """The map of a model, without land."""
        number, rings = self._fleet.land(found.snapshot.vehicle)
        of_land = ("land", found.snapshot.vehicle, number, extent)
        recipe = partial(inside, rings, extent.latitudes, extent.longitudes)
        land = await self._atelier.make(of_land, recipe, lambda mask: mask.nbytes)
        return await self._atelier.make(
            ("map", found.key, number, extent),
            partial(evaluate, found.snapshot, extent, land),
            lambda made: made.size_bytes,
        )

    async def value(self, found: Found, lat_deg: float, lon_deg: float) -> Value:
        """The field at a place."""
        number, rings = self._fleet.land(found.snapshot.vehicle)
        key = ("value", found.key, number, lat_deg, lon_deg)
        recipe = partial(_value, found.snapshot, rings, lat_deg, lon_deg)
        return await self._atelier.make(key, recipe, lambda _: 500)


def _decoded(payload: bytes) -> ModelSnapshot:
    value = decode(Topic.MODEL, payload)
    assert isinstance(value, ModelSnapshot)
    return value


def _model_bytes(snapshot: ModelSnapshot) -> int:
    """What a model takes, with what it computes once to predict from."""
    model = snapshot.model
    field = len(model) * len(model.factors)
    return 8 * (len(model.whitened_mean) ** 2 + 3 * field**2)


def _value(snapshot: ModelSnapshot, rings: tuple[Ring, ...], lat_deg: float, lon_deg: float) -> Value:
    land = bool(inside(rings, np.array([lat_deg]), np.array([lon_deg]))[0, 0])
    outside = is_outside(snapshot, lat_deg, lon_deg)
    mean, sd = (None, None) if land or outside else predict(snapshot, lat_deg, lon_deg)
    return Value(mean, sd, land, outside)
