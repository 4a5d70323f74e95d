"""The vehicles that are followed, and the latest of each: bounded, whoever sends under however many names."""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from autonomy import wire
from autonomy.effects import Topic
from autonomy.observation_ring import ObservationRing
from autonomy.shore.greeting import Greeting
from autonomy.shore.lack import Lack
from autonomy.shore.streams import Stream

MAXIMUM_VEHICLES = 256
LARGEST_MODELS = 32_000_000
"""Numbers in the matrices of all models together, at most: 256 MB."""


@dataclass(frozen=True)
class VehicleView:
    """The latest of everything one vehicle has published; None where nothing has come yet."""

    vehicle: str
    alive: bool = False
    model: wire.ModelSnapshot | None = None
    plan: wire.PlanNotice | None = None
    health: wire.HealthNotice | None = None
    survey: wire.SurveyNotice | None = None
    status: wire.StatusDigest | None = None


@dataclass
class Entry:
    """What is known of one vehicle.

    Attributes:
        view: the latest.
        track: the observations, oldest first.
        observations: puts them together.
        lines: the same for the log.
        greeting: whether it is to be asked for its newest values.
        lacks: of plan and survey, whether it is to be asked for them because they were lost.
        payloads: what the newest of each topic that is not in order looked like, in 16 bytes.
        live_since: number of the last query when something came by itself, by topic.
        was_alive: whether its token was ever seen.
    """

    view: VehicleView
    track: ObservationRing
    observations: Stream[wire.ObservationBatch]
    lines: Stream[wire.LogBatch]
    greeting: Greeting = field(default_factory=Greeting)
    lacks: dict[Topic, Lack] = field(default_factory=lambda: {Topic.PLAN: Lack(), Topic.SURVEY: Lack()})
    payloads: dict[Topic, bytes] = field(default_factory=dict)
    live_since: dict[Topic, int] = field(default_factory=dict)
    was_alive: bool = False

    @property
    def model_numbers(self) -> int:
        """How many numbers the matrices of the model have."""
        model = self.view.model
        return 0 if model is None else _numbers(model)


class Roster:
    """Entries by name. For one thread at a time.

    A vehicle whose token stands is never pushed out. One that only sends, as anybody may, finds a place while there is
    room; one that has a token takes the place of one that never had any, or else of one that is gone, that which was
    heard longest ago.

    Args:
        track_limit: observations kept of each.
        history: observations wanted of those told before we came; None: all that the vehicle keeps.
        log_history: the same of lines of its log.
    """

    def __init__(self, track_limit: int, history: int | None, log_history: int | None) -> None:
        self._track_limit = track_limit
        self._history = history
        self._log_history = log_history
        self._entries: OrderedDict[str, Entry] = OrderedDict()

    def __iter__(self) -> Iterator[Entry]:
        return iter(list(self._entries.values()))

    @property
    def names(self) -> list[str]:
        """Of all vehicles, sorted."""
        return sorted(self._entries)

    def get(self, vehicle: str) -> Entry | None:
        """What is known of a vehicle, if anything."""
        return self._entries.get(vehicle)

    def entry(self, vehicle: str, *, has_token: bool = False) -> Entry:
        """What is known of a vehicle that was just heard; a new entry if nothing is.

        Raises:
            WireError: there is no room for another.
        """
        entry = self._entries.get(vehicle)
        if entry is not None:
            self._entries.move_to_end(vehicle)
            return entry
        if len(self._entries) >= MAXIMUM_VEHICLES:
            leaver = self._leaver() if has_token else None
            if leaver is None:
                raise wire.WireError(f"usv/{vehicle}: more than {MAXIMUM_VEHICLES} vehicles")
            del self._entries[leaver]
        entry = Entry(
            VehicleView(vehicle),
            ObservationRing(self._track_limit),
            Stream(self._history),
            Stream(self._log_history),
        )
        self._entries[vehicle] = entry
        return entry

    def keep_model(self, entry: Entry, model: wire.ModelSnapshot) -> None:
        """Take over a new model.

        Raises:
            WireError: with it, all models together would be too large.
        """
        others = sum(each.model_numbers for each in self._entries.values() if each is not entry)
        if others + _numbers(model) > LARGEST_MODELS:
            raise wire.WireError(
                f"usv/{model.vehicle}/model: there is no room for another model of this size"
            )
        entry.view = replace(entry.view, model=model)

    def _leaver(self) -> str | None:
        """Who makes room for a vehicle with a token."""
        gone = [name for name, entry in self._entries.items() if not entry.view.alive]
        strangers = [name for name in gone if not self._entries[name].was_alive]
        return next(iter(strangers or gone), None)


def _numbers(snapshot: wire.ModelSnapshot) -> int:
    model = snapshot.model
    states = len(model) * model.kernel.states
    return 2 * states * states
