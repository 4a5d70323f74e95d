"""All vehicles that the server has heard of, taken in by one thread and read by others."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from autonomy.effects import Topic
from autonomy.shore.server.land import Ring
from autonomy.shore.server.plain import Plain
from autonomy.shore.server.vehicle import Vehicle
from autonomy.shore.subscriber import Presence, Update
from autonomy.wire import (
    HealthNotice,
    LogBatch,
    ModelSnapshot,
    ObservationBatch,
    PlanNotice,
    SurveyNotice,
)

_HISTORY_BYTES = 128 * 2**20
_LARGEST_HISTORY_BYTES = 64 * 2**20
_MAXIMUM_VEHICLES = 256


@dataclass(frozen=True)
class Message:
    """News of one vehicle for the pages: `data` has the shape that docs/page.md gives it."""

    kind: str
    vehicle: str
    data: Any


class UnknownVehicleError(Exception):
    """A vehicle of that name has not been heard of."""


class Fleet:
    """What is known of each vehicle; histories of all of them together stay within `history_bytes`."""

    def __init__(self, history_bytes: int = _HISTORY_BYTES) -> None:
        self._listeners: list[Callable[[Message], None]] = []
        self._history_bytes = history_bytes
        self._lock = threading.Lock()
        self._vehicles: dict[str, Vehicle] = {}

    def tell(self, listener: Callable[[Message], None]) -> None:
        """Call `listener` with all news from now on, in the thread that brings them; it must not block."""
        self._listeners.append(listener)

    def take(
        self, update: Update, payload: bytes | None, received_utc_s: float, is_news: bool = True
    ) -> None:
        """Take what has come in, and `payload`, the bytes that a model came in; tell the listeners if it is news."""
        with self._lock:
            vehicle = self._known(update.vehicle, update.value == Presence(True))
            if vehicle is None:
                return
            vehicle.heard_utc_s = received_utc_s
            messages = [
                Message(kind, vehicle.name, data)
                for kind, data in _told(vehicle, update, payload, received_utc_s)
            ]
        for message in messages if is_news else ():
            for listener in self._listeners:
                listener(message)

    def _known(self, name: str, is_there: bool) -> Vehicle | None:
        """The vehicle; if it is new, where there is room, or where it is there and another is gone. Else None."""
        vehicle = self._vehicles.get(name)
        if vehicle is not None:
            return vehicle
        if len(self._vehicles) >= _MAXIMUM_VEHICLES:
            gone = [each for each in self._vehicles.values() if not each.alive]
            if not (gone and is_there):
                return None
            del self._vehicles[min(gone, key=lambda each: each.heard_utc_s).name]
        share = min(_LARGEST_HISTORY_BYTES, self._history_bytes // (len(self._vehicles) + 1))
        for each in self._vehicles.values():
            each.stops.limit(share)
        self._vehicles[name] = Vehicle(name, share)
        return self._vehicles[name]

    def _of(self, name: str) -> Vehicle:
        if name not in self._vehicles:
            raise UnknownVehicleError(f"{name} has not been heard of")
        return self._vehicles[name]

    def __len__(self) -> int:
        return len(self._vehicles)

    def summaries(self) -> list[Plain]:
        """The fleet's list, by name."""
        with self._lock:
            utc_s = time.time()
            return [self._vehicles[name].summary(utc_s) for name in sorted(self._vehicles)]

    def everything(self, name: str) -> Plain:
        """The latest of everything of one vehicle. Raises UnknownVehicleError."""
        with self._lock:
            return self._of(name).everything()

    def history(self, name: str) -> Plain:
        """The slider's stops of one vehicle, and its series. Raises UnknownVehicleError."""
        with self._lock:
            return self._of(name).history()

    def land(self, name: str) -> tuple[int, tuple[Ring, ...]]:
        """The rings around land, and a number that changes with them. Raises UnknownVehicleError."""
        with self._lock:
            vehicle = self._of(name)
            notice = vehicle.survey_notice
            return vehicle.surveys, () if notice is None else notice.land

    def model(self, name: str, at_s: float | None) -> tuple[float, bytes] | None:
        """A stop and the model of then, as it came: that which came last for None, else the newest that is no later.

        What is before the first stop has that. None before there is a model.
        Raises UnknownVehicleError.
        """
        with self._lock:
            vehicle = self._of(name)
            return vehicle.newest if at_s is None or vehicle.newest is None else vehicle.stops.at(at_s)


def _told(
    vehicle: Vehicle, update: Update, payload: bytes | None, received_utc_s: float
) -> Iterator[tuple[str, Any]]:
    """Tell a vehicle's record what has come in; kinds of news and their data."""
    match update.value:
        case Presence(alive):
            vehicle.alive = alive
            yield "presence", alive
        case ModelSnapshot() as model if payload is not None:
            yield Topic.MODEL.value, vehicle.learn(model, payload, received_utc_s)
        case PlanNotice() as plan:
            yield Topic.PLAN.value, vehicle.plan(plan, received_utc_s)
        case HealthNotice() as health:
            yield Topic.HEALTH.value, vehicle.health(health, received_utc_s)
        case SurveyNotice() as survey:
            yield Topic.SURVEY.value, vehicle.survey(survey)
        case ObservationBatch() as batch:
            if rows := vehicle.observe(batch):
                yield Topic.OBSERVATIONS.value, rows
        case LogBatch() as batch:
            for line in vehicle.log(batch, received_utc_s):
                yield Topic.LOG.value, line
