"""What the control groups of this process, such as those of a container, let it use of the machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

_MOUNTED, _GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def memory_limit() -> float:
    """Bytes that this process and those beside it may take; infinity where there is no limit."""
    limits = [float("inf")]
    for controller, folder in _folders():
        name = "memory.max" if not controller else "memory.limit_in_bytes"
        with suppress(OSError, ValueError):
            limits.append(float((folder / name).read_text(encoding="ascii")))
    return min(limits)


def cpu_limit() -> float:
    """Processors whose time this process and those beside it may take; infinity where there is no limit."""
    limits = [float("inf")]
    for controller, folder in _folders():
        names = ["cpu.max"] if not controller else ["cpu.cfs_quota_us", "cpu.cfs_period_us"]
        with suppress(OSError, ValueError):
            quota, period = " ".join((folder / name).read_text(encoding="ascii") for name in names).split()
            if float(quota) > 0:
                limits.append(float(quota) / float(period))
    return min(limits)


def _folders() -> Iterator[tuple[str, Path]]:
    """Folders of the groups that this process is in, with their controller; "" for those that have all of them."""
    with suppress(OSError, ValueError):
        for line in _GROUPS.read_text(encoding="utf-8").splitlines():
            _, controllers, name = line.split(":", 2)
            for controller in controllers.split(","):
                if controller in ("", "memory", "cpu"):
                    path = PurePosixPath(name.lstrip("/"))
                    yield from ((controller, _MOUNTED / controller / each) for each in (path, *path.parents))
