"""All vehicles that the server has heard of, taken in by one thread and read by others."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from autonomy.effects import Topic
from autonomy.shore.server.plain import Plain
from autonomy.shore.server.vehicle import Vehicle
from autonomy.shore.subscriber import Presence, Update
from autonomy.wire import HealthNotice, LogNotice, ModelSnapshot, PlanNotice

_HISTORY_BYTES = 192 * 2**20
_LARGEST_HISTORY_BYTES = 64 * 2**20
_MAXIMUM_VEHICLES = 256


@dataclass(frozen=True)
class Message:
    """News of one vehicle for the pages: `data` has the shape that docs/page.md gives it."""

    kind: str
    vehicle: str
    data: Any


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

    def take(self, update: Update, payload: bytes | None, received_utc_s: float) -> None:
        """Take what has come in, and `payload`, the bytes that a model came in."""
        with self._lock:
            vehicle = self._known(update.vehicle)
            if vehicle is None:
                return
            vehicle.heard_s = time.monotonic()
            message = self._message(vehicle, update, payload, received_utc_s)
        for listener in self._listeners:
            listener(message)

    def _message(
        self, vehicle: Vehicle, update: Update, payload: bytes | None, received_utc_s: float
    ) -> Message:
        data: Any
        match update.value:
            case Presence():
                vehicle.alive = update.value.alive
                return Message("presence", vehicle.name, vehicle.alive)
            case ModelSnapshot():
                data = vehicle.learn(update.value, payload or b"", received_utc_s)
                return Message(Topic.MODEL.value, vehicle.name, data)
            case PlanNotice():
                return Message(Topic.PLAN.value, vehicle.name, vehicle.plan(update.value, received_utc_s))
            case HealthNotice():
                data = vehicle.health(update.value, received_utc_s)
                return Message(Topic.HEALTH.value, vehicle.name, data)
            case LogNotice():
                return Message(Topic.LOG.value, vehicle.name, vehicle.log(update.value, received_utc_s))
            case _:
                return Message(Topic.OBSERVATIONS.value, vehicle.name, vehicle.observe(update.value))

    def _known(self, name: str) -> Vehicle | None:
        """The vehicle, made room for if it is new; None where all the others are there, and no room is."""
        vehicle = self._vehicles.get(name)
        if vehicle is not None:
            return vehicle
        if len(self._vehicles) >= _MAXIMUM_VEHICLES:
            gone = [each for each in self._vehicles.values() if not each.alive]
            if not gone:
                return None
            del self._vehicles[min(gone, key=lambda each: each.heard_s).name]
        share = min(_LARGEST_HISTORY_BYTES, self._history_bytes // (len(self._vehicles) + 1))
        for each in self._vehicles.values():
            each.stops.limit(share)
        self._vehicles[name] = Vehicle(name, share)
        return self._vehicles[name]

    def __len__(self) -> int:
        return len(self._vehicles)

    def summaries(self) -> list[Plain]:
        """The fleet's list, by name."""
        with self._lock:
            now_s = time.monotonic()
            return [self._vehicles[name].summary(now_s) for name in sorted(self._vehicles)]

    def everything(self, name: str) -> Plain:
        """The latest of everything of one vehicle; KeyError if it has not been heard of."""
        with self._lock:
            return self._vehicles[name].everything()

    def history(self, name: str) -> Plain:
        """The slider's stops of one vehicle, and its series; KeyError if it has not been heard of."""
        with self._lock:
            return self._vehicles[name].history()

    def newest(self, name: str) -> tuple[float, ModelSnapshot] | None:
        """The newest model and its stop, None before there is one; KeyError if it has not been heard of."""
        with self._lock:
            vehicle = self._vehicles[name]
            return None if vehicle.model is None else (vehicle.model_stamp_s, vehicle.model)

    def stop(self, name: str, time_s: float) -> tuple[float, bytes] | None:
        """The newest stop that is no later, else the oldest, and its bytes; None before there is one.

        KeyError if the vehicle has not been heard of.
        """
        with self._lock:
            stops = self._vehicles[name].stops
            return stops.at(time_s) if len(stops) else None
