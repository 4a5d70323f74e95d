"""Vessels that only publish: `python fleet_of_publishers.py ADDRESS COUNT`, until it is told to stop.

Each says what a survey says: a model of a hundred basis vectors every ten seconds, a reading every second, its health
every five.
"""

import argparse
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from autonomy.effects import Topic
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.shell.publisher import Publisher
from autonomy.verbs import leave
from autonomy.wire import LogNotice, ObservationNotice

sys.path.insert(0, str(Path(__file__).parent))
from shore_helpers import field, health_notice, model_snapshot, plan_notice, survey_notice

BASIS = 100
MODEL_PERIOD_S, HEALTH_PERIOD_S = 10, 5
_TICKS = 20


def learnt_model(seed: int):
    """A model that has all the basis vectors it may have."""
    rng = np.random.default_rng(seed)
    gp = SparseOnlineGP(Hyperparameters(0.5, 1e-3, (1100.0, 900.0)), BASIS, prior_mean=33.0)
    for point in np.cumsum(rng.normal(0, 400, (600, 2)), axis=0) % [12_000, 9_000]:
        gp.update(point, field(point) + rng.normal(0, 0.03))
    return gp.model()


class Fleet:
    """`count` vessels at one router, each as a tenth of a second goes by."""

    def __init__(self, address: str, count: int) -> None:
        self._models = [learnt_model(seed) for seed in range(3)]
        self._boats = [Publisher(f"boat{number:03d}", [address]) for number in range(count)]
        for boat in self._boats:
            boat.start()

    def sail(self, stopping: threading.Event) -> None:
        """Until told to stop; the vessels' turns are spread over each second."""
        for boat in self._boats:
            boat.publish(Topic.SURVEY, survey_notice())
        start_s = time.monotonic()
        tick = 0
        while not stopping.wait(max(0.0, start_s + tick / _TICKS - time.monotonic())):
            second, part = divmod(tick, _TICKS)
            for number in range(part, len(self._boats), _TICKS):
                self._turn(number, second)
            tick += 1

    def _turn(self, number: int, second: int) -> None:
        boat = self._boats[number]
        lat_deg, lon_deg = 34.4 + 0.08 * (second % 97) / 97, -120.5 + 0.13 * number / len(self._boats)
        boat.publish(
            Topic.OBSERVATIONS, (ObservationNotice(float(second), lat_deg, lon_deg, 33.0, 1, (1,) * 7),)
        )
        turn = second + number // _TICKS
        if turn % MODEL_PERIOD_S == 0:
            snapshot = model_snapshot(self._models[number % len(self._models)], second, f"boat{number:03d}")
            boat.publish(Topic.MODEL, replace(snapshot, utc_s=time.time(), model_time_s=float(second)))
        if turn % HEALTH_PERIOD_S == 0:
            boat.publish(Topic.HEALTH, health_notice(f"second {second}"))
        if turn % 60 == 0:
            boat.publish(Topic.PLAN, plan_notice(second))
            boat.publish(Topic.LOG, LogNotice("info", f"second {second}", time.time()))


def main() -> None:
    """Sail until the standard input ends or a signal comes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("address")
    parser.add_argument("count", type=int)
    arguments = parser.parse_args()
    fleet = Fleet(arguments.address, arguments.count)
    print("at sea", flush=True)
    fleet.sail(threading.Event())


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        leave(0)
