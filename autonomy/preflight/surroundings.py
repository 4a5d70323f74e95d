"""What the computer itself can tell: room on the disk, routers that answer."""

import re
import shutil
import tempfile
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from autonomy.config import Configuration, ShoreSection
from autonomy.endpoints import Certificates, session_settings
from autonomy.preflight.facts import Folder
from autonomy.shell.state_directory import state_directory


def folders(configuration: Configuration, environment: Mapping[str, str]) -> tuple[Folder, ...]:
    """Where journal and checkpoints of this vehicle would go, run by this user."""
    sections = (("journal", configuration.journal), ("checkpoint", configuration.checkpoint))
    found = []
    for what, section in sections:
        if not section.enabled:
            continue
        try:
            path = section.directory or state_directory(configuration.vehicle.name, environment) / what
        except ValueError as error:
            found.append(Folder(what, Path(what), 0.0, str(error)))
        else:
            found.append(_folder(what, path))
    return tuple(found)


def routers(shore: ShoreSection) -> dict[str, str]:
    """Why no session with each router can be opened; empty if one can. Takes up to about ten seconds."""
    if not shore.connect:
        return {}
    with ThreadPoolExecutor(len(shore.connect)) as pool:
        troubles = list(pool.map(lambda locator: _dial(locator, shore), shore.connect))
    return dict(zip(shore.connect, troubles, strict=True))


def _folder(what: str, path: Path) -> Folder:
    """The service makes a folder that is not there: what counts then is the nearest one that is."""
    there = path
    while not there.exists() and there != there.parent:
        there = there.parent
    try:
        if not there.is_dir():
            raise NotADirectoryError(0, f"{there} is no folder")
        with tempfile.TemporaryFile(dir=there):
            free = shutil.disk_usage(there).free
    except OSError as error:
        return Folder(what, path, 0.0, f"nothing can be written there: {error.strerror or error}")
    return Folder(what, path, free / 1e6)


def _dial(locator: str, shore: ShoreSection) -> str:
    # zenoh takes a while to import, and threads of its own.
    import zenoh

    from autonomy.zenoh_session import zenoh_config

    tls = shore.tls
    certificates = Certificates(tls.root_ca, tls.certificate, tls.private_key, tls.verify_name)
    try:
        settings = session_settings("client", [locator], certificates=certificates)
        with zenoh.open(zenoh_config(settings)):
            return ""
    except zenoh.ZError as error:
        return f"no session can be opened: {_first_line(error)}"


def _first_line(error: Exception) -> str:
    """Without the place in zenoh's own sources."""
    line = (str(error).splitlines() or [type(error).__name__])[0]
    return re.sub(r"[.!]? at /\S+:\d+\.?$", "", line)
