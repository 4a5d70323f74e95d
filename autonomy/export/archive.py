"""All that is exported of one vehicle, in order and without doubles, from the database that an intake has filled.

Memory stays bounded however long the survey was: what is read comes row by row.
"""

import json
import sqlite3
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from autonomy import wire
from autonomy.effects import Topic
from autonomy.export.clock import Clock
from autonomy.export.values import (
    DatedLine,
    DatedModel,
    DatedPlan,
    ExportError,
    Origin,
    Readings,
    State,
    Subject,
    Window,
    iso_utc,
)
from autonomy.geometry import LocalFrame
from autonomy.quality import Check
from autonomy.wire import LogNotice, ModelSnapshot, PlanNotice, SurveyNotice

_ROWS = 4096
"""Readings handled at once."""

_WITHIN = "utc BETWEEN ? AND ?"


class Archive:
    """One vehicle's survey, to be read.

    Args:
        vehicle: its name.
        surveys: different notices of where the survey is and its land, oldest first.
        database: that holds the rest, with the tables of `autonomy.export.intake`.
        clock: dates what says no time itself.
        window: what of it is to be read.
    """

    def __init__(
        self,
        vehicle: str,
        surveys: Sequence[SurveyNotice],
        database: sqlite3.Connection,
        clock: Clock,
        window: Window,
    ) -> None:
        self.vehicle = vehicle
        self.surveys = surveys
        self._database = database
        self._clock = clock
        self._window = window

    @property
    def dated_by_arrival(self) -> bool:
        """Whether it was let be dated by arrivals, and something had to."""
        return self._clock.by_arrival and self._clock.guesses

    def subject(self) -> Subject:
        """What was surveyed, as the models say, or the survey's notice where there are only readings.

        Raises:
            ExportError: neither says it, or there are several.
        """
        sql = f"SELECT subject, MIN(utc) FROM models WHERE {_WITHIN} GROUP BY subject ORDER BY MIN(utc)"
        found = self._select(sql, *self._ends).fetchall()
        if not found:
            return self._told_subject()
        if len(found) > 1:
            others = ", ".join(iso_utc(utc_s) for _, utc_s in found[1:])
            raise ExportError(
                f"{self.vehicle} surveyed another area or variable from {others} on; "
                "export one at a time, with --from and --until"
            )
        variable, units, lat_deg, lon_deg, *bounds_m = json.loads(found[0][0])
        x_min, y_min, x_max, y_max = bounds_m
        return Subject(variable, units, LocalFrame(lat_deg, lon_deg), (x_min, y_min, x_max, y_max))

    def _told_subject(self) -> Subject:
        """What the readings are of, as was told without a model."""
        if not self.surveys or next(self.readings(), None) is None:
            raise ExportError(self._nothing)
        if len({(each.variable, each.units, each.bounds_deg) for each in self.surveys}) > 1:
            raise ExportError(
                f"{self.vehicle} told of several surveys, and there is no model to say of which this is"
            )
        notice = self.surveys[-1]
        south, west, north, east = notice.bounds_deg
        frame = LocalFrame((south + north) / 2.0, (west + east) / 2.0)
        x, y = np.transpose(frame.to_local([south, south, north, north], [west, east, west, east]))
        bounds_m = (float(x.min()), float(y.min()), float(x.max()), float(y.max()))
        return Subject(notice.variable, notice.units, frame, bounds_m)

    def origin(self) -> Origin:
        """Where all this comes from, as the newest model says, or the survey's notice if there is none."""
        newest = next(self._last(), None)
        if newest is None:
            return Origin(self.surveys[-1].name if self.surveys else "", "", "")
        one = newest.snapshot
        return Origin(one.survey, one.software_version, one.configuration_hash)

    def most_components(self) -> int:
        """The most components that a model's kernel has."""
        sql = f"SELECT COALESCE(MAX(components), 0) FROM models WHERE {_WITHIN}"
        (components,) = self._select(sql, *self._ends).fetchone()
        return int(components)

    def models(self) -> Iterator[DatedModel]:
        """The models that were kept, each later than the one before."""
        reached = -np.inf
        for utc_s, payload in self._select(
            f"SELECT utc, payload FROM models WHERE {_WITHIN} ORDER BY utc, id", *self._ends
        ):
            if utc_s > reached:
                reached = utc_s
                yield _dated(utc_s, payload)

    def newest(self) -> DatedModel:
        """The last model. Raises ExportError if there is none."""
        newest = next(self._last(), None)
        if newest is None:
            raise ExportError(self._nothing)
        return newest

    def _last(self) -> Iterator[DatedModel]:
        found = self._select(
            f"SELECT utc, payload FROM models WHERE {_WITHIN} ORDER BY utc DESC, id LIMIT 1", *self._ends
        )
        for utc_s, payload in found:
            yield _dated(utc_s, payload)

    def plans(self) -> Iterator[DatedPlan]:
        """The plans in the order in which they were made."""
        for utc_s, payload in self._select(
            f"SELECT utc, payload FROM plans WHERE {_WITHIN} ORDER BY utc, id", *self._ends
        ):
            plan = wire.decode(Topic.PLAN, payload)
            assert isinstance(plan, PlanNotice)
            yield DatedPlan(utc_s, plan)

    def lines(self) -> Iterator[DatedLine]:
        """The lines of the log, in order."""
        for run, at, received, utc, level, text in self._select(
            "SELECT run, model_time, received, utc, level, text FROM lines ORDER BY run, number"
        ):
            utc_s = self._clock.moment(run, at, received) if utc is None else utc
            if self._holds(utc_s):
                yield DatedLine(utc_s, LogNotice(level, text, utc))

    def states(self) -> Iterator[State]:
        """Where the vehicle was, and what it did, in order."""
        columns = "lat, lon, heading, speed, samples, basis_size, rho, state, reason"
        for run, at, *rest in self._select(f"SELECT run, model_time, {columns} FROM states ORDER BY id"):
            utc_s = float(self._clock.utc(run, at))
            if self._holds(utc_s):
                yield State(utc_s, *rest)

    def readings(self) -> Iterator[Readings]:
        """The readings in order, some thousands at a time."""
        found = self._select("SELECT * FROM readings ORDER BY run, number")
        while rows := found.fetchmany(_ROWS):
            part = self._columns(rows).within(self._window)
            if len(part):
                yield part

    def _columns(self, rows: list[tuple[Any, ...]]) -> Readings:
        run, _, *columns = zip(*rows, strict=True)
        # NaN goes into the database as NULL, and comes out as None.
        at, lat, lon, value = (np.array(column, dtype=float) for column in columns[:4])
        runs = np.array(run)
        utc = np.empty(len(at))
        for each in np.unique(runs):
            utc[runs == each] = self._clock.utc(int(each), at[runs == each])
        checks = np.frombuffer(b"".join(columns[5]), dtype=np.int8).reshape(-1, len(Check))
        return Readings(utc, at, lat, lon, value, np.array(columns[4], dtype=np.int8), checks)

    def _holds(self, utc_s: float) -> bool:
        return self._window.start_s <= utc_s <= self._window.end_s

    @property
    def _nothing(self) -> str:
        return f"there is no model of {self.vehicle} in what is to be exported"

    @property
    def _ends(self) -> tuple[float, float]:
        return self._window.start_s, self._window.end_s

    def _select(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
        return self._database.execute(sql, parameters)


def _dated(utc_s: float, payload: bytes) -> DatedModel:
    snapshot = wire.decode(Topic.MODEL, payload)
    assert isinstance(snapshot, ModelSnapshot)
    return DatedModel(utc_s, snapshot)
