"""Where a cell's values come from: versions, commit, machine."""

import functools
import platform
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import autonomy
from sim.experiment.sweep_sources import digest_of_sources

_PACKAGES = ("numpy", "scipy", "shapely", "pyproj", "pymavlink", "netCDF4", "xarray", "threadpoolctl")
_PROJECT = Path(autonomy.__file__).parents[1]


@dataclass(frozen=True)
class Version:
    """What has to be the same for values to be the same: ours, the sources', and the packages' that compute."""

    halocline: str
    sources: str
    numpy: str
    scipy: str


@functools.cache
def version_here(module: str) -> Version:
    """The version of `module`, where a cell's function lives, as this process would import it."""
    return Version(autonomy.__version__, digest_of_sources(module), version("numpy"), version("scipy"))


def machine() -> dict[str, str]:
    """Of the machine that computes a cell: Python, packages, processor, operating system."""
    return {
        "python": platform.python_version(),
        "packages": ", ".join(f"{name} {installed}" for name in _PACKAGES if (installed := _installed(name))),
        "cpu": _processor(),
        "system": platform.platform(),
    }


def commit() -> dict[str, str | bool]:
    """`git_commit` of the sources and whether they differ from it (`git_dirty`); empty if they are in no checkout."""
    if _git("ls-files", "--error-unmatch", "autonomy/__init__.py") is None:
        return {}
    head, changed = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--", "autonomy", "sim")
    return {} if head is None else {"git_commit": head, "git_dirty": bool(changed)}


def _git(*words: str) -> str | None:
    command = ["git", "-C", str(_PROJECT), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    """The processor's name: BLAS takes another way on another one, and the last digits may differ."""
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
