"""A training that is killed while it writes a checkpoint: ``python -m tests.learned.interrupted FOLDER``."""

from __future__ import annotations

from benchmark.machine import pin_threads

pin_threads()

import os  # noqa: E402
import signal  # noqa: E402
import sys  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

from learned.paired import configuration, fitting  # noqa: E402
from learned.training import loop  # noqa: E402
from tests.learned.toy import OPTIONS, TINY, toy_data  # noqa: E402

#: A checkpoint is written after each epoch.
CHECKPOINT = 13


def deadly(function: Callable[..., Any], call: int) -> Callable[..., Any]:
    """The function, which kills this process when it is called for the given time, counted from 1."""
    calls = 0

    def wrapped(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == call:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments)

    return wrapped


if __name__ == "__main__":
    configuration.CONFIGURATIONS[TINY.name] = TINY
    loop.CHECKPOINT_SECONDS = 0.0
    os.fsync = deadly(os.fsync, CHECKPOINT)
    fitting.fit(TINY.name, 0, toy_data(), Path(sys.argv[1]), OPTIONS, print)
