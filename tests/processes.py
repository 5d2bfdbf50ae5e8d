"""Other processes: whether one is still there, and what is waited for while they work."""

from __future__ import annotations

import time
from collections.abc import Callable

import psutil


def is_alive(process: int) -> bool:
    """Whether a process is still there."""
    return psutil.pid_exists(process) and psutil.Process(process).status() != psutil.STATUS_ZOMBIE


def wait_until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait for what must come."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)
