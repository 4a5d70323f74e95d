"""Whatever becomes of a checkpoint's file, the service starts: from it, from the older one, or afresh."""

import hashlib
import tempfile
from pathlib import Path
from typing import Any

import cbor2
import pytest
import shapely
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import CheckpointSection, Configuration
from autonomy.core import Core
from autonomy.events import DeadlineReached
from autonomy.geometry import LocalFrame
from autonomy.memory import UnfitMemoryError
from autonomy.planning.survey import SurveyArea
from autonomy.shell.checkpoint import MAGIC, Checkpoint, CheckpointError, decode, encode, fits
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.resumption import Continuity

CONFIGURATION = Configuration.model_validate(
    {"survey": {"area": [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]}}
)
SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0, 0, 3000, 2000), passage_cells=20)
WANTED = fits(CONFIGURATION, SURVEY)


def new() -> Core:
    return Core(CONFIGURATION, SURVEY)


def core() -> Core:
    made = new()
    made.handle(5.0, DeadlineReached())
    for i in range(40):
        made._learner.add((10.0 * i, 5.0 * i), 30.0 + 0.1 * i, float(i))
    return made


def sound(number: int = 1) -> bytes:
    return encode(Checkpoint(number, WANTED, core().checkpoint(), 5.0, 1e9, "boot", None))


SOUND = sound()


def content() -> Any:
    return cbor2.loads(zstandard.ZstdDecompressor().decompress(SOUND[len(MAGIC) + 32 :]))


def sealed(it: Any) -> bytes:
    """A file whose digest agrees, whatever it holds."""
    body = zstandard.ZstdCompressor().compress(cbor2.dumps(it))
    return MAGIC + hashlib.blake2b(body, digest_size=32).digest() + body


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    data = bytearray(SOUND)
    if draw(st.booleans()):
        del data[draw(st.integers(0, len(data) - 1)) :]
    for _ in range(draw(st.integers(0 if len(data) < len(SOUND) else 1, 4))):
        if data:
            data[draw(st.integers(0, len(data) - 1))] ^= draw(st.integers(1, 255))
    return bytes(data)


@settings(deadline=None)
@given(damaged())
def test_damage_is_noticed(data: bytes) -> None:
    if data == SOUND:  # two flips that undid each other
        return
    with pytest.raises(CheckpointError):
        decode(data)


@settings(deadline=None)
@given(damaged(), st.booleans())
def test_the_service_starts_all_the_same(data: bytes, has_older: bool) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "odd.checkpoint").write_bytes(data)
        if has_older:
            (folder / "even.checkpoint").write_bytes(sound(0))
        store = Store(folder)
        awake = Continuity(new, CheckpointSection(), store, WANTED).core
        store.close()
        assert awake._learner.samples == (40 if has_older or data == SOUND else 0)
        awake.handle(9.0, DeadlineReached())


def nodes(it: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Ways to everything inside of lists and maps."""
    inside = list(it.items()) if isinstance(it, dict) else list(enumerate(it)) if isinstance(it, list) else []
    return [path, *(way for key, value in inside for way in nodes(value, (*path, key)))]


WAYS = [way for way in nodes(content()) if way]
JUNK = (
    st.none()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(
        [
            ["again", 10**9],
            ["object", 0],
            ["object", -1, 1],
            ["enum", "os.system", "x"],
            ["enum", "autonomy.core.Core", "x"],
            ["array", "<f8", "C", [10**12], b""],
            ["array", "|O", "C", [1], b"12345678"],
            ["dict", ["list"], 1],
            ["tuple"],
            [],
            {},
        ]
    )
)


@settings(deadline=None)
@given(st.sampled_from(WAYS), JUNK)
def test_nonsense_with_the_right_digest_is_refused_or_harmless(way: tuple[Any, ...], junk: Any) -> None:
    """Of the decoder's own errors only; what it takes is a core, if perhaps a confused one."""
    changed = content()
    place = changed
    for key in way[:-1]:
        place = place[key]
    place[way[-1]] = junk
    try:
        restored = decode(sealed(changed))
        new().restore(restored.memory)
    except (CheckpointError, UnfitMemoryError):
        pass
