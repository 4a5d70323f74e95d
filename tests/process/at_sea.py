"""A small survey for tests of the service: four kilometres of open water, a fast vessel, an operator."""

import asyncio
import contextlib
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from autonomy.geometry import LocalFrame
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import SigningKey
from sim.operator import Operator

SOUTH, NORTH, WEST, EAST = 33.930, 33.966, -118.830, -118.787
SIDE_M = 4000.0
SPEEDUP = 200
VEHICLE = "boat1"
_SPEED_MPS = 4.0
SPACING_M = SIDE_M / 50
_READING_S = SPACING_M / _SPEED_MPS / 6

VESSEL = (
    *("--field", "synthetic-patch", "--start=33.948,-118.810", "--noise", "0.01"),
    *("--speed-mps", str(_SPEED_MPS), "--speedup", str(SPEEDUP), "--sample-interval-s", f"{_READING_S:.3f}"),
)
"""Arguments of `sim vessel`: it sails the survey's side in five seconds."""


def configure(folder: Path, endpoint: str, connect: Sequence[str] = (), **sections: dict[str, Any]) -> Path:
    """Write a configuration; `sections` are merged into it."""
    settings: dict[str, dict[str, Any]] = {
        "vehicle": {"name": VEHICLE},
        "mavlink": {"endpoint": endpoint, "acceptance_radius_m": 20.0, "link_timeout_s": 2.0},
        "survey": {"area": [[SOUTH, WEST], [SOUTH, EAST], [NORTH, EAST], [NORTH, WEST]], "standoff_m": 0.0},
        "sampling": {"spacing_m": SPACING_M},
        "exploration": {"minimum_basis": 12},
        "shore": {"connect": list(connect), "model_period_s": 0.5},
    }
    for name, values in sections.items():
        settings.setdefault(name, {}).update(values)
    file = folder / "boat.yaml"
    file.write_text(yaml.safe_dump(settings), encoding="utf-8")
    return file


class Bridge(Operator):
    """An operator who also notes every message."""

    def __init__(self, endpoint: str, key: SigningKey | None = None) -> None:
        super().__init__(endpoint, key)
        self._listener = Codec(254, 1)
        self.heard: list[Any] = []

    def _received(self, data: bytes, peer: Any) -> None:
        super()._received(data, peer)
        self.heard += self._listener.decode(data, peer)

    @property
    def sailed_m(self) -> float:
        """The way the boat has made since we heard of it first."""
        points = LocalFrame(SOUTH, WEST).to_local(*np.array(self.track_deg).reshape(-1, 2).T)
        return float(np.hypot(*np.diff(points, axis=0).T).sum())

    def texts(self) -> list[str]:
        """Every line told to the operator so far."""
        return [message.text for message in list(self.heard) if message.get_type() == "STATUSTEXT"]


@contextlib.contextmanager
def operating(endpoint: str, key: SigningKey | None = None) -> Iterator[Bridge]:
    """An operator at work in a thread of his own."""
    bridge = Bridge(endpoint, key)
    loop = asyncio.new_event_loop()
    task = loop.create_task(bridge.run())

    def work() -> None:
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(task)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield bridge
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(10.0)
        loop.close()
