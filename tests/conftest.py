import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data_dir() -> Path:
    """The directory of real ocean files, which is not part of the project."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    place = Path(os.environ.get("HALOCLINE_DATA", beside))
    if not place.is_dir():
        pytest.skip(f"no real fields at {place}: set HALOCLINE_DATA to their directory")
    return place
