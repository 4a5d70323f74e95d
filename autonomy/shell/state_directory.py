"""Where the service keeps what must outlive it."""

from collections.abc import Mapping
from pathlib import Path


def state_directory(vehicle: str, environment: Mapping[str, str]) -> Path:
    """The folder of this vehicle's service: the one that systemd gives it, or one in the user's home.

    Raises:
        ValueError: the environment names neither.
    """
    given = environment.get("STATE_DIRECTORY", "").split(":")[0]
    if given:
        return Path(given)
    home = environment.get("XDG_STATE_HOME") or (
        f"{environment['HOME']}/.local/state" if environment.get("HOME") else ""
    )
    if not home:
        raise ValueError("neither STATE_DIRECTORY nor XDG_STATE_HOME nor HOME says where to keep anything")
    return Path(home) / "halocline" / vehicle
