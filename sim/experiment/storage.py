"""Cells on disk: one NetCDF file each, whose name says what was asked and whether the file is whole."""

import fcntl
import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from sim.experiment.cells import SweepError, Value

_NAME = re.compile(r"[A-Za-z]\w*")
_DIGEST_LENGTH = 32
_COMPRESSED_FROM = 100


def digest_of(data: bytes) -> str:
    """As much of the SHA-256 of some bytes as file names carry."""
    return hashlib.sha256(data).hexdigest()[:_DIGEST_LENGTH]


def encode(values: Mapping[str, Value], provenance: Mapping[str, Any]) -> bytes:
    """A cell as a NetCDF file: values as variables, provenance as global attributes.

    Raises TypeError if a value is none that `Value` names, ValueError if a name is not a word.
    """
    dataset = netCDF4.Dataset("cell.nc", "w", memory=4096)
    dataset.setncatts({name: _attribute(value) for name, value in provenance.items()})
    for name, value in values.items():
        if not _NAME.fullmatch(name):
            raise ValueError(f"a value's name must be a word that begins with a letter (got {name!r})")
        _put(dataset, name, value)
    return bytes(dataset.close())


def decode(data: bytes) -> tuple[dict[str, Value], dict[str, Any]]:
    """Values and provenance of a cell, as `encode` was given them. OSError if it is no NetCDF file."""
    with netCDF4.Dataset("cell.nc", "r", memory=data) as dataset:
        dataset.set_auto_maskandscale(False)
        values = {name: _value(variable) for name, variable in dataset.variables.items()}
        provenance = {name: json.loads(dataset.getncattr(name)) for name in dataset.ncattrs()}
    return values, provenance


class CellFolder:
    """The finished cells of sweeps, `FINGERPRINT-DIGEST.nc`: what was asked, and what the file's bytes must be."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other sweeps away in the block. Raises SweepError if one is at work here or the folder can't be used."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            lock = os.open(self._folder / "sweep.lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise SweepError(f"{self._folder}: {error.strerror}") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError as error:
            raise SweepError(f"{self._folder}: another sweep is at work here") from error
        finally:
            os.close(lock)

    def load(self, fingerprint: str) -> tuple[bytes | None, list[Path]]:
        """The file of a cell, None if there is none that is whole, and those that are not."""
        damaged: list[Path] = []
        for path in sorted(self._folder.glob(f"{fingerprint}-*.nc")):
            data = path.read_bytes()
            if path.stem == f"{fingerprint}-{digest_of(data)}":
                return data, damaged
            damaged.append(path)
        return None, damaged

    def keep(self, fingerprint: str, data: bytes) -> None:
        """Write the file of a cell, whole or not at all, in place of any other of it. Raises SweepError."""
        kept = self._folder / f"{fingerprint}-{digest_of(data)}.nc"
        draft = self._folder / f"{fingerprint}.new"
        try:
            draft.write_bytes(data)
            draft.replace(kept)
            for other in self._folder.glob(f"{fingerprint}-*.nc"):
                if other != kept:
                    other.unlink()
        except OSError as error:
            raise SweepError(f"{self._folder}: a cell can't be kept: {error.strerror}") from error


def _attribute(value: Any) -> str:
    return json.dumps(value, sort_keys=True, allow_nan=False)


def _put(dataset: Any, name: str, value: Value) -> None:
    if isinstance(value, str):
        dataset.createVariable(name, str)[...] = np.array(value, dtype=object)
        return
    array = np.asarray(value)
    kind = array.dtype.kind
    if kind not in "biuf" or array.dtype.itemsize > 8 or array.dtype == np.float16:
        raise TypeError(
            f"{name!r} must be a number, a word or an array of numbers (got {type(value).__name__})"
        )
    dimensions = [f"{name}_{axis}" for axis in range(array.ndim)]
    for dimension, size in zip(dimensions, array.shape, strict=True):
        dataset.createDimension(dimension, size)
    stored = array.view(np.int8) if kind == "b" else array
    packing = "zlib" if array.size >= _COMPRESSED_FROM else None
    variable = dataset.createVariable(name, stored.dtype, dimensions, compression=packing)
    variable.set_auto_maskandscale(False)
    variable[...] = stored
    if kind == "b":
        variable.is_boolean = np.int8(1)


def _value(variable: Any) -> Value:
    array = variable[...]
    if variable.dtype is str:
        return str(array)
    if "is_boolean" in variable.ncattrs():
        array = array.astype(bool)
    found: Value = array if variable.ndim else array.item()
    return found
