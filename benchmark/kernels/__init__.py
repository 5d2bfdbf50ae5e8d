"""Compiled kernels: remove outdated ones, and choose a writable folder for them.

numba caches a kernel until its own file changes, although kernels of other files can be compiled into it.
"""

from __future__ import annotations

import ast
import os
import stat
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import groupby
from pathlib import Path

from benchmark.source_code import FIRST_PARTY

#: Extensions of numba's cache files.
_ENDINGS = (".nbi", ".nbc")


def compiled_files(root: Path) -> Iterator[tuple[Path, Sequence[Path]]]:
    """Yield the modules under a root that have compiled kernels, with their cache files."""
    for package in FIRST_PARTY:
        for folder in sorted((root / package).rglob("__pycache__")):
            kept = sorted(path for path in folder.iterdir() if path.suffix in _ENDINGS)
            for name, paths in groupby(kept, lambda path: path.name.partition(".")[0]):
                source = folder.parent / f"{name}.py"
                if source.is_file():
                    yield source, list(paths)


def drop_stale_kernels(root: Path) -> None:
    """Remove compiled kernels that are older than their module or one whose kernels or constants they use.

    Parameters
    ----------
    root
        Folder with the packages of the suite.
    """
    sources = (path for package in FIRST_PARTY for path in sorted((root / package).rglob("*.py")))
    known = {".".join(path.relative_to(root).with_suffix("").parts): path for path in sources}
    callees = cache(lambda source: _callees(source, known))
    last_edit = max((path.stat().st_mtime_ns for path in known.values()), default=0)
    looked_at = min(last_edit, time.time_ns())  # the clock of the last edit may have been ahead
    for source, kept in compiled_files(root):
        if all(path.stat().st_mtime_ns >= last_edit for path in kept):
            continue  # newer than all sources, which need not be parsed
        newest = max(path.stat().st_mtime_ns for path in _compiled_together(source, callees))
        for path in kept:
            with suppress(OSError):
                if path.stat().st_mtime_ns < newest:
                    path.unlink()
                else:  # the next call checks later edits only
                    os.utime(path, ns=(looked_at, looked_at))


def _compiled_together(source: Path, callees: Callable[[Path], set[Path]]) -> set[Path]:
    """Return a module and all those whose kernels and constants may be compiled into its own kernels."""
    reached, pending = {source}, [source]
    while pending:
        new = callees(pending.pop()) - reached
        reached |= new
        pending += new
    return reached


def _callees(source: Path, known: Mapping[str, Path]) -> set[Path]:
    """Return the modules from which a module imports kernels or constants."""
    files = set()
    for node in ast.walk(ast.parse(source.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = {alias.name for alias in node.names}
            files |= {known[name] for attribute in names if (name := f"{node.module}.{attribute}") in known}
            path = known.get(node.module)
            if path and (any(name.isupper() for name in names) or b"njit" in path.read_bytes()):
                files.add(path)
    return files


#: Environment variable with the folder where numba stores compiled kernels.
VARIABLE = "NUMBA_CACHE_DIR"

_PACKAGE = Path(__file__).parents[1]


def choose_kernel_cache() -> None:
    """Set a temporary folder for compiled kernels, for this process and its children, if numba has no writable one.

    Only the user may write to it, because its content is executed.
    """
    own = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111  # raises nothing
    if VARIABLE in os.environ or os.access(_PACKAGE / "geometry", os.W_OK) or _can_be_made(own):
        return
    folder = Path(tempfile.gettempdir()) / f"canonical-forms-kernels-{os.getuid()}"
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = folder.lstat()
    if status.st_uid == os.getuid() and stat.S_IMODE(status.st_mode) == 0o700 and stat.S_ISDIR(status.st_mode):
        os.environ[VARIABLE] = str(folder)
    else:
        os.environ[VARIABLE] = tempfile.mkdtemp(prefix="canonical-forms-")


def _can_be_made(folder: Path) -> bool:
    """Return whether a folder is writable or can be created."""
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    return folder.is_absolute() and os.access(existing, os.W_OK | os.X_OK)
