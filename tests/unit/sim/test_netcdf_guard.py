"""Whatever reading a file does, the process that wants it goes on, and says what is wrong."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sim import netcdf_guard
from sim.field import FieldError
from sim.netcdf_guard import Limits, check_readable

sys.path.insert(0, str(Path(__file__).parent))
import netcdf_readers


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "sea.nc"
    path.write_bytes(b"CDF")
    return path


@pytest.mark.parametrize(
    ("read", "told"),
    [
        (netcdf_readers.hangs, "it is damaged: reading it does not end within 1.0 s"),
        (netcdf_readers.crashes, r"it is damaged: reading it ends the process \(SIGABRT\)"),
        (netcdf_readers.hoards, "takes more memory than a sound file of its size would"),
        (netcdf_readers.refuses, "sea.nc: no salt"),
    ],
)
def test_it_is_told(file: Path, read: Callable[..., Any], told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(netcdf_guard, "LIMITS", Limits(cpu_s=1.0))
    with pytest.raises(FieldError, match=told):
        check_readable(file, "salt", read)


def test_a_file_is_tried_again_when_it_has_changed(file: Path) -> None:
    for content, tries in ((b"CDF", 1), (b"CDF", 1), (b"CDF\1", 2)):
        if file.read_bytes() != content:
            file.write_bytes(content)
        check_readable(file, None, netcdf_readers.counts)
        assert len(file.with_suffix(".count").read_text()) == tries
    check_readable(file, "salt", netcdf_readers.counts)
    assert len(file.with_suffix(".count").read_text()) == 3


def test_larger_files_have_more() -> None:
    limits = Limits()
    assert limits.seconds(2**30) > 100.0
    assert limits.seconds(2**16) < 1.0, "a small one that is damaged holds nobody up"
    assert limits.memory(2**30) > 2**34
    assert limits.memory(1000) < 2**30
