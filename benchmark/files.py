"""Files that are whole or absent: written beside their place, then moved there."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

_SUFFIX = ".tmp"

#: Seconds after which nobody is at a temporary file any more, though a process has the number of its writer again.
_LONGEST = 3600.0


def write_atomically(path: Path, write: Callable[[Any], object], *, durable: bool = False) -> None:
    """Write a file so that a reader, and a process killed at any moment, leave the old content or the new one.

    Parameters
    ----------
    path
        The file; its folder is made if need be. It gets the rights that the umask leaves. A device or a pipe, which
        holds nothing to keep, is written to and not replaced.
    write
        Called with the binary file to write to.
    durable
        Whether the content is flushed to the disk before the file gets its name, so that a power cut cannot lose it.

    Raises
    ------
    OSError
        If the file cannot be written; nothing is left behind then.
    """
    if path.is_char_device() or path.is_fifo():
        with path.open("wb") as file:
            write(file)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    # The name says who writes, so that what a killed process leaves behind can be told from what is being written.
    temporary = path.parent / f".{os.getpid()}-{secrets.token_hex(4)}{_SUFFIX}"
    try:
        with temporary.open("xb") as file:
            write(file)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str, *, durable: bool = False) -> None:
    """Write a text in UTF-8 with :func:`write_atomically`."""
    write_atomically(path, lambda file: file.write(text.encode("utf-8")), durable=durable)


@contextlib.contextmanager
def locked(folder: Path, *, alone: bool = False) -> Iterator[None]:
    """Wait until nobody writes a folder with this, or reads it where ``alone`` is asked for, and keep others out.

    The system frees it when the process ends, however it ends. Without such a folder, or on a file system without
    locks, nobody waits.
    """
    try:
        place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        yield
        return
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(place, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield
    finally:
        os.close(place)


def leftovers(folder: Path, *, deep: bool = True) -> Iterator[Path]:
    """Temporary files in a folder, and in those below it, whose writers are no longer alive, or an hour old."""
    for path in (folder.rglob if deep else folder.glob)(f".*-*{_SUFFIX}"):
        writer = path.name[1:].partition("-")[0]
        if writer.isdecimal() and (not is_alive(int(writer)) or _is_old(path)):
            yield path


def _is_old(path: Path) -> bool:
    try:
        return time.time() - path.stat().st_mtime > _LONGEST
    except OSError:
        return False  # it has just got its name


def sweep(folder: Path, *, deep: bool = True) -> int:
    """Remove what killed writers left in a folder, and in those below it; returns the number of files."""
    count = 0
    for path in leftovers(folder, deep=deep):
        with contextlib.suppress(OSError):
            path.unlink()
            count += 1
    return count


def is_alive(process: int) -> bool:
    """Return whether there is a process with this number."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True  # it belongs to somebody else
    return True
