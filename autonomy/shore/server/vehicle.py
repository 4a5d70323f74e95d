"""What the server remembers of one vehicle: the latest of everything, and a history that stays small."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from autonomy.shore.server import plain
from autonomy.shore.server.plain import Plain
from autonomy.shore.server.thinning import Rows, Stops
from autonomy.wire import (
    HealthNotice,
    LogBatch,
    LogNotice,
    ModelSnapshot,
    ObservationBatch,
    PlanNotice,
    SurveyNotice,
)

_TRACK_ROWS = 2000
_SERIES_ROWS = 1000
_PLANS = 300
_LOG_LINES = 200
_LOG_CHARACTERS = 50_000
# What is kept of every model; and then its length-scales.
_SERIES = ("utc_s", "model_time_s", "rho", "basis_size", "noise_sd", "samples")
_MAXIMUM_LENGTHSCALES = 16


@dataclass
class _Taken:
    """How far has been taken what a vehicle tells in order: it tells again what a recording had already.

    Of one run of its software, the newest: no other is told again.
    """

    run: int | None = None
    end: int = 0

    def before(self, batch: ObservationBatch | LogBatch) -> int:
        """How many items of a batch, the first ones, have been taken before; now all have."""
        known = max(0, self.end - batch.first) if batch.run == self.run else 0
        self.end = max(batch.first + len(batch.items), self.end if batch.run == self.run else 0)
        self.run = batch.run
        return known


class Vehicle:
    """One vehicle. Not for several threads: its fleet has the lock."""

    def __init__(self, name: str, history_bytes: int) -> None:
        self.name = name
        self.alive = False
        self.heard_utc_s = -math.inf
        self.newest: tuple[float, bytes] | None = None
        self._ahead_s = 0.0
        self._model: Plain | None = None
        self.stops = Stops(history_bytes)
        self._model_survey: Plain | None = None
        self.survey_notice: SurveyNotice | None = None
        self.surveys = 0
        self._plan: Plain | None = None
        self._health: Plain | None = None
        self._survey: Plain | None = None
        self._track = Rows(5, _TRACK_ROWS)
        self._series = Rows(len(_SERIES) + _MAXIMUM_LENGTHSCALES, _SERIES_ROWS)
        self._plans: deque[Plain] = deque(maxlen=_PLANS)
        self._log: deque[Plain] = deque(maxlen=_LOG_LINES)
        self._log_characters = 0
        self._taken = {ObservationBatch: _Taken(), LogBatch: _Taken()}

    def learn(self, value: ModelSnapshot, payload: bytes, received_utc_s: float) -> Plain:
        """Take a model and the bytes that it came in; only they are kept, for there may be many vehicles."""
        # A vehicle that doesn't know the time yet has its models by the time at which they came.
        stamp_s = received_utc_s if value.utc_s is None else value.utc_s
        # A simulation in a hurry runs ahead of our clock, and its plans with it.
        self._ahead_s = max(0.0, stamp_s - received_utc_s)
        self.newest = stamp_s, payload
        self.stops.add(stamp_s, payload)
        self._model = plain.model(value, stamp_s)
        self._model_survey = plain.survey_of_model(value)
        kernel = value.kernel
        scales = [scale for each in kernel.components for scale in each.space.lengthscales_m]
        row = np.full(len(_SERIES) + _MAXIMUM_LENGTHSCALES, math.nan)
        row[: len(_SERIES)] = (
            stamp_s,
            value.model_time_s,
            value.rho,
            len(value.model),
            math.sqrt(kernel.noise_variance),
            value.samples,
        )
        row[len(_SERIES) :][: len(scales)] = scales
        self._series.add(row)
        return self._model

    def survey(self, value: SurveyNotice) -> Plain:
        """Take what is surveyed."""
        if value != self.survey_notice:
            self.survey_notice = value
            self.surveys += 1
        self._survey = plain.survey(value)
        return self._survey

    def plan(self, value: PlanNotice, received_utc_s: float) -> Plain:
        """Take a plan."""
        stamp_s = received_utc_s + self._ahead_s if value.utc_s is None else value.utc_s
        self._plan = plain.plan(value, stamp_s)
        names = ("mutual_information", "planner", "reason", "expected_rmse", "sequence")
        self._plans.append({"utc_s": stamp_s, **{name: getattr(value, name) for name in names}})
        return self._plan

    def health(self, value: HealthNotice, received_utc_s: float) -> Plain:
        """Take how it is."""
        self._health = plain.health(value, received_utc_s)
        return self._health

    def observe(self, batch: ObservationBatch) -> list[list[float]]:
        """Take readings; those that are new."""
        rows = plain.observations(batch.items[self._taken[ObservationBatch].before(batch) :])
        for row in rows:
            self._track.add(row)
        return rows

    def log(self, batch: LogBatch, received_utc_s: float) -> list[Plain]:
        """Take lines of its log; those that are new."""
        lines = batch.items[self._taken[LogBatch].before(batch) :]
        return [self._log_line(line, received_utc_s) for line in lines]

    def _log_line(self, value: LogNotice, received_utc_s: float) -> Plain:
        utc_s = received_utc_s if value.utc_s is None else value.utc_s
        line = {"utc_s": utc_s, "level": value.level, "text": value.text}
        if len(self._log) == _LOG_LINES:
            self._log_characters -= len(self._log.popleft()["text"])
        self._log.append(line)
        self._log_characters += len(value.text)
        while self._log_characters > _LOG_CHARACTERS:
            self._log_characters -= len(self._log.popleft()["text"])
        return line

    def summary(self, utc_s: float) -> Plain:
        """A line of the fleet's list, at a time in seconds since 1970."""
        health, model = self._health, self._model
        return {
            "vehicle": self.name,
            "alive": self.alive,
            "state": health and health["state"],
            "reason": health and health["reason"],
            "variable": model and model["variable"],
            "units": model and model["units"],
            "samples": (health or model or {}).get("samples"),
            "lat": health and health["lat_deg"],
            "lon": health and health["lon_deg"],
            "age_s": round(max(0.0, utc_s - self.heard_utc_s), 1),
        }

    def everything(self) -> Plain:
        """The latest of everything."""
        return {
            "vehicle": self.name,
            "alive": self.alive,
            # Where no more has come, what the model says of it.
            "survey": self._survey or self._model_survey,
            "model": self._model,
            "plan": self._plan,
            "health": self._health,
            "track": self._track.all().tolist(),
            "log": list(self._log),
        }

    @property
    def rho0(self) -> float | None:
        """The share of new basis vectors at which everything is estimated and planned anew."""
        return None if self._model is None else self._model["rho0"]

    def history(self) -> Plain:
        """The slider's stops and what has changed over time."""
        table = self._series.all()
        series: dict[str, Any] = {name: table[:, column].tolist() for column, name in enumerate(_SERIES)}
        scales = table[:, len(_SERIES) :]
        series["lengthscales_m"] = [row[~np.isnan(row)].tolist() for row in scales]
        series["rho0"] = self.rho0
        return {"models": self.stops.times_s, "series": series, "plans": list(self._plans)}
