"""A long survey in which one thing after the other goes wrong, recorded in one piece and replayed.

HALOCLINE_REPLAY_S says how long it is (300 s, unless set); from an hour on the replay is held to its time too.
"""

import itertools
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "replays"))
import golden

from autonomy.records import Asked
from autonomy.replay import replay
from autonomy.shell.journal_files import Entry, Position, read_entries
from sim.autopilot import Mode
from sim.faults import Spikes

LENGTH_S = float(os.environ.get("HALOCLINE_REPLAY_S", "300"))
HOUR_S = 3600.0


def operator_meddles(run: Any) -> None:
    run.select(Mode.HOLD)
    run.advance(15.0)
    run.select(Mode.AUTO)


def link_goes(run: Any) -> None:
    run.cut_link()
    run.advance(12.0)
    run.restore_link()


def link_loses(run: Any) -> None:
    passed = itertools.count()
    run.passes = lambda message: next(passed) % 3 > 0
    run.advance(20.0)
    run.passes = lambda message: True


def probe_spikes(run: Any) -> None:
    sensor = run.autopilot.sensor
    sensor.faults = (Spikes(np.random.default_rng(5), 0.3, 1.0, 10.0),)
    run.advance(20.0)
    sensor.faults = ()


def boat_is_disarmed(run: Any) -> None:
    run.arm(armed=False)
    run.advance(10.0)
    run.arm()
    run.select(Mode.AUTO)


FAULTS: tuple[Callable[[Any], None], ...] = (
    operator_meddles,
    link_goes,
    link_loses,
    probe_spikes,
    boat_is_disarmed,
)


def course(run: Any) -> None:
    end = run.now + LENGTH_S
    for fault in itertools.cycle(FAULTS):
        run.advance(25.0)
        fault(run)
        if run.now >= end:
            return


@pytest.mark.timeout(60 + LENGTH_S)
def test_every_effect_of_a_long_survey_with_faults_is_the_same(tmp_path: Path) -> None:
    """Every second job crashes too."""
    run = golden.sail(tmp_path, course, golden.BrokenWorker())
    outcome = replay(tmp_path, 1)
    speed = outcome.recorded_s / outcome.took_s
    print(
        f"{outcome.events} events and {outcome.effects} effects of {outcome.recorded_s:.0f} s replayed in "
        f"{outcome.took_s:.1f} s, {speed:.0f} times as fast as life"
    )
    assert outcome.differences == []
    assert (outcome.troubles, outcome.lost) == ([], False)
    assert outcome.recorded_s >= LENGTH_S
    recorded = [
        effect
        for entry in read_entries(tmp_path, Position(1, 0))
        if isinstance(entry, Entry) and isinstance(entry.record, Asked)
        for effect in entry.record.effects
    ]
    assert outcome.effects == len(recorded)
    said = " ".join(text for _, text in run.log)
    for words in ("planning job failed", "is gone: unplugged", "operator has the boat", "plan 2"):
        assert words in said
    if LENGTH_S >= HOUR_S:
        assert "re-estimated" in said
        assert speed >= 20.0
