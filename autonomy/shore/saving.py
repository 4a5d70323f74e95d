"""Keeping the newest model in a file, for `autonomy plan` and whoever reads snapshots."""

import os
import tempfile
from pathlib import Path

from autonomy.learning import snapshot
from autonomy.wire import ModelSnapshot


def model_bytes(received: ModelSnapshot) -> bytes:
    """A model file of a snapshot: see `autonomy.learning.snapshot`, with where and of what it is as its metadata.

    Lossless: nothing is lost again of what came, in `precision` and with an error of up to `error_mean` and `error_sd`.
    """
    noted: dict[str, snapshot.Scalar | None] = {
        "vehicle": received.vehicle,
        "survey": received.survey,
        "variable": received.variable,
        "units": received.units,
        "samples": received.samples,
        "model_time_s": received.model_time_s,
        "utc_s": received.utc_s,
        "origin_lat_deg": received.origin_lat_deg,
        "origin_lon_deg": received.origin_lon_deg,
        "capacity": received.capacity,
        "rho": received.rho,
        "rho0": received.rho0,
        "software_version": received.software_version,
        "configuration_hash": received.configuration_hash,
        "precision": received.precision,
        "error_mean": received.stated_error[0],
        "error_sd": received.stated_error[1],
    }
    return snapshot.encode(
        received.model, {name: value for name, value in noted.items() if value is not None}
    )


def replace_file(path: Path, data: bytes) -> None:
    """Write a file so that whoever reads it finds the old one or the new one, whole. Raises OSError."""
    descriptor, temporary = tempfile.mkstemp(
        dir=path.absolute().parent, prefix=f".{path.name}.", suffix=".part"
    )
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        # mkstemp makes files only their owner may read; these are for everybody.
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
