"""What all tests share."""

import os

# Before anything imports numpy: the threads of BLAS fight for the cores and make small matrices far slower.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from pathlib import Path  # noqa: E402

import pytest  # noqa: E402


@pytest.fixture(scope="session")
def real_data_dir() -> Path:
    """The directory of real ocean files, which is not part of the project."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    place = Path(os.environ.get("HALOCLINE_DATA", beside))
    if not place.is_dir():
        pytest.skip(f"no real fields at {place}: set HALOCLINE_DATA to their directory")
    return place
