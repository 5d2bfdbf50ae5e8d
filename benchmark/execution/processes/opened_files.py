"""Files read by a plugin: digests stored with its results show when the results are outdated."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import stat
import sys
import sysconfig
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import ABOUT
from benchmark.source_code import FIRST_PARTY, ROOT

#: Name of the array with the paths and digests of the files in a result.
FILES = f"{ABOUT}files"

#: Prefixes of files that are not part of a plugin: Python, installed packages, the suite, the system.
NOT_OF_PLUGINS = tuple(
    f"{folder}{os.sep}"
    for folder in (
        *(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")),
        *(Path(json.__file__).parents[1], *(ROOT / name for name in FIRST_PARTY), "/proc", "/sys", "/dev"),
    )
)

_read: dict[str, str] = {}
_own: set[str] = set()
_known: dict[tuple[str, int, int], str] = {}


def watch_opened_files() -> None:
    """Record the files that this process reads from now on, except those that it writes itself."""
    sys.addaudithook(_hear)


def opened_files() -> dict[str, str]:
    """Return the digests of the files read, by path, except files that were deleted since."""
    for path in [path for path, digest in list(_read.items()) if not digest]:
        _read[path] = digest_of_file(path)
    return {path: digest for path, digest in sorted(_read.items()) if digest and not _is_own(path)}


def leave_out(path: Path) -> None:
    """Exclude a file whose content is tracked elsewhere."""
    _own.add(str(path))


def digest_of_file(path: str) -> str:
    """Return the digest of a file, 32 hexadecimal digits, or "" if it cannot be read."""
    try:
        facts = os.stat(path)  # noqa: PTH116  # a path as reported by the audit hook
        known_as = (path, facts.st_size, facts.st_mtime_ns)
        if known_as not in _known:
            if not stat.S_ISREG(facts.st_mode):  # a device has no end
                return ""
            with Path(path).open("rb") as file:
                _known[known_as] = hashlib.file_digest(file, "sha256").hexdigest()[:32]
        return _known[known_as]
    except (OSError, ValueError):
        return ""


def changed_files(files: Mapping[str, str]) -> list[str]:
    """Return the paths of the files that have changed."""
    return [path for path, digest in files.items() if digest_of_file(path) != digest]


def with_files(arrays: Mapping[str, NDArray[Any]], files: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """Add the files that were read to the arrays of a result."""
    return {**arrays, FILES: np.array(json.dumps(files))} if files else dict(arrays)


def files_among(arrays: dict[str, NDArray[Any]]) -> dict[str, str]:
    """Remove and return the files recorded in the arrays of a result."""
    return dict(json.loads(str(arrays.pop(FILES)))) if FILES in arrays else {}


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open":
        path, mode, flags = arguments
        if isinstance(path, str | bytes) and isinstance(flags, int):
            _note(os.fsdecode(path), writes=bool(flags & (os.O_WRONLY | os.O_RDWR)) or "w" in str(mode or ""))
    elif event == "subprocess.Popen" and isinstance(arguments[0], str | bytes):
        _note(os.fsdecode(arguments[0]), writes=False)
    elif event in ("tempfile.mkdtemp", "tempfile.mkstemp"):
        _own.add(os.fsdecode(arguments[0]))


def _note(path: str, *, writes: bool) -> None:
    with suppress(OSError, ValueError):
        path = os.path.realpath(path)
        if path.endswith(".pyc"):
            path = importlib.util.source_from_cache(path)
        if writes:
            _own.add(path)
        elif path not in _read and not path.startswith(NOT_OF_PLUGINS) and os.path.isfile(path):  # noqa: PTH113
            _read[path] = ""


def _is_own(path: str) -> bool:
    return path in _own or any(str(parent) in _own for parent in Path(path).parents)
