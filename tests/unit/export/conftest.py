"""One recorded survey and its exports, made once."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from told import Told, record

from autonomy import cli

FILES = {
    "netcdf": "map.nc",
    "trajectory": "track.nc",
    "geojson": "out.geojson",
    "mcap": "run.mcap",
    "csv": "observations.csv",
}
ATTRIBUTES = """
creator_name: Ada Example
creator_email: ada@example.org
creator_url: https://example.org
institution: Example Laboratory
project: Example survey
publisher_name: Example Laboratory
publisher_email: data@example.org
publisher_url: https://example.org
naming_authority: org.example
acknowledgement: Nobody in particular.
license: CC-BY-4.0
"""


@pytest.fixture(scope="session")
def told() -> Told:
    return Told()


@pytest.fixture(scope="session")
def recording(told: Told, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("recording"), told.messages)


@pytest.fixture(scope="session")
def exported(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all formats, a map every three minutes."""
    folder = tmp_path_factory.mktemp("exported")
    (folder / "attributes.yaml").write_text(ATTRIBUTES)
    words = [word for name, file in FILES.items() for word in (f"--{name}", str(folder / file))]
    more = ["--every", "3min", "--resolution", "150", "--depth", "0.5"]
    assert (
        cli.main(["export", str(recording), *words, *more, "--attributes", str(folder / "attributes.yaml")])
        == 0
    )
    return folder
