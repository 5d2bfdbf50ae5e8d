"""Claims to jobs, where several runs share one folder of results."""

from __future__ import annotations

import fcntl
import hashlib
import os
from contextlib import suppress
from pathlib import Path

from benchmark.pipeline.storage.store import Store

#: Byte that stands for the run itself; those of jobs lie after it.
_RUN = 0


class Claims:
    """The jobs that this process has claimed, and its word that a run is under way.

    Each is one locked byte of one file. The system frees it when the process ends, however it ends, so nobody ever
    waits for the dead. As a context, the run is over at the end of the body.

    Parameters
    ----------
    path
        The file; it is made if it is not there, and stays empty.

    Raises
    ------
    OSError
        If it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        self._keys: set[str] = set()
        with suppress(OSError):  # a file system without locks: two runs then do the same work twice
            fcntl.lockf(self._file, fcntl.LOCK_SH, 1, _RUN)

    @classmethod
    def of(cls, store: Store) -> Claims:
        """Claims on the jobs of a store; a process has one object for each, for the system counts by process."""
        return cls(store.root / "claims")

    def __enter__(self) -> Claims:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def is_last(self) -> bool:
        """Return whether no other run is under way; if so, none begins until this one is over."""
        return self._lock(_RUN)

    def has(self, key: str) -> bool:
        """Return whether this process has claimed a job."""
        return key in self._keys

    def take(self, key: str) -> bool:
        """Claim a job; False if another process has done so."""
        if not self._lock(_place(key)):
            return False
        self._keys.add(key)
        return True

    def release(self, key: str) -> None:
        """Give a job back, if it is claimed."""
        if key in self._keys:
            with suppress(OSError):
                fcntl.lockf(self._file, fcntl.LOCK_UN, 1, _place(key))
            self._keys.remove(key)

    def _lock(self, place: int) -> bool:
        try:
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
        except (BlockingIOError, PermissionError):
            return False
        except OSError:
            return True  # a file system without locks
        return True


def _place(key: str) -> int:
    """Byte of a job: two of a plan never share one, for all that can be reckoned."""
    return 1 + int.from_bytes(hashlib.sha256(key.encode()).digest()[:7]) // 2
