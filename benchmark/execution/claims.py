"""Locks on jobs, for concurrent runs in one results folder."""

from __future__ import annotations

import fcntl
import hashlib
import os
from contextlib import suppress
from pathlib import Path

#: Byte locked while any run is in progress; the bytes of jobs follow it.
_RUN = 0


class Claims:
    """Locks of this process on its jobs, and a shared lock that shows that a run is in progress.

    Each lock is one byte of one file. The system releases it when the process ends, however it ends, so no run waits
    for a process that no longer exists. Leaving the ``with`` block ends the run.

    Parameters
    ----------
    folder
        Folder of the file, which is created if necessary and stays empty. Use one object per process, because locks
        belong to processes.

    Raises
    ------
    OSError
        If it cannot be opened.
    """

    def __init__(self, folder: Path) -> None:
        self._file = os.open(folder / "claims", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        with suppress(OSError):  # a file system without locks: two runs then repeat each other's work
            fcntl.lockf(self._file, fcntl.LOCK_SH, 1, _RUN)

    def __enter__(self) -> Claims:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def is_last(self) -> bool:
        """Return whether no other run is in progress; if so, none can begin before this one ends.

        On a file system without locks, this is unknown, and False.
        """
        return self._lock(_RUN, without_locks=False)

    def take(self, key: str) -> bool:
        """Claim a job, perhaps again; return False if another process has claimed it."""
        return self._lock(_place(key))

    def release(self, key: str) -> None:
        """Release a job, if it is claimed."""
        with suppress(OSError):
            fcntl.lockf(self._file, fcntl.LOCK_UN, 1, _place(key))

    def _lock(self, place: int, *, without_locks: bool = True) -> bool:
        try:
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
        except (BlockingIOError, PermissionError):
            return False
        except OSError:
            return without_locks
        return True


def _place(key: str) -> int:
    """Return the byte of a job; a collision within a plan is practically impossible."""
    return 1 + int.from_bytes(hashlib.sha256(key.encode()).digest()[:7]) // 2
