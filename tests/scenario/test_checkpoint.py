"""A core that was put aside and taken up again decides as the one that went on."""

import copy
from typing import Any

import numpy as np
import pytest

from autonomy.core import Core
from autonomy.effects import Effect, Publish, SendMessage, StartJob, Topic
from autonomy.events import Event, JobFinished
from autonomy.memory import Memory
from autonomy.shell.checkpoint import decode, encode


def through_bytes(memory: Memory) -> Memory:
    return decode(encode(memory))


def twin_of(voyage: Any, **sections: Any) -> Core:
    """A new core that knows what the voyage's knows, by way of a checkpoint's bytes."""
    old = voyage.core
    twin = Core(old._configuration, voyage.survey)
    twin.restore(through_bytes(old.checkpoint()))
    return twin


def told(effects: list[Effect]) -> list[Any]:
    """Effects as values that can be compared."""
    said: list[Any] = []
    for effect in effects:
        match effect:
            case SendMessage(message):
                said.append((message.get_type(), message.to_dict()))
            case Publish(Topic.MODEL, snapshot):
                x = np.linspace(0.0, 3000.0, 7)
                grid = snapshot.model.predict_grid(x, x)
                said.append((snapshot.sequence, snapshot.samples, snapshot.rho, snapshot.replans, str(grid)))
            case StartJob(job_id, name, request, _):
                said.append(
                    (job_id, name, request.plan.seed, request.plan.start_m.tolist(), request.plan.reason)
                )
            case Publish(topic, payload):
                said.append((topic, repr(payload)))
            case _:
                said.append(repr(effect))
    return said


class Shadow:
    """Hears all that a voyage's core hears, and says nothing."""

    def __init__(self, core: Core, twin: Core) -> None:
        self.twin = twin
        self.effects = 0
        handle = core.handle

        def both(now: float, event: Event) -> list[Effect]:
            same = copy.deepcopy(event) if isinstance(event, JobFinished) else event  # its model is adopted
            effects, theirs = handle(now, event), twin.handle(now, same)
            assert told(theirs) == told(effects), (now, event)
            assert twin.next_deadline() == core.next_deadline()
            self.effects += len(effects)
            return effects

        core.handle = both  # type: ignore[method-assign]


@pytest.mark.parametrize("sail_s", [0.0, 7.3, 61.0, 400.0])
def test_the_same_events_bring_the_same_decisions(voyage: Any, sail_s: float) -> None:
    voyage.advance(sail_s)
    shadow = Shadow(voyage.core, twin_of(voyage))
    voyage.advance(600.0)
    assert shadow.effects > 500
    assert voyage.lines("re-estimated", since=1000.0 + sail_s)
