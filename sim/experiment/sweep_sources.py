"""Which code a cell's values come from: the modules of its function's project that the function can reach."""

import ast
import hashlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path

from sim.experiment.cells import SweepError


def digest_of_sources(module: str) -> str:
    """One digest of the source of `module` and of all that it imports, directly or not, of our own packages.

    So results are computed again when code changed that they may depend on, and not when a page, a picture or a test
    did. Modules that are only named in strings are not followed. A compiled module counts as being there.
    """
    text = "\n".join(f"{name} {_digest(file)}" for name, file in sorted(files_reached(module).items()))
    return hashlib.sha256(text.encode()).hexdigest()


def files_reached(module: str) -> dict[str, Path]:
    """Module name → its file, for `module` and all modules of autonomy, sim and its own package it can reach."""
    places = {root: _place(root) for root in {"autonomy", "sim", module.partition(".")[0]}}
    files: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        root, *inner = name.split(".")
        file = _file(places[root], inner) if root in places else None
        if name in files or file is None:
            continue
        files[name] = file
        waiting.extend(name.rsplit(".", depth)[0] for depth in range(1, len(inner) + 1))
        if file.suffix == ".py":
            waiting.extend(_imported(name, file))
    return files


def _place(root: str) -> Path:
    """The folder of a package, or the file of a module that is none."""
    spec = importlib.util.find_spec(root)
    if spec is None or spec.origin is None:
        raise SweepError(f"there is no module {root!r} to take a cell's function from")
    file = Path(spec.origin)
    return file.parent if file.name == "__init__.py" else file


def _file(place: Path, inner: list[str]) -> Path | None:
    if place.is_file():
        return None if inner else place
    path = place.joinpath(*inner)
    extensions = sorted(path.parent.glob(f"{path.name}.*.so")) if inner else []
    candidates = [path / "__init__.py", path.with_name(f"{path.name}.py"), *extensions]
    return next((file for file in candidates if file.is_file()), None)


def _imported(module: str, file: Path) -> Iterator[str]:
    """The names that any import statement of a file may mean as modules."""
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            dots = "." * node.level + (node.module or "")
            base = importlib.util.resolve_name(dots, package) if node.level else dots
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.suffix == ".py" else "compiled"
