"""A boat behind a link of 2400 bits per second: the newest is fresh, the rest comes in order.

HALOCLINE_THIN_S sets how long the real link is tried, shaped by `tc tbf` between two network namespaces, which takes
root; without it, a line ten times as wide is tried for some seconds.
"""

import json
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from autonomy import wire
from autonomy.shore.subscriber import Subscriber

sys.path.insert(0, str(Path(__file__).parent))
from bad_line import BadLine
from shore_helpers import SOON_S, free_endpoint, router

pytestmark = [pytest.mark.process, pytest.mark.timeout(2000)]

THIN_S = float(os.environ.get("HALOCLINE_THIN_S", "0"))
HERE = Path(__file__).parent
BITS_PER_S, RATE = 2400, 200
NEWEST_S = 60.0
"""On the real link the newest model ashore is never older, once the first has come."""


def oldest_s(models: list[tuple[float, float]]) -> float:
    """The greatest age of the newest model ashore, of times of arrival and of making."""
    return max(after[0] - before[1] for before, after in pairwise(models))


@pytest.mark.skipif(not THIN_S, reason="HALOCLINE_THIN_S is not set")
def test_2400_bits_per_second():
    program = (sys.executable, str(HERE / "thin_shore.py"), str(BITS_PER_S), str(RATE), "1", str(THIN_S))
    done = subprocess.run(["unshare", "--net", *program], capture_output=True, check=True, timeout=1900)
    seen = json.loads(done.stdout)
    models = [(arrived, made) for arrived, made, _, _ in seen["models"]]
    print(f"{len(models)} models, the newest at most {oldest_s(models):.1f} s old")
    print(f"{seen['bytes'] / THIN_S:.0f} bytes/s, {len(seen['readings'])} readings in {THIN_S:.0f} s")
    assert all(arrived - made <= NEWEST_S for arrived, made in models)
    assert oldest_s(models) <= NEWEST_S
    assert seen["readings"] == [float(number % 5000) for number in range(len(seen["readings"]))]
    assert len(seen["readings"]) >= THIN_S - 60.0, "the link is wide enough for one a second"


def test_a_line_ten_times_as_wide():
    """Ten times the bytes in a tenth of the time, and ten readings a second."""
    endpoint, models, readings = free_endpoint(), [], []

    def take(update) -> None:
        match update.value:
            case wire.ModelSnapshot(utc_s=utc_s):
                models.append((time.time(), utc_s))
            case tuple():
                readings.extend(one.model_time_s for one in update.value)

    with (
        router(endpoint),
        BadLine(endpoint, bytes_per_s=BITS_PER_S / 8 * 10) as line,
        Subscriber("boat1", connect=[endpoint], on_update=take, history=None) as shore,
        subprocess.Popen(
            [sys.executable, str(HERE / "thin_boat.py"), line.endpoint, str(10 * RATE), "0.1"],
            stdin=subprocess.PIPE,
        ) as boat,
    ):
        begun = time.monotonic()
        assert shore.wait_for(lambda _: len(models) >= 3 and len(readings) >= 40, SOON_S)
        took_s = time.monotonic() - begun
        boat.stdin.close()
        boat.wait(SOON_S)
    assert readings == [float(number) for number in range(len(readings))]
    assert line.passed[0] <= 1.5 * 10 * RATE * took_s + 10_000, "so much was allowed"
