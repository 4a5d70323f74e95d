"""A survey as an MCAP log with Foxglove's schemas, for Foxglove and Lichtblick; foxglove-sdk writes it (extra `shore`).

The log's time is the time that a message is of, by the vehicle's UTC. Positions in three-dimensional messages are
metres east and north of the survey's origin, in the frame `survey`.
"""

import heapq
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import messages
from foxglove.channels import (
    FrameTransformChannel,
    GeoJsonChannel,
    GridChannel,
    LocationFixChannel,
    LogChannel,
    SceneUpdateChannel,
)

from autonomy.export.archive import Archive
from autonomy.export.colours import Colours, colormap_of
from autonomy.export.grid import local_water
from autonomy.export.outputs import told_as_os_error
from autonomy.export.values import DatedLine, DatedModel, DatedPlan, Readings, State, Subject
from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.planning.plan_geojson import feature, line, position

FRAME = "survey"
_CELLS = 200  # along the longer side
_LEVELS = {
    "debug": messages.LogLevel.Debug,
    "info": messages.LogLevel.Info,
    "warning": messages.LogLevel.Warning,
    "error": messages.LogLevel.Error,
}
_CELL = np.dtype([("value", "<f4"), ("colour", "u1", (4,))])
_ROUTE = messages.Color(r=0.9, g=0.6, b=0.0, a=1.0)
_SPOT = messages.Color(r=0.8, g=0.25, b=0.0, a=1.0)
_NUMBERS = {"type": ["number", "null"]}
_READING_SCHEMA = {
    "type": "object",
    "title": "halocline.Reading",
    "properties": {
        "value": _NUMBERS,
        "units": {"type": "string"},
        "flag": {"type": "integer"},
        "latitude": _NUMBERS,
        "longitude": _NUMBERS,
    },
}
_MODEL_SCHEMA = {
    "type": "object",
    "title": "halocline.Model",
    "properties": dict.fromkeys(
        ("rho", "rho0", "basis_size", "samples", "noise_sd", "signal_sd", "coverage_95"), _NUMBERS
    ),
}


def write_mcap(path: Path, archive: Archive, subject: Subject, water: Any, resolution_m: float | None) -> int:
    """Write maps, positions, readings, plans and log in the order of their times; returns how many messages.

    Args:
        path: of the file, which must not exist.
        archive: what to write.
        subject: what was surveyed, and where.
        water: the survey's water in local metres; None if that is not known.
        resolution_m: side of a map's cell.

    Raises:
        OSError: the file can't be written.
    """
    context = foxglove.Context()
    with told_as_os_error(path, "FoxgloveError"), foxglove.open_mcap(path, context=context) as file:
        newest = archive.newest().snapshot.model
        writer = _Writer(context, archive.vehicle, subject, water, resolution_m, newest)
        file.write_metadata(
            "halocline",
            {
                "vehicle": archive.vehicle,
                "variable": subject.variable,
                "units": subject.units,
                "colours of the mean": str(writer.mean_colours),
                "colours of the standard deviation": str(writer.sd_colours),
            },
        )
        count = 0
        for moment in heapq.merge(
            _moments(archive.models()),
            _moments(archive.plans()),
            _moments(archive.states()),
            _moments(archive.lines()),
            _readings(archive),
            key=lambda moment: moment.utc_s,
        ):
            writer.put(moment)
            count += 1
        return count


@dataclass(frozen=True)
class _Reading:
    utc_s: float
    lat_deg: float
    lon_deg: float
    value: float
    flag: int


_Moment = DatedModel | DatedPlan | DatedLine | State | _Reading


def _moments(those: Iterator[Any]) -> Iterator[_Moment]:
    yield from those


def _readings(archive: Archive) -> Iterator[_Reading]:
    for part in archive.readings():
        yield from map(_Reading, *_columns(part))


def _columns(part: Readings) -> tuple[list[Any], ...]:
    return tuple(getattr(part, name).tolist() for name in ("utc_s", "lat_deg", "lon_deg", "value", "flag"))


class _Writer:
    """The channels of one file."""

    def __init__(
        self,
        context: foxglove.Context,
        vehicle: str,
        subject: Subject,
        water: Any,
        resolution_m: float | None,
        newest: FieldModel,
    ) -> None:
        self._vehicle, self._subject = vehicle, subject
        topic = f"/{vehicle}"
        self._mean = GridChannel(f"{topic}/mean", context=context)
        self._sd = GridChannel(f"{topic}/standard_deviation", context=context)
        self._fix = LocationFixChannel(f"{topic}/fix", context=context)
        self._transform = FrameTransformChannel("/tf", context=context)
        self._route = GeoJsonChannel(f"{topic}/plan", context=context)
        self._scene = SceneUpdateChannel(f"{topic}/plan_scene", context=context)
        self._log = LogChannel(f"{topic}/log", context=context)
        self._reading = foxglove.Channel(f"{topic}/observation", schema=_READING_SCHEMA, context=context)
        self._model = foxglove.Channel(f"{topic}/model", schema=_MODEL_SCHEMA, context=context)
        x_min, y_min, x_max, y_max = subject.bounds_m
        self._cell_m = resolution_m or max(x_max - x_min, y_max - y_min) / _CELLS
        self._corner = messages.Pose(
            position=messages.Vector3(x=x_min, y=y_min, z=0.0),
            orientation=messages.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        )
        self._x, self._y = (_axis(low, high, self._cell_m) for low, high in ((x_min, x_max), (y_min, y_max)))
        self._dry = ~local_water(water, self._x, self._y)
        prediction = newest.predict_grid(self._x, self._y)
        wet = prediction.mean[~self._dry] if not self._dry.all() else prediction.mean
        largest = np.sqrt(np.maximum(prediction.variance, 0.0)).max()
        self.mean_colours = Colours(colormap_of(subject.variable), float(wet.min()), float(wet.max()))
        self.sd_colours = Colours("viridis", 0.0, float(largest))

    def put(self, moment: _Moment) -> None:
        """One message, or the few that belong together."""
        at = round(moment.utc_s * 1e9)
        stamp = messages.Timestamp(sec=at // 10**9, nsec=at % 10**9)
        match moment:
            case DatedModel():
                self._put_model(moment, at, stamp)
            case DatedPlan():
                self._put_plan(moment, at, stamp)
            case State():
                self._put_state(moment, at, stamp)
            case DatedLine():
                level = _LEVELS.get(moment.line.level, messages.LogLevel.Unknown)
                said = messages.Log(
                    timestamp=stamp, level=level, message=moment.line.text, name=self._vehicle
                )
                self._log.log(said, log_time=at)
            case _Reading():
                self._reading.log(
                    {
                        "value": _known(moment.value),
                        "units": self._subject.units,
                        "flag": moment.flag,
                        "latitude": moment.lat_deg,
                        "longitude": moment.lon_deg,
                    },
                    log_time=at,
                )

    def _put_model(self, dated: DatedModel, at: int, stamp: messages.Timestamp) -> None:
        snapshot, model = dated.snapshot, dated.snapshot.model
        prediction = model.predict_grid(self._x, self._y)
        self._mean.log(self._grid("mean", prediction.mean, self.mean_colours, stamp), log_time=at)
        sd = np.sqrt(np.maximum(prediction.variance, 0.0))
        self._sd.log(self._grid("standard_deviation", sd, self.sd_colours, stamp), log_time=at)
        self._model.log(
            {
                "rho": _known(snapshot.rho),
                "rho0": _known(snapshot.rho0),
                "basis_size": len(model),
                "samples": snapshot.samples,
                "noise_sd": math.sqrt(model.kernel.noise_variance),
                "signal_sd": math.sqrt(model.kernel.signal_variance),
                "coverage_95": _known(snapshot.calibration.coverage_95),
            },
            log_time=at,
        )

    def _grid(
        self, name: str, values: FloatArray, colours: Colours, stamp: messages.Timestamp
    ) -> messages.Grid:
        """A map, rows from south to north: the value, NaN where there is no water, and its colour, clear there."""
        cells = np.zeros(values.shape, dtype=_CELL)
        cells["value"] = np.where(self._dry, np.nan, values)
        cells["colour"][..., :3] = colours.of(values)
        cells["colour"][..., 3] = np.where(self._dry, 0, 255)
        kinds = messages.PackedElementFieldNumericType
        fields = [messages.PackedElementField(name=name, offset=0, type=kinds.Float32)]
        fields += [
            messages.PackedElementField(name=part, offset=4 + i, type=kinds.Uint8)
            for i, part in enumerate(("red", "green", "blue", "alpha"))
        ]
        return messages.Grid(
            timestamp=stamp,
            frame_id=FRAME,
            pose=self._corner,
            column_count=len(self._x),
            cell_size=messages.Vector2(x=self._cell_m, y=self._cell_m),
            row_stride=_CELL.itemsize * len(self._x),
            cell_stride=_CELL.itemsize,
            fields=fields,
            data=cells.tobytes(),
        )

    def _put_state(self, state: State, at: int, stamp: messages.Timestamp) -> None:
        if state.lat_deg is None or state.lon_deg is None:
            return
        heading = None if state.heading_deg is None else math.radians(state.heading_deg)
        self._fix.log(
            messages.LocationFix(
                timestamp=stamp,
                frame_id=self._vehicle,
                latitude=state.lat_deg,
                longitude=state.lon_deg,
                heading=heading,
                position_covariance_type=messages.LocationFixPositionCovarianceType.Unknown,
            ),
            log_time=at,
        )
        x, y = self._subject.frame.to_local(state.lat_deg, state.lon_deg).tolist()
        # Headings go clockwise from north, rotations anticlockwise from east.
        half = 0.0 if heading is None else (math.pi / 2.0 - heading) / 2.0
        self._transform.log(
            messages.FrameTransform(
                timestamp=stamp,
                parent_frame_id=FRAME,
                child_frame_id=self._vehicle,
                translation=messages.Vector3(x=x, y=y, z=0.0),
                rotation=messages.Quaternion(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)),
            ),
            log_time=at,
        )

    def _put_plan(self, dated: DatedPlan, at: int, stamp: messages.Timestamp) -> None:
        plan = dated.plan
        corners = (plan.start_deg, *plan.route_deg)
        places = [position(*corner) for corner in corners]
        what = {"kind": "plan", "plan": plan.sequence, "planner": plan.planner, "reason": plan.reason}
        spots = [place for place, is_spot in zip(places[1:], plan.is_spot, strict=True) if is_spot]
        drawn = [feature({"type": "Point", "coordinates": spot}, {"kind": "spot"}) for spot in spots]
        if len(places) > 1:
            drawn.insert(0, feature(line(places), what))
        collection = {"type": "FeatureCollection", "features": drawn}
        self._route.log(messages.GeoJson(geojson=json.dumps(collection, allow_nan=False)), log_time=at)
        lat, lon = zip(*corners, strict=True)
        points = self._subject.frame.to_local(lat, lon).tolist()
        self._scene.log(
            messages.SceneUpdate(entities=[self._entity(points, plan.is_spot, stamp)]), log_time=at
        )

    def _entity(
        self, points: list[list[float]], is_spot: tuple[bool, ...], stamp: messages.Timestamp
    ) -> messages.SceneEntity:
        size = 2.0 * self._cell_m
        route = messages.LinePrimitive(
            type=messages.LinePrimitiveLineType.LineStrip,
            thickness=2.0,
            scale_invariant=True,
            points=[messages.Point3(x=x, y=y, z=0.0) for x, y in points],
            color=_ROUTE,
        )
        spots = [
            messages.SpherePrimitive(
                pose=messages.Pose(
                    position=messages.Vector3(x=x, y=y, z=0.0),
                    orientation=messages.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
                ),
                size=messages.Vector3(x=size, y=size, z=size),
                color=_SPOT,
            )
            for (x, y), marked in zip(points[1:], is_spot, strict=True)
            if marked
        ]
        return messages.SceneEntity(
            timestamp=stamp, frame_id=FRAME, id="plan", lines=[route], spheres=spots, frame_locked=True
        )


def _axis(low: float, high: float, step: float) -> FloatArray:
    """Middles of cells from `low` on, to `high` at least."""
    count = max(1, math.ceil((high - low) / step - 1e-9))
    return np.asarray(low + (np.arange(count, dtype=float) + 0.5) * step, dtype=float)


def _known(value: float | None) -> float | None:
    """JSON has neither NaN nor infinities."""
    return value if value is not None and math.isfinite(value) else None
