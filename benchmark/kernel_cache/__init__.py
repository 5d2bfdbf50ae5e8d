"""The cache of compiled kernels: remove those of older code, and choose a writable folder for it.

numba keeps a compiled kernel until its own file changes, although kernels of other files, and
values that a plugin read from anywhere, are compiled into it. So those of a plugin never outlive
the process that compiled them.
"""

from __future__ import annotations

import glob
import os
import stat
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from benchmark.code_digest import FIRST_PARTY, ROOT, sources_of

#: Environment variable with the folder where numba stores compiled kernels.
VARIABLE = "NUMBA_CACHE_DIR"

#: Permission bits with which others than its owner can write to a folder.
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def drop_stale_kernels() -> None:
    """Remove the compiled kernels of the suite that are older than their code."""
    for source in suite_sources():
        if b"numba" not in source.read_bytes():
            continue
        with suppress(OSError):  # a folder that is read-only
            if _is_stale(source):
                remove_kernels([source])


def _is_stale(source: Path) -> bool:
    """Return whether kernels of a file are older than a source that is compiled into them.

    A source counts from when it was moved to its place, as by a checkout, so that the time of
    its last change of any kind is compared.
    """
    module = ".".join(source.relative_to(ROOT).with_suffix("").parts)
    newest_source = max(path.stat().st_ctime_ns for path in sources_of(module))
    return any(path.stat().st_ctime_ns < newest_source for path in compiled_kernels(source))


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
        sources += sorted((ROOT / package).rglob("*.py"))
    return sources


def compiled_kernels(source: Path) -> list[Path]:
    """Return numba's files with the compiled kernels of a source file."""
    return [*kernel_folder(source).glob(f"{glob.escape(source.stem)}.*.nb[ic]")]


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
        folder = Path(tempfile.mkdtemp(prefix="canonical-forms-"))
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
