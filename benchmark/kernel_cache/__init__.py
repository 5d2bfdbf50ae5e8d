"""The cache of compiled kernels: remove those of older code, and choose a writable folder for it.

numba keeps a compiled kernel until its own file changes, although kernels of other files, and
values that a plugin read from anywhere, are compiled into it. So those of a plugin never outlive
the process that compiled them.
"""

from __future__ import annotations

import atexit
import os
import stat
import sys
from collections.abc import Iterable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from benchmark.code_digest import FIRST_PARTY, ROOT, sources_below, sources_of
from benchmark.places import make_folder, remove_folder

#: Environment variable with the folder where numba stores compiled kernels.
VARIABLE = "NUMBA_CACHE_DIR"

#: End of the name of a mark: a file which says that the kernels of a step of a run were compiled.
_MARK = ".compiled"

#: Ends of the names of numba's files, which are an index and the compiled kernels, and of marks,
#: which go with them.
_ENDINGS = (".nbi", ".nbc", _MARK)

#: Permission bits with which others than its owner can write to a folder.
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def drop_stale_kernels() -> None:
    """Remove the compiled kernels of the suite that are older than their code."""
    sources = suite_sources()
    newest = max(_moved_to_place(source) for source in sources)
    for source in sources:
        with suppress(OSError):  # a folder that is read-only
            if _is_stale(source, newest):
                remove_kernels([source])


def _is_stale(source: Path, newest: int) -> bool:
    """Return whether kernels of a file are older than a source that is compiled into them.

    Parameters
    ----------
    source
        The file.
    newest
        When the newest source of the suite was moved to its place. What is compiled into the
        kernels of a file takes long to find, and needs not be known of kernels that are newer.
    """
    kernels = compiled_kernels(source)
    if not kernels:
        return False
    oldest = min(_moved_to_place(kernel) for kernel in kernels)
    if oldest >= newest:
        return False
    module = ".".join(source.relative_to(ROOT).with_suffix("").parts)
    return any(_moved_to_place(path) > oldest for path in sources_of(module))


def _moved_to_place(path: Path) -> int:
    """Return when a file was moved to its place, as by a checkout, or changed since."""
    return path.stat().st_ctime_ns


def remove_kernels(sources: Iterable[Path]) -> None:
    """Remove the compiled kernels of source files."""
    for source in sources:
        with suppress(OSError):
            for path in compiled_kernels(source):
                path.unlink(missing_ok=True)


def suite_sources() -> list[Path]:
    """Return the source files of the suite."""
    sources: list[Path] = []
    for package in FIRST_PARTY:
        sources += sources_below(ROOT / package)
    return sources


def compiled_kernels(source: Path) -> list[Path]:
    """Return numba's files with the compiled kernels of a source file, and marks of steps."""
    folder = kernel_folder(source)
    try:
        names = os.listdir(folder)  # noqa: PTH208  # faster than glob, for each file of the suite
    except OSError:
        return []
    prefix = f"{source.stem}."
    return [folder / name for name in names if name.startswith(prefix) and name.endswith(_ENDINGS)]


def mark(name: str, source: Path) -> None:
    """Note that the kernels of a step were compiled: those that a source file uses."""
    path = _mark_of(name, source)
    with suppress(OSError):  # a folder that is read-only
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def is_marked(name: str, source: Path) -> bool:
    """Return whether the kernels of a step were compiled, and none of their code has changed.

    That it changed is known after :func:`drop_stale_kernels`.
    """
    return _mark_of(name, source).is_file()


def _mark_of(name: str, source: Path) -> Path:
    """Return the file that says that this Python and numba compiled the kernels of a step."""
    makers = f"{sys.implementation.cache_tag}-{version('numba')}"
    return kernel_folder(source) / f"{source.stem}.{name}-{makers}{_MARK}"


def kernel_folder(source: Path) -> Path:
    """Return the folder where numba stores the compiled kernels of a source file."""
    if not os.environ.get(VARIABLE):
        return source.parent / "__pycache__"
    from numba.core.caching import _CacheLocator

    return Path(os.environ[VARIABLE]) / str(_CacheLocator.get_suitable_cache_subpath(str(source)))


def choose_kernel_cache() -> None:
    """Set a folder for compiled kernels if that of the suite is read-only.

    It holds for this process and its children. Kernels are executed, so a folder to which others
    can write is not used.
    """
    if VARIABLE in os.environ or os.access(Path(__file__).parent, os.W_OK):
        return
    user_cache = os.environ.get("XDG_CACHE_HOME")
    if not user_cache:
        # Unlike Path.expanduser, this raises nothing.
        user_cache = os.path.expanduser("~/.cache")  # noqa: PTH111
    folder = Path(user_cache) / "canonical-forms-kernels"
    if not _make_private_folder(folder):
        folder = Path(make_folder())
        atexit.register(remove_folder, str(folder))
    os.environ[VARIABLE] = str(folder)


def _make_private_folder(folder: Path) -> bool:
    """Create a folder; return whether only this user can write to it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return False
    is_own_folder = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    return is_own_folder and not status.st_mode & _WRITABLE_BY_OTHERS and os.access(folder, os.W_OK)
