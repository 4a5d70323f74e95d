"""What the server remembers of one vehicle: the latest of everything, and a history that stays small."""

import math
from collections import deque
from typing import Any

import numpy as np

from autonomy.shore.server import plain
from autonomy.shore.server.plain import Plain
from autonomy.shore.server.thinning import Rows, Stops
from autonomy.wire import HealthNotice, LogNotice, ModelSnapshot, ObservationNotice, PlanNotice

_TRACK_ROWS = 2000
_SERIES_ROWS = 1000
_PLANS = 300
_LOG_LINES = 200
_LOG_CHARACTERS = 50_000
# Of a model: its time, ρ, basis vectors, standard deviation of the noise, samples; and then the length-scales.
_SERIES = ("utc_s", "rho", "basis_size", "noise_sd", "samples")
_MAXIMUM_LENGTHSCALES = 16


class Vehicle:
    """One vehicle. Not for several threads: its fleet has the lock."""

    def __init__(self, name: str, history_bytes: int) -> None:
        self.name = name
        self.alive = False
        self.heard_s = -math.inf
        self.model: ModelSnapshot | None = None
        self.model_stamp_s = math.nan
        self.stops = Stops(history_bytes)
        self._plan: tuple[PlanNotice, float] | None = None
        self._health: tuple[HealthNotice, float] | None = None
        self._track = Rows(5, _TRACK_ROWS)
        self._series = Rows(len(_SERIES) + _MAXIMUM_LENGTHSCALES, _SERIES_ROWS)
        self._plans: deque[Plain] = deque(maxlen=_PLANS)
        self._log: deque[Plain] = deque(maxlen=_LOG_LINES)
        self._log_characters = 0

    def learn(self, value: ModelSnapshot, payload: bytes, received_utc_s: float) -> Plain:
        """Take a model and the bytes that it came in."""
        self.model = value
        # A vehicle that doesn't know the time yet has its models by the time at which they came.
        self.model_stamp_s = received_utc_s if value.utc_s is None else value.utc_s
        self.stops.add(self.model_stamp_s, payload)
        kernel = value.model.kernel
        scales = [scale for each in kernel.components for scale in each.space.lengthscales_m]
        row = np.full(len(_SERIES) + _MAXIMUM_LENGTHSCALES, math.nan)
        row[: len(_SERIES)] = (
            self.model_stamp_s,
            value.rho,
            len(value.model),
            math.sqrt(kernel.noise_variance),
            value.samples,
        )
        row[len(_SERIES) :][: len(scales)] = scales
        self._series.add(row)
        return plain.model(value, self.model_stamp_s)

    def plan(self, value: PlanNotice, received_utc_s: float) -> Plain:
        """Take a plan."""
        self._plan = (value, received_utc_s)
        names = ("mutual_information", "planner", "reason", "expected_rmse", "sequence")
        self._plans.append({"utc_s": received_utc_s, **{name: getattr(value, name) for name in names}})
        return plain.plan(value, received_utc_s)

    def health(self, value: HealthNotice, received_utc_s: float) -> Plain:
        """Take how it is."""
        self._health = (value, received_utc_s)
        return plain.health(value, received_utc_s)

    def observe(self, values: tuple[ObservationNotice, ...]) -> list[list[float]]:
        """Take readings."""
        rows = plain.observations(values)
        for row in rows:
            self._track.add(row)
        return rows

    def log(self, value: LogNotice, received_utc_s: float) -> Plain:
        """Take a line of its log."""
        line = {"utc_s": received_utc_s, "level": value.level, "text": value.text}
        if len(self._log) == _LOG_LINES:
            self._log_characters -= len(self._log.popleft()["text"])
        self._log.append(line)
        self._log_characters += len(value.text)
        while self._log_characters > _LOG_CHARACTERS:
            self._log_characters -= len(self._log.popleft()["text"])
        return line

    def summary(self, now_s: float) -> Plain:
        """A line of the fleet's list; `now_s` by the clock of `heard_s`."""
        health = None if self._health is None else self._health[0]
        model = self.model
        return {
            "vehicle": self.name,
            "alive": self.alive,
            "state": None if health is None else health.state,
            "reason": None if health is None else health.reason,
            "variable": None if model is None else model.variable,
            "units": None if model is None else model.units,
            "samples": model.samples if health is None and model is not None else health and health.samples,
            "lat": None if health is None else health.lat_deg,
            "lon": None if health is None else health.lon_deg,
            "age_s": None if math.isinf(self.heard_s) else round(now_s - self.heard_s, 1),
        }

    def everything(self) -> Plain:
        """The latest of everything."""
        model = self.model
        return {
            "vehicle": self.name,
            "alive": self.alive,
            "survey": self.survey(),
            "model": None if model is None else plain.model(model, self.model_stamp_s),
            "plan": None if self._plan is None else plain.plan(*self._plan),
            "health": None if self._health is None else plain.health(*self._health),
            "track": self._track.all().tolist(),
            "log": list(self._log),
        }

    def survey(self) -> Plain | None:
        """The area, and what is known of it; None before there is a model."""
        if self.model is None:
            return None
        return {
            "name": None,
            "variable": self.model.variable,
            "long_name": self.model.variable.replace("_", " "),
            "units": self.model.units,
            "rho0": None if self._health is None else self._health[0].rho0,
            "land": [],
            "keep_in": [],
            "keep_out": [],
            "fence": [],
            "bounds": plain.bounds(self.model),
        }

    def history(self) -> Plain:
        """The slider's stops and what has changed over time."""
        table = self._series.all()
        series: dict[str, Any] = {name: table[:, column].tolist() for column, name in enumerate(_SERIES)}
        scales = table[:, len(_SERIES) :]
        series["lengthscales_m"] = [row[~np.isnan(row)].tolist() for row in scales]
        series["rho0"] = None if self._health is None else self._health[0].rho0
        return {"models": self.stops.times_s, "series": series, "plans": list(self._plans)}
