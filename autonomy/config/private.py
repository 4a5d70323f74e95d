"""Files that hold secrets: nobody but their owner may read them."""

import os
import stat
from collections.abc import Mapping
from pathlib import Path

MAXIMUM_BYTES = 65_536


class PrivateFileError(ValueError):
    """The file can't be used; says why, and what would be right."""


def read_private(file: Path, environment: Mapping[str, str]) -> bytes:
    """The content of a file that only its owner may read.

    systemd's credentials are private although their mode does not always look so: they are readable by an access
    control list.

    Args:
        file: its name.
        environment: of the process; CREDENTIALS_DIRECTORY is where systemd has put the service's credentials.

    Raises:
        PrivateFileError: it can't be read, is no plain file, is too large, or others may read it.
    """
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise PrivateFileError(f"no readable file {str(file)!a}: {reason}") from None
    try:
        _check(file, os.fstat(descriptor), environment)
        with os.fdopen(descriptor, "rb", closefd=False) as stream:
            content = stream.read(MAXIMUM_BYTES + 1)
    finally:
        os.close(descriptor)
    if len(content) > MAXIMUM_BYTES:
        raise PrivateFileError(f"{str(file)!a} is too large for a secret: at most {MAXIMUM_BYTES} bytes")
    return content


def _check(file: Path, about: os.stat_result, environment: Mapping[str, str]) -> None:
    """PrivateFileError unless it is a plain file that nobody but its owner may read."""
    if not stat.S_ISREG(about.st_mode):
        raise PrivateFileError(f"{str(file)!a} is no plain file")
    mode = stat.S_IMODE(about.st_mode)
    if mode & 0o077 and not _is_credential(file, environment):
        raise PrivateFileError(
            f"others may read {str(file)!a} (mode {mode:04o}): it holds a secret, chmod 600 it, and make a new "
            "secret if anybody else has been on this machine"
        )


def _is_credential(file: Path, environment: Mapping[str, str]) -> bool:
    given = environment.get("CREDENTIALS_DIRECTORY", "")
    return given != "" and file.absolute().parent == Path(given)
