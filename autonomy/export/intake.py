"""All that is exported of one vehicle is taken here, in any order and with doubles, into a database on the disk.

Memory stays bounded however long the survey was.
"""

import json
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from autonomy import wire
from autonomy.effects import Topic
from autonomy.export.archive import Archive
from autonomy.export.clock import Clock
from autonomy.export.values import ExportError, Window
from autonomy.wire import HealthNotice, LogNotice, ModelSnapshot, ObservationNotice, PlanNotice, SurveyNotice

_SURVEYS = 100
"""Different notices of the survey that are remembered; there is a new one when the fence changes."""

_TABLES = """
PRAGMA journal_mode = OFF;
PRAGMA synchronous = OFF;
CREATE TABLE models (id INTEGER PRIMARY KEY, run INTEGER, model_time REAL, utc REAL, subject TEXT, components INTEGER,
    payload BLOB);
CREATE TABLE plans (id INTEGER PRIMARY KEY, run INTEGER, model_time REAL, received REAL, utc REAL, payload BLOB UNIQUE);
CREATE TABLE states (id INTEGER PRIMARY KEY, run INTEGER, model_time REAL, lat REAL, lon REAL, heading REAL, speed REAL,
    samples INTEGER, basis_size INTEGER, rho REAL, state TEXT, reason TEXT);
CREATE TABLE lines (run INTEGER, number INTEGER, model_time REAL, received REAL, utc REAL, level TEXT, text TEXT,
    PRIMARY KEY (run, number)) WITHOUT ROWID;
CREATE TABLE readings (run INTEGER, number INTEGER, model_time REAL, lat REAL, lon REAL, value REAL, flag INTEGER,
    checks BLOB, PRIMARY KEY (run, number)) WITHOUT ROWID;
"""


class Intake:
    """One vehicle's survey comes in: fill it with `take_…`, `finish`, read what that gives, `close`.

    Args:
        path: of the database, which must not exist.
        vehicle: its name.
        every_s: shortest model time between two models that are kept; the newest of each run is kept too.
        regret: is told, for a person, what can't be used and why.
    """

    def __init__(self, path: Path, vehicle: str, every_s: float, regret: Callable[[str], None]) -> None:
        self.vehicle = vehicle
        self._surveys: list[SurveyNotice] = []
        self._every_s = every_s
        self._regret = regret
        self._clock = Clock()
        self._database = sqlite3.connect(path, isolation_level=None)
        self._database.executescript(_TABLES)
        self._database.execute("BEGIN")
        self._runs: dict[int, int] = {}
        self._announced: dict[int, int] = {}
        self._moments: dict[int, float] = {}
        self._kept: tuple[int, float] | None = None
        self._newest: tuple[int, float, float | None, bytes | ModelSnapshot] | None = None

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    def take_model(
        self,
        received_utc_s: float,
        run: int,
        model_time_s: float,
        utc_s: float | None,
        model: bytes | ModelSnapshot,
    ) -> None:
        """A model of a run, decoded or as it came; most are not kept."""
        index = self._index(run)
        self._moment(index, model_time_s, utc_s, received_utc_s)
        if self._newest is not None and self._newest[0] != index:
            self._keep(*self._newest)
        passed_s = model_time_s - self._kept[1] if self._kept and self._kept[0] == index else -1.0
        candidate = (index, model_time_s, utc_s, model)
        if 0.0 <= passed_s < self._every_s:
            self._newest = candidate if passed_s > 0.0 else self._newest
        else:
            self._keep(*candidate)

    def take_plan(self, received_utc_s: float, plan: PlanNotice) -> None:
        """A plan; doubles are left out."""
        index = self._index(plan.run)
        row = (index, self._moments.get(index), received_utc_s, plan.utc_s, wire.encode(plan))
        self._insert("plans (run, model_time, received, utc, payload)", row)

    def take_survey(self, survey: SurveyNotice) -> None:
        """Where the survey is."""
        if survey in self._surveys:
            self._surveys.remove(survey)
        self._surveys.append(survey)
        del self._surveys[:-_SURVEYS]

    def take_state(self, received_utc_s: float, health: HealthNotice) -> None:
        """A report of health."""
        if health.model_time_s is None:
            return
        index = self._index(health.run)
        self._moment(index, health.model_time_s, health.utc_s, received_utc_s)
        place = (health.lat_deg, health.lon_deg, health.heading_deg, health.groundspeed_mps)
        figures = (health.samples, health.basis_size, health.rho)
        words = (health.state, health.reason)
        columns = "run, model_time, lat, lon, heading, speed, samples, basis_size, rho, state, reason"
        self._insert(f"states ({columns})", (index, health.model_time_s, *place, *figures, *words))

    def take_readings(self, run: int, first: int, readings: Sequence[ObservationNotice]) -> None:
        """Readings of a run, numbered from `first` on; those that are there already are left out."""
        index = self._index(run)
        rows = (
            (
                index,
                first + i,
                one.model_time_s,
                one.lat_deg,
                one.lon_deg,
                one.value,
                one.flag,
                bytes(one.checks),
            )
            for i, one in enumerate(readings)
        )
        self._database.executemany(f"INSERT OR IGNORE INTO readings VALUES ({_marks(8)})", rows)
        self.announce(run, first + len(readings))

    def take_lines(self, received_utc_s: float, run: int, first: int, lines: Sequence[LogNotice]) -> None:
        """Lines of the log of a run, numbered from `first` on; those that are there already are left out."""
        index = self._index(run)
        rows = (
            (index, first + i, self._moments.get(index), received_utc_s, one.utc_s, one.level, one.text)
            for i, one in enumerate(lines)
        )
        self._database.executemany(f"INSERT OR IGNORE INTO lines VALUES ({_marks(7)})", rows)

    def announce(self, run: int, end: int) -> None:
        """The vehicle says that it has told so many readings in a run."""
        index = self._index(run)
        self._announced[index] = max(end, self._announced.get(index, 0))

    def finish(self, window: Window, *, date_by_arrival: bool) -> Archive:
        """All is taken: what lies in `window` can be read.

        Args:
            window: what is to be read.
            date_by_arrival: whether runs in which the vehicle never knew UTC are dated by the clock of whoever
                received what it told.

        Returns:
            What is read from this database, which must stay open.

        Raises:
            ExportError: nothing dates what there is.
        """
        if self._newest is not None:
            self._keep(*self._newest)
        self._clock.by_arrival = date_by_arrival
        if not date_by_arrival:
            self._leave_out_idle_runs()
            undated = self._undated("models", "states", "readings")
            if undated:
                raise ExportError(
                    f"{self.vehicle} did not tell UTC in {len(undated)} of its runs, as its reports do once it knows "
                    "it, so nothing says when that was; --date-by-arrival dates them by the clock of whoever received "
                    "what it told"
                )
        for table in ("plans", "lines"):
            # What was heard before the vehicle said any time is dated by the first that it said.
            first = f"SELECT model_time FROM states WHERE states.run = {table}.run ORDER BY id LIMIT 1"
            self._database.execute(f"UPDATE {table} SET model_time = ({first}) WHERE model_time IS NULL")
        self._date("models", "NULL")
        self._date("plans", "received")
        for run, end in self._announced.items():
            (count,) = self._select("SELECT COUNT(*) FROM readings WHERE run = ?", run).fetchone()
            if count < end:
                self._regret(f"{end - count} of {end} observations of a run of {self.vehicle} are missing")
        return Archive(self.vehicle, tuple(self._surveys), self._database, self._clock, window)

    def _date(self, table: str, received: str) -> None:
        """Date what of a table the vehicle did not date, by its clock."""
        undated = self._select(f"SELECT id, run, model_time, {received} FROM {table} WHERE utc IS NULL")
        for number, run, at, received_utc_s in undated.fetchall():
            utc_s = self._clock.moment(run, at, received_utc_s)
            self._database.execute(f"UPDATE {table} SET utc = ? WHERE id = ?", (utc_s, number))

    def _undated(self, *tables: str) -> set[int]:
        """The runs in these tables whose time nothing tells."""
        runs = self._select(" UNION ".join(f"SELECT run FROM {table}" for table in tables))
        return {run for (run,) in runs if not self._clock.knows(run)}

    def _leave_out_idle_runs(self) -> None:
        """Runs without UTC in which nothing was read, such as a start at the quay, do not keep the others back."""
        idle = self._undated("states", "plans", "lines") - self._undated("models", "readings")
        for run in idle:
            self._database.execute("DELETE FROM states WHERE run = ?", (run,))
            self._database.execute("DELETE FROM plans WHERE run = ? AND utc IS NULL", (run,))
            self._database.execute("DELETE FROM lines WHERE run = ? AND utc IS NULL", (run,))
        if idle:
            self._regret(f"left out: {len(idle)} runs of {self.vehicle} without a reading, a model or UTC")

    def _index(self, run: int) -> int:
        """Our number of a run: from 1 on, as they were heard of."""
        return self._runs.setdefault(run, len(self._runs) + 1)

    def _moment(self, index: int, model_time_s: float, utc_s: float | None, received_utc_s: float) -> None:
        self._moments[index] = model_time_s
        self._clock.arrived(index, model_time_s, received_utc_s)
        if utc_s is not None:
            self._clock.tell(index, model_time_s, utc_s)

    def _keep(self, run: int, model_time_s: float, utc_s: float | None, model: bytes | ModelSnapshot) -> None:
        self._kept, self._newest = (run, model_time_s), None
        try:
            snapshot = wire.decode(Topic.MODEL, model) if isinstance(model, bytes) else model
        except wire.WireError as error:
            self._regret(f"a model of {self.vehicle} can't be read, left out: {error}")
            return
        assert isinstance(snapshot, ModelSnapshot)
        origin = (snapshot.origin_lat_deg, snapshot.origin_lon_deg)
        subject = json.dumps([snapshot.variable, snapshot.units, *origin, *snapshot.bounds_m])
        components = len(snapshot.kernel.components)
        payload = model if isinstance(model, bytes) else wire.encode(model)
        columns = "run, model_time, utc, subject, components, payload"
        self._insert(f"models ({columns})", (run, model_time_s, utc_s, subject, components, payload))

    def _insert(self, into: str, row: tuple[Any, ...]) -> None:
        self._database.execute(f"INSERT OR IGNORE INTO {into} VALUES ({_marks(len(row))})", row)

    def _select(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
        return self._database.execute(sql, parameters)


def _marks(count: int) -> str:
    return ", ".join("?" * count)
