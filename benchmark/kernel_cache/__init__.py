"""Compiled kernels: remove those of older code, and choose a writable folder for them.

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


def drop_stale_kernels() -> None:
    """Remove the compiled kernels of the suite that are older than their code, or that of a module they use."""
    for source in suite_sources():
        if b"numba" in source.read_bytes():
            with suppress(OSError):  # a folder that is read-only
                _drop_if_stale(source)


def remove_kernels(sources: Iterable[Path]) -> None:
    """Remove the compiled kernels of source files."""
    for source in sources:
        with suppress(OSError):
            for path in compiled_kernels(source):
                path.unlink(missing_ok=True)


def suite_sources() -> list[Path]:
    """Return the source files of the suite."""
    return [path for package in FIRST_PARTY for path in sorted((ROOT / package).rglob("*.py"))]


def compiled_kernels(source: Path) -> list[Path]:
    """Return numba's files with the compiled kernels of a source file."""
    return [*kernel_folder(source).glob(f"{glob.escape(source.stem)}.*.nb[ic]")]


def _drop_if_stale(source: Path) -> None:
    """Remove kernels that are older than a source that they are compiled from, or its move to its place."""
    target = ".".join(source.relative_to(ROOT).with_suffix("").parts)
    newest = max(path.stat().st_ctime_ns for path in sources_of(target))
    if any(path.stat().st_ctime_ns < newest for path in compiled_kernels(source)):
        remove_kernels([source])


def kernel_folder(source: Path) -> Path:
    """Return the folder where numba stores the compiled kernels of a source file."""
    if not os.environ.get(VARIABLE):
        return source.parent / "__pycache__"
    from numba.core.caching import _CacheLocator

    return Path(os.environ[VARIABLE]) / str(_CacheLocator.get_suitable_cache_subpath(str(source)))


def choose_kernel_cache() -> None:
    """Set a folder for compiled kernels, for this process and its children, if that of the suite is read-only.

    Only the user may write to it, because its content is executed.
    """
    if VARIABLE in os.environ or os.access(Path(__file__).parent, os.W_OK):
        return
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111  # raises nothing
    folder = Path(home) / "canonical-forms-kernels"
    is_private = False
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
        is_ours = status.st_uid == os.getuid() and stat.S_ISDIR(status.st_mode)
        is_private = is_ours and not status.st_mode & 0o022 and os.access(folder, os.W_OK)
    os.environ[VARIABLE] = (
        str(folder) if is_private else tempfile.mkdtemp(prefix="canonical-forms-")
    )
