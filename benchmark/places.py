"""Places of the user that the code of a plugin does not see.

They are home, settings, caches and temporary files. While a plugin runs, their environment
variables name a fresh folder of its process, so that nothing it left there in an earlier run
determines a result of this one.
"""

from __future__ import annotations

import atexit
import os
import shutil
import site
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

#: Prefix of the names of fresh folders.
PREFIX = "canonical-forms-"

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
    is_worker = os.environ.get("HOME") == os.environ.get("TMPDIR")
    if is_worker:
        yield
        return
    environment = dict(os.environ)
    temporary = tempfile.tempdir
    folder = _folder_of_process(os.getpid())
    away = away_from_home(environment, folder)
    _set_variables(environment, away)
    tempfile.tempdir = folder
    try:
        yield
    finally:
        _set_variables(away, environment)
        tempfile.tempdir = temporary


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
    folder = tempfile.mkdtemp(prefix=PREFIX)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
