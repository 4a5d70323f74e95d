"""All that an object knows, as plain values, and back: what a checkpoint is made of.

`capture` walks an object and everything it holds, and gives None, truth values, numbers, text, bytes, arrays and
lists of these. It copies what may change later, so that the result can be encoded in another thread. `restore`
puts it into an object that has been newly made by the same software.

    {"classes": [[name, [attribute, …]], …], "root": node}

    node   None, truth value, number, text, bytes          itself
           array                                           itself (and again: the numbers of "again")
           ["list", node, …], "tuple", "set", "frozenset"  and "deque" with its maximum length first
           ["dict", key node, value node, …], "counter"
           ["enum", class name, member name]
           ["object", number of its class, node for each attribute]
           ["array", type, "C" or "F", [side, …], bytes]   an array, once encoded: see `ARRAY_TYPES`
           ["again", k]                                    the k-th array, list, dict, … or object of this walk

No code is run from what is restored: objects are made without their `__init__`, and only of classes of this package
that are loaded already. What a class got from configuration or survey (`SETTINGS`) is not state: it stays as the new
object has it.
"""

import sys
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import BaseModel

from autonomy.learning.history import History

Memory = dict[str, Any]
"""What `capture` gives; see the module's description."""

_PACKAGE = "autonomy."
_PLAIN = frozenset({type(None), bool, int, float, str, bytes})
_SEQUENCES: Mapping[type, str] = {list: "list", set: "set", frozenset: "frozenset"}

SETTINGS: Mapping[str, frozenset[str]] = {
    name: frozenset(attributes.split())
    for name, attributes in {
        "autonomy.core.Core": "_survey",
        "autonomy.replanning.Replanning": "_configuration",
        "autonomy.seaway.Seaway": "_survey _margin_m",
        "autonomy.stall.StallWatch": "_stall_s _stall_m",
        "autonomy.stall.GivenUp": "_give_up_s _least_m",
        "autonomy.orders.Orders": "_return_mode",
        "autonomy.course.Course": "_minimum_gain",
        "autonomy.directives.Directives": "_is_full",
        "autonomy.wishes.Wishes": "_is_full",
        "autonomy.situation.Situation": "_message_name",
        "autonomy.homeward.Homeward": "_section _shortest_m _fixed_m",
        "autonomy.budget.Budget": "_section _limits",
        "autonomy.consumption.MetreCost": "_guess",
        "autonomy.consumption.Meter": "_capacity_j",
        "autonomy.helm.Helm": "_configuration _mavlink _frame",
        "autonomy.headway.Headway": "_frame",
        "autonomy.pace.Pace": "_usual_mps",
        "autonomy.mavlink.telemetry.Telemetry": "_sensor_name _wanted_system_id _link_timeout_s _handlers "
        "_stamped_by_vehicle",
        "autonomy.mavlink.pairing.Pairing": "_gap_s _intake",
        "autonomy.mavlink.authority.Authority": (
            "_adopt _is_full _stays_taken _table _return_mode _return_battery _starts_by_itself _heeds_start"
        ),
        "autonomy.sampling.SampleGate": "_survey _sampling _transform _allowed",
        "autonomy.quality.stream.QualityControl": "_section _fail_span",
        "autonomy.quality.location.Location": "_waters _maximum_speed_mps",
        "autonomy.quality.flat_line.FlatLine": "_suspect_s _fail_s",
        "autonomy.quality.flat_line._Run": "_tolerance",
        "autonomy.exploration.Exploration": "_section _replan_share",
        "autonomy.reporting.Reporter": "_configuration _survey _configuration_hash",
        "autonomy.reporting._Schedule": "period_s",
    }.items()
}
"""By class: attributes that follow from configuration and survey."""

ARRAY_TYPES = frozenset({"<f8", "<f4", "<i8", "<i4", "<u8", "|u1", "|b1"})
"""What arrays may be made of, as NumPy writes it."""

_CONVERTED: Mapping[type, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    History: (History.state, History.restore)
}
"""Classes that say themselves what there is to remember, and check it."""


class UnfitMemoryError(ValueError):
    """What is to be restored does not fit this software, or is no memory at all; says what is wrong."""


def capture(subject: object) -> Memory:
    """Everything `subject` knows. Raises TypeError for what can't be remembered: sockets, functions, …"""
    walk = _Capture()
    return {"root": walk.node(subject), "classes": walk.classes}


def restore(memory: Memory, subject: object) -> None:
    """Give `subject`, newly made, what the captured one knew.

    Raises UnfitMemoryError if that can't be done, and leaves `subject` half-done then: throw it away.
    """
    try:
        walk = _Restore(memory["classes"])
        result = walk.node(memory["root"], subject)
    except UnfitMemoryError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise UnfitMemoryError(f"{type(error).__name__}: {error}") from error
    if result is not subject:
        raise UnfitMemoryError(f"it is not about a {type(subject).__name__}")


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _is_value(kind: type) -> bool:
    """Whether instances never change: then their arrays need no copy, and other objects may share them."""
    return is_dataclass(kind) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined]


def _has_own_state(kind: type) -> bool:
    return hasattr(kind, "__setstate__")


def _left_out(kind: type) -> frozenset[str]:
    derived = (name for base in kind.__mro__ for name, it in vars(base).items() if _is_cached(it))
    return SETTINGS.get(_name(kind), frozenset()).union(derived)


def _is_cached(attribute: object) -> bool:
    return isinstance(attribute, cached_property)


class _Capture:
    """One walk; see the module's description."""

    def __init__(self) -> None:
        self.classes: list[tuple[str, tuple[str, ...]]] = []
        self._numbers: dict[tuple[type, tuple[str, ...]], int] = {}
        self._seen: dict[int, int] = {}
        self._left_out: dict[type, frozenset[str]] = {}
        self._alive: list[object] = []
        self._in_values = 0

    def node(self, it: Any) -> Any:
        kind = type(it)
        if kind in _PLAIN:
            return it
        if isinstance(it, np.generic):
            return it.item()
        if isinstance(it, Enum):
            return ["enum", _name(kind), it.name]
        if kind is tuple:
            return ["tuple", *self._all(it)]
        number = self._seen.get(id(it))
        if number is not None:
            return ["again", number]
        self._seen[id(it)] = len(self._seen)
        if kind is np.ndarray:
            if it.dtype.str not in ARRAY_TYPES:
                raise TypeError(f"an array of {it.dtype} can't be remembered")
            return it if self._in_values else it.copy(order="K")
        if kind in _SEQUENCES:
            return [_SEQUENCES[kind], *self._all(it)]
        if kind is deque:
            return ["deque", it.maxlen, *self._all(it)]
        if kind is dict or kind is Counter:
            pairs = [part for pair in it.items() for part in pair]
            return ["dict" if kind is dict else "counter", *self._all(pairs)]
        return self._object(it, kind)

    def _all(self, items: Any) -> list[Any]:
        node = self.node
        return [it if type(it) in _PLAIN else node(it) for it in items]

    def _object(self, it: Any, kind: type) -> Any:
        if not _name(kind).startswith(_PACKAGE) or issubclass(kind, BaseModel):
            raise TypeError(f"a {_name(kind)} can't be remembered")
        if kind in _CONVERTED:
            state = _CONVERTED[kind][0](it)
        elif _has_own_state(kind):
            state = it.__getstate__()
        else:
            state = vars(it)
        # Or the number of another object might be given to its short-lived parts.
        self._alive.append(state)
        if kind not in self._left_out:
            self._left_out[kind] = _left_out(kind)
        names = tuple(state) if not self._left_out[kind] else tuple(state.keys() - self._left_out[kind])
        layout = (kind, tuple(sorted(names)))
        if layout not in self._numbers:
            self._numbers[layout] = len(self.classes)
            self.classes.append((_name(kind), layout[1]))
        is_value = _is_value(kind)
        self._in_values += is_value
        parts = self._all([state[name] for name in layout[1]])
        self._in_values -= is_value
        return ["object", self._numbers[layout], *parts]


class _Restore:
    """The way back."""

    def __init__(self, classes: Any) -> None:
        self._classes = [(_class_of(name), tuple(map(str, names))) for name, names in classes]
        self._made: list[Any] = []

    def node(self, it: Any, present: object = None) -> Any:
        """What the node stands for; `present` is what the new object has in its place."""
        if type(it) in _PLAIN:
            return it
        if isinstance(it, np.ndarray):
            self._made.append(it)
            return it
        tag, parts = it[0], it[1:]
        if tag == "array":
            self._made.append(_array(*parts))
            return self._made[-1]
        if tag == "again":
            return self._made[parts[0]]
        if tag == "tuple":
            return tuple(map(self.node, parts))
        if tag == "enum":
            return _class_of(parts[0])[parts[1]]  # type: ignore[index]
        if tag == "object":
            return self._object(parts, present)
        place = len(self._made)
        self._made.append(None)
        self._made[place] = made = self._container(tag, parts, place)
        return made

    def _container(self, tag: str, parts: list[Any], place: int) -> Any:
        if tag == "list":
            made: list[Any] = []
            self._made[place] = made
            made.extend(map(self.node, parts))
            return made
        if tag == "deque":
            return deque(map(self.node, parts[1:]), maxlen=parts[0])
        if tag in ("set", "frozenset"):
            return (set if tag == "set" else frozenset)(map(self.node, parts))
        if tag in ("dict", "counter"):
            decoded = list(map(self.node, parts))
            pairs = dict(zip(decoded[::2], decoded[1::2], strict=True))
            return pairs if tag == "dict" else Counter(pairs)
        raise UnfitMemoryError(f"{tag!r:.40} is no kind of node")

    def _object(self, parts: list[Any], present: object) -> Any:
        kind, names = self._classes[parts[0]]
        if issubclass(kind, Enum | BaseModel) or len(parts) != 1 + len(names):
            raise UnfitMemoryError(f"this is no {kind.__name__}")
        place = len(self._made)
        if kind in _CONVERTED:
            self._made.append(None)
            converted = _CONVERTED[kind][1](dict(zip(names, map(self.node, parts[1:]), strict=True)))
            self._made[place] = converted
            return converted
        keeps = type(present) is kind and not _is_value(kind) and not _has_own_state(kind)
        made: Any = present if keeps else object.__new__(kind)
        self._made.append(made)
        _check_layout(kind, names, present if keeps else None)
        values = [
            self.node(part, getattr(present, name, None) if keeps else None)
            for name, part in zip(names, parts[1:], strict=True)
        ]
        state = dict(zip(names, values, strict=True))
        if _has_own_state(kind):
            made.__setstate__(state)
        else:
            vars(made).update(state)
        return made


def _array(kind: str, order: str, shape: list[int], data: bytes) -> Any:
    """The array, of its own memory; ValueError if the parts do not fit each other."""
    if kind not in ARRAY_TYPES or order not in ("C", "F"):
        raise ValueError(f"no array is made of {kind!r:.40} in order {order!r:.40}")
    flat = np.frombuffer(data, dtype=kind)
    return flat.reshape(tuple(shape), order=order).copy(order=order)  # type: ignore[call-overload]


def _check_layout(kind: type, names: tuple[str, ...], present: object | None) -> None:
    """Whether this software's class of that name has the same attributes."""
    if present is not None:
        wanted = vars(present).keys() - _left_out(kind)
    elif is_dataclass(kind):
        wanted = {field.name for field in fields(kind)}
    elif SETTINGS.get(_name(kind)):
        raise UnfitMemoryError(f"a {kind.__name__} can't be made without its settings")
    else:
        return
    if wanted != set(names):
        odd = ", ".join(sorted(wanted ^ set(names)))
        raise UnfitMemoryError(f"{kind.__name__} has other attributes in this version: {odd}")


def _class_of(name: Any) -> type:
    """The class of that name, of this package and loaded."""
    module, _, rest = str(name).rpartition(".")
    kind = getattr(sys.modules.get(module), rest, None)
    if not module.startswith(_PACKAGE) or not isinstance(kind, type) or _name(kind) != name:
        raise UnfitMemoryError(f"{name!r:.100} is no class of this version")
    return kind
