"""Signing on the link to the vehicle, and what of it must outlive the process: timestamps that are not used again.

A thread of its own writes them: the control loop does not wait for the disk.
"""

import json
import logging
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from autonomy.config import Configuration
from autonomy.mavlink.signing import (
    LARGEST_TIMESTAMP,
    MAXIMUM_PLEDGED,
    Pledge,
    Signing,
    SigningKey,
    read_key,
    told,
)
from autonomy.shell.files import open_to_read, write_atomically
from autonomy.shell.latest import Latest
from autonomy.shell.state_directory import state_directory

log = logging.getLogger(__name__)

FILE_NAME = "signing.json"
_MAXIMUM_BYTES = 2**16


class SignedLink:
    """The signing of one run, its timestamps kept in a file.

    Args:
        key: of the link.
        link_id: of our packets.
        file: where timestamps are kept; its folder is made. None: nowhere.
        unkept: why they are not, if they are not.
        utc_s: the wall clock.
    """

    def __init__(
        self,
        key: SigningKey,
        link_id: int,
        file: Path | None,
        unkept: str = "",
        utc_s: Callable[[], float] = time.time,
    ) -> None:
        self._unkept = unkept
        self._told = 0
        self.signing = Signing(key, utc_s, link_id, None if file is None else _load(file))
        self._latest: Latest[Pledge] | None = None
        if file is not None:
            # Before the first packet: a run that is killed early has used timestamps too.
            self._last = self.signing.pledge()
            self._latest = Latest("signing", partial(_keep, file), file, "signing timestamps can't be kept")
            self._latest.at_once(self._last)

    @property
    def report(self) -> str:
        """What was refused, and what is wrong with keeping the timestamps; empty if nothing is."""
        unkept = self._unkept if self._latest is None else self._latest.trouble
        kept = unkept and f"signing timestamps are not kept: {unkept}"
        return "; ".join(filter(None, (told(self.signing.refused), kept)))

    def tend(self) -> None:
        """Have written what must be, and say what was refused; once a second and after every packet that is due."""
        total = sum(self.signing.refused.values())
        if total and (not self._told or total >= 10 * self._told):
            log.warning(
                "MAVLink packets that are not signed as they should be: %s", told(self.signing.refused)
            )
            self._told = total
        if self._latest is None:
            return
        pledge = self.signing.pledge()
        if pledge == self._last and not self._latest.trouble:
            return
        self._last = pledge
        self._latest.put(pledge)

    def close(self) -> None:
        """Write what waits, and end."""
        if self._latest is not None:
            self._latest.close()


def open_signed_link(configuration: Configuration, environment: Mapping[str, str]) -> SignedLink | None:
    """The signing that the configuration asks for, if any; its timestamps go into the service's state directory.

    Where they can't be kept the link is signed all the same, the report says so, and it is tried again.

    Raises:
        KeyFileError: there is no usable key.
    """
    section = configuration.mavlink.signing
    key = read_key(section, environment)
    if key is None:
        return None
    try:
        file = state_directory(configuration.vehicle.name, environment) / FILE_NAME
    except ValueError as error:
        log.error("signing timestamps can't be kept: %s", error)
        return SignedLink(key, section.link_id, None, str(error))
    return SignedLink(key, section.link_id, file)


def _load(file: Path) -> Pledge | None:
    try:
        with open_to_read(file) as stream:
            data = stream.read(_MAXIMUM_BYTES + 1)
        return _decode(data)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        log.error("%s can't be read: packets of earlier runs may be replayed: %s", file, error)
        return None


def _keep(file: Path, pledge: Pledge) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, _encode(pledge))


def _encode(pledge: Pledge) -> bytes:
    streams = [[*stream, last] for stream, last in pledge.streams.items()]
    return json.dumps({"version": 1, "timestamp": pledge.timestamp, "streams": streams}).encode()


def _decode(data: bytes) -> Pledge:
    """The pledge in a file's bytes; ValueError if there is none."""
    if len(data) > _MAXIMUM_BYTES:
        raise ValueError(f"it has more than {_MAXIMUM_BYTES} bytes")
    try:
        content = json.loads(data)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    match content:
        case {"version": 1, "timestamp": int() as timestamp, "streams": list() as rows}:
            streams = {(link, system, component): last for link, system, component, last in map(_row, rows)}
            if 0 <= timestamp <= LARGEST_TIMESTAMP and len(streams) <= MAXIMUM_PLEDGED:
                return Pledge(timestamp, streams)
    raise ValueError("it holds no timestamps of ours")


def _row(row: object) -> tuple[int, int, int, int]:
    match row:
        case [int() as link, int() as system, int() as component, int() as last]:
            if (
                all(0 <= number <= 255 for number in (link, system, component))
                and 0 <= last <= LARGEST_TIMESTAMP
            ):
                return link, system, component, last
    raise ValueError("it holds no timestamps of ours")
