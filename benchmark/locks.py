"""Locks of open files and folders, by which processes keep out of each other's work."""

from __future__ import annotations

import fcntl
from collections.abc import Callable


def take_lock(
    descriptor: int,
    *,
    refusal: Exception | None = None,
    before_waiting: Callable[[], object] | None = None,
) -> None:
    """Lock an open file or folder for this process, until the file is closed or the process ends.

    Where the file system has no locks, nothing is locked.

    Parameters
    ----------
    descriptor
        Descriptor of the file or folder.
    refusal
        Raised if another process has the lock; by default this one waits for it.
    before_waiting
        Called before it waits.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if refusal is not None:
            raise refusal from None
        if before_waiting is not None:
            before_waiting()
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    except OSError:
        pass  # the file system has no locks
