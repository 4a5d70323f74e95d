"""What all tests of processes share: time enough. A busy machine takes several times as long as a quiet one."""

from pathlib import Path

import pytest

TIMEOUT_S = 400


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give a test of this folder that names no timeout of its own a long one."""
    for item in items:
        if item.path.parent == Path(__file__).parent and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(TIMEOUT_S))
