"""Track, plans and sampling spots as GeoJSON (RFC 7946)."""

import json
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from autonomy.export.archive import Archive
from autonomy.export.values import DatedPlan, iso_utc
from autonomy.planning.plan_geojson import feature, line, position

_PIECE = 20_000
"""Most positions in a feature of the track."""

_LEAST_STEP_DEG = 1e-5
"""Of latitude or longitude: positions nearer to the last one, about a metre, add nothing to a track."""


def write_geojson(path: Path, archive: Archive) -> int:
    """Write the track, every plan's route, and every plan's spots; returns how many features that is.

    The newest plan has `newest` true. Positions of the track are where the vehicle said it was; those less than
    a metre from the one before are left out.

    Raises:
        OSError: the file can't be written.
    """
    count = 0
    with path.open("w", encoding="utf-8") as file:
        file.write('{"type": "FeatureCollection", "features": [')
        for each in chain(_tracks(archive), _plans(archive)):
            file.write(",\n" if count else "\n")
            json.dump(each, file, ensure_ascii=False, allow_nan=False)
            count += 1
        file.write("\n]}\n")
    return count


def _tracks(archive: Archive) -> Iterator[dict[str, Any]]:
    """The track in pieces, each of which begins where the one before ends."""
    positions: list[list[float]] = []
    times: list[float] = []
    for state in archive.states():
        if state.lat_deg is None or state.lon_deg is None:
            continue
        here = position(state.lat_deg, state.lon_deg)
        if positions and max(abs(a - b) for a, b in zip(here, positions[-1], strict=True)) < _LEAST_STEP_DEG:
            continue
        positions.append(here)
        times.append(state.utc_s)
        if len(positions) == _PIECE:
            yield _track(archive.vehicle, positions, times)
            positions, times = positions[-1:], times[-1:]
    if len(positions) > 1:
        yield _track(archive.vehicle, positions, times)


def _track(vehicle: str, positions: list[list[float]], times: list[float]) -> dict[str, Any]:
    ends = {"start_utc": iso_utc(times[0]), "end_utc": iso_utc(times[-1])}
    return feature(line(positions), {"kind": "track", "vehicle": vehicle, **ends})


def _plans(archive: Archive) -> Iterator[dict[str, Any]]:
    before: DatedPlan | None = None
    for dated in archive.plans():
        if before is not None:
            yield from _plan(archive.vehicle, before, newest=False)
        before = dated
    if before is not None:
        yield from _plan(archive.vehicle, before, newest=True)


def _plan(vehicle: str, dated: DatedPlan, *, newest: bool) -> Iterator[dict[str, Any]]:
    plan = dated.plan
    common = {"vehicle": vehicle, "utc": iso_utc(dated.utc_s), "plan": plan.sequence, "newest": newest}
    corners = [position(*corner) for corner in (plan.start_deg, *plan.route_deg)]
    if len(corners) > 1:
        what = {
            "kind": "plan",
            **common,
            "planner": plan.planner,
            "reason": plan.reason,
            "mutual_information": plan.mutual_information,
            "objective_before": plan.objective_before,
            "objective_after": plan.objective_after,
            "expected_rmse": plan.expected_rmse,
            "seed": plan.seed,
            "model_version": plan.model_version,
        }
        yield feature(line(corners), what)
    spots = [corner for corner, is_spot in zip(corners[1:], plan.is_spot, strict=True) if is_spot]
    for number, spot in enumerate(spots, start=1):
        yield feature({"type": "Point", "coordinates": spot}, {"kind": "spot", **common, "number": number})
