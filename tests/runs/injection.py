"""Lets a function of the suite fail in workers, of the suite and of plugins alike; imported when
they start.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
import time

from tests.runs.faults import NOTES, note


def fail(real, how, times):
    """Let a function that methods share fail in one way, as often as that, and then work."""

    def failing(*arguments):
        if (
            len([*NOTES.glob("failed-*")]) >= times
        ):  # a file that a plugin does not declare must not be read
            return real(*arguments)
        note(f"failed-{os.getpid()}")
        if how == "sleep":
            time.sleep(3600)
        os.kill(os.getpid(), signal.SIGKILL)

    return failing


if "benchmark.runs.tasks" in " ".join(sys.orig_argv) and os.environ.get("FAILS"):
    module, name, how, times = os.environ["FAILS"].split()
    module = importlib.import_module(module)
    setattr(module, name, fail(getattr(module, name), how, int(times)))
