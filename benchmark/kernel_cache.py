"""Choose a folder for compiled kernels if neither the suite nor the home folder is writable."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

#: Environment variable with the folder where numba stores compiled kernels.
VARIABLE = "NUMBA_CACHE_DIR"

_PACKAGE = Path(__file__).parent


def choose_kernel_cache() -> None:
    """Set a temporary folder for compiled kernels, for this process and its children, if numba would find none.

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
    there = next(place for place in (folder, *folder.parents) if place.exists())
    return folder.is_absolute() and os.access(there, os.W_OK | os.X_OK)
