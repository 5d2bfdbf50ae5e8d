"""Places of the user that the code of a plugin does not see.

They are home, settings, caches and temporary files. While a plugin runs, their environment
variables name a fresh folder of its process, so that nothing it left there in an earlier run
determines a result of this one.
"""

from __future__ import annotations

import atexit
import fcntl
import os
import shutil
import site
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from benchmark.errors import ConfigurationError

#: Prefix of the names of fresh folders.
_PREFIX = "canonical-forms-of-process-"

#: Seconds for which a folder without a lock is left alone: its process may be about to lock it.
_YOUNG = 60.0

#: Descriptors of the locks of the folders that this process made. The system frees them when the
#: process ends, whatever ends it.
_locks: dict[str, int] = {}

#: Variables that name places of a user, and caches of libraries, which may lie anywhere. Compiled
#: kernels stay where the suite keeps them (``NUMBA_CACHE_DIR``).
_VARIABLES = (
    "HOME",
    "TMPDIR",
    "TMP",
    "TEMP",
    "XDG_RUNTIME_DIR",
    "XDG_CACHE_HOME",
    "XDG_CONFIG_HOME",
    "XDG_DATA_HOME",
    "XDG_STATE_HOME",
    "MPLCONFIGDIR",
    "TORCH_HOME",
    "TORCHINDUCTOR_CACHE_DIR",
    "TRITON_CACHE_DIR",
    "HF_HOME",
    "JOBLIB_TEMP_FOLDER",
    "SCIKIT_LEARN_DATA",
)


def away_from_home(environment: dict[str, str], folder: str) -> dict[str, str]:
    """Return an environment whose places of the user are a folder.

    Packages that the user installed are still found.
    """
    away = {name: value for name, value in environment.items() if not name.startswith("XDG_")}
    away["PYTHONUSERBASE"] = site.getuserbase()
    for name in _VARIABLES:
        away[name] = folder
    return away


@contextmanager
def no_places_of_the_user() -> Iterator[None]:
    """Hide the home folder of the user from the code in a ``with`` block.

    The code sees an empty folder instead, which also takes temporary files. A worker has such a
    folder already, so that nothing changes there.
    """
    is_away = Path(os.environ.get("HOME", "")).name.startswith(_PREFIX)
    if is_away:
        yield
        return
    environment = dict(os.environ)
    temporary = tempfile.tempdir
    away = live_in(_folder_of_process(os.getpid()))
    try:
        yield
    finally:
        _set_variables(away, environment)
        tempfile.tempdir = temporary


def live_in(folder: str) -> dict[str, str]:
    """Let a folder be the home of the user in this process; return the new environment."""
    environment = dict(os.environ)
    away = away_from_home(environment, folder)
    _set_variables(environment, away)
    tempfile.tempdir = folder
    return away


def _set_variables(old: dict[str, str], new: dict[str, str]) -> None:
    """Change what differs between two environments, and leave what else was changed meanwhile."""
    for name in old.keys() - new.keys():
        os.environ.pop(name, None)
    for name, value in new.items():
        if old.get(name) != value:
            os.environ[name] = value


@cache
def _folder_of_process(process: int) -> str:
    """Return a fresh folder for a process, which goes with it."""
    folder = make_folder()
    atexit.register(remove_folder, folder)
    return folder


# Folders that go with their process
# ------------------------------------------------------------------------------------------------


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Make a fresh folder for a ``with`` block; see :func:`make_folder`."""
    folder = make_folder()
    try:
        yield Path(folder)
    finally:
        remove_folder(folder)


def make_folder() -> str:
    """Make a fresh folder, and remove those that killed processes have left.

    It is locked as long as this process lives. Who makes it removes it by :func:`remove_folder`.

    Raises
    ------
    ConfigurationError
        If none can be made, as on a full disk.
    """
    try:
        parent = tempfile.gettempdir()
    except OSError as error:  # which names the folders that were tried
        problem = f"nothing can be written to any folder for temporary files: {error.strerror}"
        hint = "free some space in one, or name another folder by the variable TMPDIR"
        raise ConfigurationError(problem, hint) from error
    try:
        _remove_abandoned()
        folder = tempfile.mkdtemp(prefix=_PREFIX, dir=parent)
    except OSError as error:
        problem = f"no temporary folder can be made in {parent}: {error.strerror}"
        hint = "free some space there, or name another folder by the variable TMPDIR"
        raise ConfigurationError(problem, hint) from error
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    with suppress(OSError):  # a file system without locks, where no folder counts as abandoned
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    _locks[folder] = lock
    return folder


def remove_folder(folder: str) -> None:
    """Remove a folder of :func:`make_folder` with its content."""
    shutil.rmtree(folder, ignore_errors=True)
    lock = _locks.pop(folder, None)
    if lock is not None:
        os.close(lock)


def _remove_abandoned() -> None:
    """Remove the folders of processes that have ended without removing them."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):  # it belongs to another user, or another process has removed it
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                _remove_if_abandoned(folder, lock)
            finally:
                os.close(lock)


def _remove_if_abandoned(folder: Path, lock: int) -> None:
    """Remove a folder of this user whose process has ended; raise ``OSError`` if it lives."""
    status = os.fstat(lock)
    if status.st_uid != os.getuid() or time.time() - status.st_mtime < _YOUNG:
        return
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    shutil.rmtree(folder, ignore_errors=True)
