"""What is known of a field at the desk: a model file, a checkpoint of the service, or nothing but the prior."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.geometry import FloatArray
from autonomy.learning import snapshot
from autonomy.learning.field_model import FieldModel
from autonomy.learning.history import HistoryCells
from autonomy.learning.learner import Learner
from autonomy.learning.roughness import RoughnessReadings
from autonomy.memory import UnfitMemoryError
from autonomy.planning.survey import SurveyArea
from autonomy.shell.checkpoint import MAGIC, Checkpoint, CheckpointError, decode, fits

_SAME_PLACE_DEG = 1e-6


class UnknownModelError(ValueError):
    """A file that no model for this survey can be had from; says why."""


@dataclass(frozen=True, eq=False)
class Known:
    """What a plan can be made with.

    Attributes:
        model: the posterior, or the prior.
        readings: how many it knows; None: none.
        says: what it is, for a person.
        measured: cells of the readings; None: not known.
        roughness: how they vary, here and there; None: not known.
        position_m: where the vessel was last, shape (2,); None: not known.
    """

    model: FieldModel
    readings: int | None
    says: str
    measured: HistoryCells | None = None
    roughness: RoughnessReadings | None = None
    position_m: FloatArray | None = None


def known_from(path: Path | None, configuration: Configuration, survey: SurveyArea) -> Known:
    """What is known from a model file, a checkpoint's file or a folder of checkpoints; None: nothing.

    Raises:
        OSError: it can't be read.
        UnknownModelError: it is none of these, damaged, or of another survey.
    """
    core = Core(configuration, survey)
    if path is None:
        return _learnt(core.learner, None)
    data = _newest(path) if path.is_dir() else path.read_bytes()
    if not data.startswith(MAGIC):
        return _from_snapshot(data, survey)
    checkpoint = _decoded(data)
    wanted = fits(configuration, survey)
    changed = [part for part in wanted if checkpoint.fits.get(part) != wanted[part]]
    if changed:
        raise UnknownModelError(f"it was made with another configuration: {', '.join(changed)} differ")
    try:
        core.restore(checkpoint.memory)
    except UnfitMemoryError as error:
        raise UnknownModelError(f"it does not fit this software: {error}") from error
    return _learnt(core.learner, core.position_m)


def _learnt(learner: Learner, position_m: FloatArray | None) -> Known:
    if not learner.born:
        return Known(learner.model(), None, "nothing learnt: the prior", position_m=position_m)
    roughness = learner.roughness.frozen() if len(learner.roughness) else None
    says = f"a model of {learner.samples} readings"
    return Known(learner.model(), learner.samples, says, learner.history.cells(), roughness, position_m)


def _from_snapshot(data: bytes, survey: SurveyArea) -> Known:
    try:
        read = snapshot.read(data)
    except snapshot.SnapshotError as error:
        raise UnknownModelError(f"it is neither a model file nor a checkpoint: {error}") from error
    notes, frame = read.metadata, survey.frame
    if read.model.kernel.dimensions != 2:
        raise UnknownModelError(f"its model must have two axes, not {read.model.kernel.dimensions}")
    origin = notes.get("origin_lat_deg"), notes.get("origin_lon_deg")
    here = frame.origin_lat_deg, frame.origin_lon_deg
    if not all(isinstance(part, int | float) for part in origin):
        raise UnknownModelError(
            "it does not say where on Earth its model is (origin_lat_deg, origin_lon_deg)"
        )
    if not np.allclose(np.asarray(origin, dtype=float), here, rtol=0.0, atol=_SAME_PLACE_DEG):
        raise UnknownModelError(
            f"it is of another survey: its origin is {origin[0]:.5f}, {origin[1]:.5f}, "
            f"that of the configured area {here[0]:.5f}, {here[1]:.5f}"
        )
    samples = notes.get("samples")
    readings = samples if isinstance(samples, int) and samples > 0 else max(1, len(read.model))
    return Known(
        read.model, readings, f"a model of {readings} readings, of {notes.get('vehicle', 'a vehicle')}"
    )


def _decoded(data: bytes) -> Checkpoint:
    try:
        return decode(data)
    except CheckpointError as error:
        raise UnknownModelError(f"it is a damaged checkpoint: {error}") from error


def _newest(folder: Path) -> bytes:
    """The bytes of the newest sound checkpoint in a folder; a service that is running may go on writing there."""
    found: list[tuple[int, bytes]] = []
    for path in sorted(folder.glob("*.checkpoint")):
        data = path.read_bytes()
        try:
            found.append((decode(data).number, data))
        except CheckpointError:
            continue
    if not found:
        raise UnknownModelError("the folder holds no sound checkpoint")
    return max(found)[1]
