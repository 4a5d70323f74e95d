"""Files that appear when they are whole, all of them together or none."""

import contextlib
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def appearing(paths: Mapping[str, Path]) -> Iterator[dict[str, Path]]:
    """Names of files, by the same keys, to be written in the block; afterwards they are renamed to `paths`.

    If the block raises nothing is left of them. Raises OSError if a folder can't be written to.
    """
    with contextlib.ExitStack() as undo:
        temporary: dict[str, Path] = {}
        for key, path in paths.items():
            # A folder of its own, in the same file system: some libraries want to make their file themselves.
            folder = tempfile.mkdtemp(dir=path.absolute().parent, prefix=f".{path.name}.", suffix=".part")
            undo.callback(_remove, Path(folder))
            temporary[key] = Path(folder) / path.name
        yield temporary
        for key, path in paths.items():
            with temporary[key].open("rb") as file:
                os.fsync(file.fileno())
            os.replace(temporary[key], path)


@contextmanager
def told_as_os_error(path: Path, begins: str) -> Iterator[None]:
    """Whatever a library reports as a RuntimeError whose text begins so is a file that can't be written: OSError."""
    try:
        yield
    except RuntimeError as error:
        if not str(error).startswith(begins):
            raise
        raise OSError(f"{path.name} can't be written ({error}); is the disk full?") from error


def _remove(folder: Path) -> None:
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()
