"""`autonomy shore watch`: follow a vehicle, with a line per snapshot and the latest map as a picture."""

import argparse
import json
import math
import os
import queue
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.description import describe
from autonomy.learning.kernel import Component
from autonomy.option_types import above_zero, vehicle_or_all, whole
from autonomy.shore import way
from autonomy.shore.saving import model_bytes, replace_file
from autonomy.shore.stopping import stop_on_signals
from autonomy.shore.subscriber import Presence, Subscriber, Update, VehicleView
from autonomy.shore.words import agreement, belief
from autonomy.wire import LogNotice, ModelSnapshot

EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2
_PICTURE_PERIOD_S = 1.0
_LOOK_S = 0.2
_UPDATES_LIMIT = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "vehicle", nargs="?", default="*", type=vehicle_or_all, help="its name; * for all (default)"
    )
    way.add_arguments(parser)
    parser.add_argument("--png", type=Path, metavar="FILE", help="keep the latest map in this picture")
    parser.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="keep the latest model in this file, for `autonomy plan --model`",
    )
    parser.add_argument("--json", action="store_true", help="print a JSON object per snapshot, not text")
    parser.add_argument("--count", type=whole(1), metavar="N", help="end after N snapshots")
    parser.add_argument(
        "--timeout",
        type=above_zero("seconds"),
        metavar="S",
        help="end after S seconds; fails if too few came",
    )


def run(args: argparse.Namespace) -> int:
    """Follow until told to stop: 0; 1 if too few came, it failed, or the address is taken; 2 for bad usage."""
    draw = None
    for option, path in (("--png", args.png), ("--save", args.save)):
        if path is not None and not path.absolute().parent.is_dir():
            return _complain(EXIT_USAGE, f"{option}: there is no directory {path.absolute().parent}")
    if args.png is not None:
        draw = _painter()
        if draw is None:
            return _complain(EXIT_USAGE, "--png needs matplotlib: pip install 'halocline[shore]'")
    try:
        certificates = way.certificates(args)
    except ValueError as error:
        return _complain(EXIT_USAGE, str(error))
    updates: queue.Queue[Update] = queue.Queue(_UPDATES_LIMIT)
    subscriber = Subscriber(
        args.vehicle,
        args.connect or (),
        args.listen or (),
        on_update=partial(_offer, updates),
        certificates=certificates,
    )
    with stop_on_signals() as stopping:
        try:
            subscriber.start()
        except OSError as error:
            return _complain(EXIT_FAILED, str(error))
        try:
            return _Watch(subscriber, updates, stopping, draw, args).follow()
        except BrokenPipeError:
            # Whoever read our lines has seen enough; what is left must not be flushed at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return EXIT_OK
        finally:
            subscriber.close()


class _Watch:
    """One run of the verb."""

    def __init__(
        self,
        subscriber: Subscriber,
        updates: "queue.Queue[Update]",
        stopping: threading.Event,
        draw: Callable[..., None] | None,
        args: argparse.Namespace,
    ) -> None:
        self._subscriber = subscriber
        self._updates = updates
        self._stopping = stopping
        self._draw = draw
        self._args = args
        self._snapshots = 0
        self._undrawn: str | None = None
        self._drawn_s = -math.inf

    def follow(self) -> int:
        """Until the count, the timeout or a signal; the last picture is drawn in any case."""
        deadline = math.inf if self._args.timeout is None else time.monotonic() + self._args.timeout
        while not self._stopping.is_set() and not self._enough() and time.monotonic() < deadline:
            if self._subscriber.failed is not None:
                return _complain(
                    EXIT_FAILED, f"vehicles are not followed any more: {self._subscriber.failed!r}"
                )
            try:
                update = self._updates.get(timeout=_LOOK_S)
            except queue.Empty:
                update = None
            if update is not None:
                self._take(update)
            if time.monotonic() - self._drawn_s >= _PICTURE_PERIOD_S:
                self._picture()
        self._picture()
        if self._stopping.is_set() or self._enough() or (self._args.count is None and self._snapshots):
            return EXIT_OK
        wanted = "" if self._args.count is None else f" of {self._args.count}"
        return _complain(EXIT_FAILED, f"{self._snapshots}{wanted} snapshots came in {self._args.timeout:g} s")

    def _save(self, model: ModelSnapshot) -> None:
        if self._args.save is not None:
            try:
                replace_file(self._args.save, model_bytes(model))
            except OSError as error:
                _note(f"the model is not saved: {error}")

    def _enough(self) -> bool:
        return self._args.count is not None and self._snapshots >= self._args.count

    def _take(self, update: Update) -> None:
        match update.value:
            case ModelSnapshot():
                self._snapshots += 1
                self._undrawn = update.vehicle
                self._save(update.value)
                view = self._subscriber.latest(update.vehicle)
                json_wanted = self._args.json
                said = json.dumps(_fields(update.value, view)) if json_wanted else _line(update.value, view)
                print(_printable(said), flush=True)
            case Presence():
                _note(f"{update.vehicle}: {'connected' if update.value.alive else 'gone'}")
            case LogNotice() if update.value.level in ("warning", "error"):
                _note(f"{update.vehicle}: {update.value.level}: {update.value.text}")

    def _picture(self) -> None:
        if self._draw is None or self._undrawn is None:
            return
        vehicle, self._undrawn = self._undrawn, None
        self._drawn_s = time.monotonic()
        try:
            self._draw(self._args.png, self._subscriber.latest(vehicle), self._subscriber.track(vehicle))
        except (OSError, ValueError) as error:
            _note(f"the picture cannot be made: {error}")


def _fields(model: ModelSnapshot, view: VehicleView) -> dict[str, Any]:
    """What a snapshot says, for programs; `age_s` compares UTC with this machine's clock."""
    kernel = model.kernel
    return {
        "vehicle": model.vehicle,
        "sequence": model.sequence,
        "utc_s": model.utc_s,
        "age_s": None if model.utc_s is None else round(time.time() - model.utc_s, 3),
        "model_time_s": model.model_time_s,
        "state": None if view.health is None else view.health.state,
        "samples": model.samples,
        "basis_size": len(model.model),
        "rho": model.rho,
        "replans": model.replans,
        "repairs": None if view.health is None else view.health.repairs,
        "calibration": _numbers(model.calibration),
        "ahead": _numbers(model.ahead),
        "kernel": describe(kernel),
        "components": [_component(component) for component in kernel.components],
        "noise_variance": kernel.noise_variance,
        "transform": model.model.transform.name,
        "variable": model.variable,
        "units": model.units,
    }


def _numbers(figures: CalibrationFigures) -> dict[str, float | None]:
    return {name: _known(value) for name, value in asdict(figures).items()}


def _component(component: Component) -> dict[str, Any]:
    return {
        "variance": component.variance,
        "space": component.space.name,
        "lengthscales_m": list(component.space.lengthscales_m),
        "time": component.time.name,
        "timescale_s": _known(component.time.timescale_s),
    }


def _known(value: float) -> float | None:
    """JSON has neither NaN nor infinity."""
    return value if math.isfinite(value) else None


def _line(model: ModelSnapshot, view: VehicleView) -> str:
    """The same for a person."""
    clock, age = "--:--:--", ""
    if model.utc_s is not None:
        clock = datetime.fromtimestamp(model.utc_s, UTC).strftime("%H:%M:%SZ")
        age_s = time.time() - model.utc_s
        # A simulation in a hurry runs ahead of the clock ashore.
        age = "" if age_s < 0.0 else f"  {age_s:.1f} s old"
    state = "state unknown" if view.health is None else view.health.state
    repairs = "" if view.health is None or not view.health.repairs else f"  repairs {view.health.repairs}"
    return (
        f"{clock}  {model.vehicle}  t={model.model_time_s:.0f} s  {state}  "
        f"samples {model.samples}  basis {len(model.model)}  ρ {model.rho:.2f}  plans {model.replans}{repairs}  "
        f"{belief(model)}  {agreement(model)}{age}"
    )


def _painter() -> Callable[..., None] | None:
    try:
        from autonomy.shore.picture import write_map
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        return None
    return write_map


def _offer(updates: "queue.Queue[Update]", update: Update) -> None:
    """Pass on what gets a line; a terminal that is held up loses the oldest."""
    if not isinstance(update.value, ModelSnapshot | Presence | LogNotice):
        return
    if updates.full():
        with suppress(queue.Empty):
            updates.get_nowait()
    updates.put(update)


def _printable(text: str) -> str:
    """Text from the network must not steer the terminal."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)


def _note(text: str) -> None:
    print(_printable(text), file=sys.stderr, flush=True)


def _complain(code: int, text: str) -> int:
    _note(f"autonomy shore watch: {text}")
    return code
