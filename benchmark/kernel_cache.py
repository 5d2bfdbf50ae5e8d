"""A folder for compiled kernels where neither the suite's own nor the user's can be written."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

#: Environment variable by which numba is told where to keep compiled kernels.
VARIABLE = "NUMBA_CACHE_DIR"

_PACKAGE = Path(__file__).parent


def choose_kernel_cache() -> None:
    """Name a folder for compiled kernels, for this process and those that it starts, if numba would find none.

    It lies among temporary files and belongs to the user alone: what lies in it is executed.
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
    """Return whether a folder is there, or can be made, and can be written to."""
    there = next(place for place in (folder, *folder.parents) if place.exists())
    return folder.is_absolute() and os.access(there, os.W_OK | os.X_OK)
