"""Files of people: configuration, areas, depths, fields, keys."""

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from autonomy import config
from autonomy.config import ConfigurationError
from autonomy.mavlink.signing import KeyFormatError, SigningKey
from autonomy.planning.depth import shallow_water
from autonomy.planning.errors import SurveyError
from sim.field import FieldError

from .decoder import ROOT, YAML_TOKENS, Decoder, reader_of, scratch
from .field_reader import FieldReader


def shipped_configuration() -> list[bytes]:
    whole = (ROOT / "config" / "default.yaml").read_bytes()
    lines = [line for line in whole.splitlines(keepends=True) if not line.strip().startswith(b"#")]
    return [
        b"".join(lines),
        b"survey: {area: [[33.4, -118.6], [33.4, -118.4], [33.6, -118.4]]}\nmodel: {capacity: 50}\n",
    ]


def read_key(data: bytes) -> None:
    for form in ("passphrase", "key"):
        try:
            SigningKey.from_file_content(data, form)
        except KeyFormatError:
            continue


def depth_grid() -> list[bytes]:
    head = "ncols 4\nnrows 4\nxllcorner -118.7\nyllcorner 33.3\ncellsize 0.1\nNODATA_value -9999\n"
    rows = "-5 -20 -9999 3\n" * 4
    return [
        (head + rows).encode(),
        head.replace("corner", "center").replace("NODATA", "nodata").encode() + rows.encode(),
    ]


def read_depths(path: Path) -> None:
    for positive in ("up", "down"):
        shallow_water(path, (-118.6, 33.4, -118.4, 33.6), (-118.65, 33.35, -118.35, 33.65), 10.0, positive)


NUMBER_TOKENS = [
    *b"nan inf -1e999 1e308 0 -9999 NCOLS 1_0 0x1".split(),
    *(b"9" * 400, b"\n", b" ", b"\xc3"),
]


def netcdf() -> list[bytes]:
    """A small sea in each of the formats; with HDF5, one compressed and chunked."""
    return [
        netcdf_file(form, **storage)
        for form, storage in (
            ("NETCDF3_CLASSIC", {}),
            ("NETCDF3_64BIT_OFFSET", {}),
            ("NETCDF4", {}),
            ("NETCDF4", {"zlib": True, "chunksizes": (1, 4, 5)}),
        )
    ]


def netcdf_file(form: str, **storage: Any) -> bytes:
    path = scratch("sound.nc")
    with netCDF4.Dataset(path, "w", format=form) as dataset:
        for name, size in (("time", 2), ("lat", 8), ("lon", 10)):
            dataset.createDimension(name, size)
            variable = dataset.createVariable(name, "f8", (name,))
            variable[:] = np.arange(size) * (3600.0 if name == "time" else 0.01)
            variable.units = {
                "time": "seconds since 2020-01-01",
                "lat": "degrees_north",
                "lon": "degrees_east",
            }[name]
        salt = dataset.createVariable("salt", "i2", ("time", "lat", "lon"), fill_value=-999, **storage)
        salt.setncatts({"scale_factor": 0.01, "add_offset": 30.0, "units": "1e-3"})
        salt.set_auto_maskandscale(False)
        salt[:] = np.arange(160).reshape(2, 8, 10)
    return path.read_bytes()


NETCDF_TOKENS = [
    *b"CDF\x01 CDF\x02 CDF\x05 OHDR FRHP BTHD OCHK TREE SNOD _FillValue scale_factor".split(),
    *(b"\x89HDF\r\n\x1a\n", b"\xff" * 8, bytes(8), b"\x00\x00\x00\x0c", b"days since 0000-00-00"),
]


DECODERS = {
    "configuration": Decoder(
        reader_of("boat.yaml", lambda path: config.load(path, {})),
        shipped_configuration,
        (ConfigurationError,),
        YAML_TOKENS,
    ),
    "depth": Decoder(reader_of("depth.asc", read_depths), depth_grid, (SurveyError,), NUMBER_TOKENS),
    "netcdf": Decoder(reader_of("damaged.nc", FieldReader()), netcdf, (FieldError,), NETCDF_TOKENS),
    "key": Decoder(read_key, lambda: [b"a phrase\n", b"ab" * 32, bytes(32)], (), [b"\n", b"\r\n"]),
}
