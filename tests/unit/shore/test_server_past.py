"""What a recording holds is there again, thinned where there is much of it."""

import os
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autonomy.effects import Topic
from autonomy.shore.recording import Recorder, RecordingError
from autonomy.shore.server.fleet import Fleet
from autonomy.shore.server.past import _KEPT, _THINNED, Past
from autonomy.wire import encode, key

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import health_notice, learnt_model, model_snapshot, plan_notice, survey_notice

END_S = 1.8e9
NEVER = threading.Event()


@pytest.fixture(scope="module")
def snapshot():
    return model_snapshot(learnt_model()[0])


def recorded(folder, records):
    """A folder with (time, vehicle, topic, value or bytes), whose files are as old as the last of them."""
    with Recorder(folder) as recorder:
        for at_s, vehicle, topic, value in records:
            payload = value if isinstance(value, bytes) else encode(value)
            recorder.write(at_s, key(vehicle, topic), "", payload)
    for file in folder.iterdir():
        os.utime(file, (END_S, END_S))


def read(folder):
    fleet = Fleet()
    return fleet, Past(folder, fleet).read(NEVER)


def test_all_of_a_short_past_is_there(tmp_path, snapshot):
    rows = [
        (END_S - 100 + k, "boat1", Topic.MODEL, replace(snapshot, utc_s=END_S - 100 + k)) for k in range(5)
    ]
    rows += [
        (END_S - 9, "boat1", Topic.SURVEY, survey_notice()),
        (END_S - 8, "boat1", Topic.PLAN, plan_notice(3)),
        (END_S - 7, "boat1", Topic.PLAN, plan_notice(4)),
        (END_S - 6, "boat1", Topic.HEALTH, health_notice("before")),
        (END_S - 5, "boat1", Topic.HEALTH, health_notice("last")),
    ]
    recorded(tmp_path, rows)
    fleet, refused = read(tmp_path)
    assert refused == 0
    latest, history = fleet.everything("boat1"), fleet.history("boat1")
    assert not latest["alive"]
    assert history["models"] == [END_S - 100 + k for k in range(5)]
    assert [plan["sequence"] for plan in history["plans"]] == [3, 4]
    assert (latest["plan"]["sequence"], latest["plan"]["utc_s"]) == (4, END_S - 7)
    assert latest["health"]["reason"] == "last"
    assert latest["survey"]["name"] == "off Point Conception"
    [summary] = fleet.summaries()
    assert summary["age_s"] >= 0


def test_a_long_past_is_thinned_while_it_is_read(tmp_path, monkeypatch):
    rows = [(END_S - 10.0 * (20_000 - k), "boat1", Topic.MODEL, b"a model") for k in range(20_000)]
    recorded(tmp_path, rows)
    # Only the choice is looked at: what is read of a model doesn't matter.
    taken = []
    monkeypatch.setattr(Past, "_take", lambda self, record, topic: taken.append(record.received_utc_s))
    read(tmp_path)
    ages, gaps = END_S - np.array(taken[:-1]), np.diff(taken)
    # One in a 500th of the age, rounded up to the next record: one for every ten seconds lately, one for 400 at first.
    assert (gaps <= ages / 500 + 10.0).all()
    assert (gaps >= (ages - gaps) / 500 - 1e-6).all()
    assert len(taken) < 2500


def test_what_cannot_be_understood_is_counted_and_the_rest_read(tmp_path, snapshot):
    rows = [
        (END_S - 3, "boat1", Topic.MODEL, b"of another version"),
        (END_S - 2, "boat1", Topic.OBSERVATIONS, b""),
        (END_S - 1, "boat1", Topic.MODEL, snapshot),
    ]
    recorded(tmp_path, rows)
    with Recorder(tmp_path) as recorder:
        recorder.write(END_S, "usv/boat*/model", "", encode(snapshot))
        recorder.write(END_S, "elsewhere", "", b"nothing of ours")
    fleet, refused = read(tmp_path)
    assert refused == 2
    assert [each["vehicle"] for each in fleet.summaries()] == ["boat1"]
    assert fleet.everything("boat1")["model"]["sequence"] == snapshot.sequence


def test_it_stops_when_it_is_told_to(tmp_path, snapshot):
    recorded(tmp_path, [(END_S, "boat1", Topic.MODEL, snapshot)] * 3)
    stopping = threading.Event()
    stopping.set()
    fleet = Fleet()
    Past(tmp_path, fleet).read(stopping)
    assert len(fleet) == 0


def test_no_recording_is_an_error(tmp_path):
    with pytest.raises(RecordingError, match="holds no recording"):
        read(tmp_path)


def test_what_is_thinned_and_what_is_not_is_all_there_is():
    assert {*_KEPT, *_THINNED, Topic.STATUS} == set(Topic)
