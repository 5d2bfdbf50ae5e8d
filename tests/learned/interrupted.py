"""A training in a process of its own that is killed on the way: ``python -m tests.learned.interrupted FOLDER WHERE``.

``WHERE`` is ``batch`` to die between two batches of an epoch, ``checkpoint`` to die while a checkpoint is written, and
``nowhere`` to finish.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import os  # noqa: E402
import signal  # noqa: E402
import sys  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

from learned.paired import configuration, fitting, training  # noqa: E402
from learned.training import loop  # noqa: E402
from tests.learned.toy import OPTIONS, TINY, toy_data  # noqa: E402

#: Of three batches in each epoch, the second of the ninth.
BATCH = 26
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


def main(folder: Path, where: str) -> None:
    """Train."""
    configuration.CONFIGURATIONS[TINY.name] = TINY
    loop.CHECKPOINT_SECONDS = 0.0
    if where == "batch":
        training.losses = deadly(training.losses, BATCH)
    if where == "checkpoint":
        os.fsync = deadly(os.fsync, CHECKPOINT)
    fitting.fit(TINY.name, 0, toy_data(), folder, OPTIONS, print)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
