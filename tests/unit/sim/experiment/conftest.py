"""What tests of sweeps share."""

import sys
from pathlib import Path

import pytest

# Workers find the cells' functions there too.
sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def calls(tmp_path):
    """Where cells say that they were called: `calls()` counts by seed."""
    folder = tmp_path / "calls"
    folder.mkdir()

    class Calls:
        path = str(folder)

        def __call__(self):
            return {int(seed.name): len(list(seed.iterdir())) for seed in sorted(folder.iterdir())}

        def processes(self):
            """Those that have computed cells."""
            return {int(file.read_text()) for file in folder.glob("*/*")}

    return Calls()
