"""Compiled kernels on the disk: those that are older than code that was compiled into them go.

numba keeps a kernel until its own file changes; the kernels of other files that it calls are part of it, too.
"""

from __future__ import annotations

import ast
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from benchmark.source_code import FIRST_PARTY

#: Endings of numba's files.
_ENDINGS = (".nbi", ".nbc")


def compiled_files(root: Path) -> Iterator[tuple[Path, Sequence[Path]]]:
    """Return the modules under a root that have compiled kernels, each with their files."""
    for package in FIRST_PARTY:
        for folder in sorted((root / package).rglob("__pycache__")):
            kept: dict[str, list[Path]] = {}
            for path in sorted(folder.iterdir()):
                if path.suffix in _ENDINGS:
                    kept.setdefault(path.name.partition(".")[0], []).append(path)
            for name, paths in kept.items():
                source = folder.parent / f"{name}.py"
                if source.is_file():
                    yield source, paths


def drop_stale_kernels(root: Path, changed: frozenset[Path] | None = None) -> int:
    """Remove compiled kernels that are older than their own module, or than one whose kernels or constants they use.

    Parameters
    ----------
    root
        Folder that holds the packages of the suite.
    changed
        Files that are newer than the kernels; None goes by the times of files.

    Returns
    -------
    int
        Number of files that were removed.
    """
    known = {".".join(path.relative_to(root).with_suffix("").parts): path for path in _sources(root)}
    callees = cache(lambda source: _callees(source, known))
    last_edit = max((path.stat().st_mtime_ns for path in known.values()), default=0)
    looked_at = min(last_edit, time.time_ns())  # no edit to come is older, whatever the clock of the last one
    count = 0
    for source, kept in compiled_files(root):
        if changed is None and all(path.stat().st_mtime_ns >= last_edit for path in kept):
            continue  # newer than everything, so that no source need be parsed
        behind = _compiled_together(source, callees)
        newest = max(path.stat().st_mtime_ns for path in behind)
        for path in kept:
            with suppress(OSError):
                if path.stat().st_mtime_ns < newest if changed is None else behind & changed:
                    path.unlink()
                    count += 1
                elif changed is None:  # later edits alone need be looked at
                    os.utime(path, ns=(looked_at, looked_at))
    return count


def _sources(root: Path) -> Iterator[Path]:
    for package in FIRST_PARTY:
        yield from sorted((root / package).rglob("*.py"))


def _compiled_together(source: Path, callees: Callable[[Path], set[Path]]) -> set[Path]:
    """A module with all those whose kernels and constants may be part of its own kernels."""
    found, pending = {source}, [source]
    while pending:
        new = callees(pending.pop()) - found
        found |= new
        pending += new
    return found


def _callees(source: Path, known: Mapping[str, Path]) -> set[Path]:
    """Modules from which one imports kernels or constants."""
    found = set()
    for node in ast.walk(ast.parse(source.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = {alias.name for alias in node.names}
            found |= {known[name] for each in names if (name := f"{node.module}.{each}") in known}
            path = known.get(node.module)
            if path and (any(name.isupper() for name in names) or b"njit" in path.read_bytes()):
                found.add(path)
    return found
