"""Commands started, watched and ended within a time."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from benchmark.threads import VARIABLES

ROOT = Path(__file__).parents[2]
BENCHMARK = "benchmark.cli.main:program"

#: Seconds after which a process that nobody needs must be gone.
GRACE = 8.0


@dataclass(frozen=True)
class Done:
    """A command that has ended.

    Parameters
    ----------
    code
        Exit code, or minus the number of a signal; None if it had to be stopped.
    output, error
        What it wrote.
    seconds
        How long it took.
    """

    code: int | None
    output: str
    error: str
    seconds: float

    @property
    def said(self) -> str:
        """All that the user saw."""
        return self.output + self.error


class Launcher:
    """Starts one command at a time by a fork server of its own."""

    def __init__(self) -> None:
        self._server = subprocess.Popen(
            [sys.executable, "-c", "from tools.faults.fork_server import serve; serve()"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, env=environment(), start_new_session=True,
        )  # fmt: skip
        self._answer()

    def start(
        self,
        arguments: list[str],
        folder: Path,
        *,
        target: str = BENCHMARK,
        variables: Mapping[str, str] | None = None,
        limits: Mapping[str, int] | None = None,
        ordinary_rights: bool = False,
        output: str = "",
        patience: float = 0.0,
    ) -> Running:
        """Start a command.

        Parameters
        ----------
        arguments
            Words after the name of the program.
        folder
            Where its output is kept; its working folder as well.
        target
            ``module:function`` that is the program.
        variables
            Environment variables beside the usual ones.
        limits
            Limits of resources by their names in :mod:`resource`.
        ordinary_rights
            Whether permissions count even if this program is run by root.
        output
            Where its standard output goes instead of a file in the folder.
        patience
            Seconds that importing a plugin may take; 0 for the usual limit.
        """
        for name in ("stdout", "stderr"):
            (folder / name).write_bytes(b"")
        request = {
            "arguments": arguments, "folder": str(folder), "target": target,
            "output": output or str(folder / "stdout"), "error": str(folder / "stderr"),
            "environment": environment() | dict(variables or {}), "limits": dict(limits or {}),
            "ordinary_rights": ordinary_rights, "patience": patience,
        }  # fmt: skip
        assert self._server.stdin is not None
        self._server.stdin.write(json.dumps(request).encode() + b"\n")
        self._server.stdin.flush()
        return Running(self, int(self._answer()), folder, time.monotonic())

    def orphans(self) -> list[psutil.Process]:
        """Processes that are still there although the command has ended, after some time to go."""
        deadline = time.monotonic() + GRACE
        while (left := _living(self._server.pid)) and time.monotonic() < deadline:
            time.sleep(0.02)
        return left

    def code(self, seconds: float) -> int | None:
        """Exit code of the command that was started; None if it does not come within some seconds."""
        assert self._server.stdout is not None
        ready, _, _ = select.select([self._server.stdout], [], [], max(seconds, 0.0))
        return int(self._answer()) if ready else None

    def end_everything(self) -> None:
        """Kill what the command left."""
        for process in _living(self._server.pid):
            with suppress(psutil.Error):
                process.kill()

    def close(self) -> None:
        """End the fork server."""
        self.end_everything()
        self._server.kill()
        self._server.communicate()

    def _answer(self) -> bytes:
        assert self._server.stdout is not None
        # Read byte by byte: a buffer would hide from ``select`` what has come already.
        line = b""
        while not line.endswith(b"\n"):
            if not (byte := os.read(self._server.stdout.fileno(), 1)):
                raise RuntimeError("the fork server has ended")
            line += byte
        return line


@dataclass
class Running:
    """A command at work."""

    launcher: Launcher
    pid: int
    folder: Path
    begun: float
    code: int | None = None

    def has_ended(self, seconds: float = 0.0) -> bool:
        """Wait for some seconds; whether it has ended."""
        if self.code is None:
            self.code = self.launcher.code(seconds)
        return self.code is not None

    def stop(self) -> None:
        """Kill it with all that it started."""
        self.launcher.end_everything()
        while not self.has_ended(1.0):
            self.launcher.end_everything()

    def signal(self, number: signal.Signals, *, group: bool = False) -> None:
        """Send a signal to it, or to all processes of its session as a terminal does."""
        if not self.has_ended():
            (os.killpg if group else os.kill)(self.pid, number)

    def done(self, *, was_stopped: bool = False) -> Done:
        """What it said; call it when it has ended."""
        texts = [(self.folder / name).read_text(errors="replace") for name in ("stdout", "stderr")]
        return Done(None if was_stopped else self.code, texts[0], texts[1], time.monotonic() - self.begun)

    def workers(self) -> list[psutil.Process]:
        """Processes at work for it."""
        found = []
        with suppress(psutil.Error):
            for child in psutil.Process(self.pid).children():
                with suppress(psutil.Error):
                    if any("spawn_main" in word for word in child.cmdline()):
                        found.append(child)
        return found


def environment() -> dict[str, str]:
    """Variables of every command: those of this process, one thread each, and no official data."""
    kept: dict[str, Any] = {name: value for name, value in os.environ.items() if name != "CANONICAL_FORMS_DATA"}
    return kept | dict.fromkeys(VARIABLES, "1") | {"PYTHONPATH": str(ROOT)}


def _living(server: int) -> list[psutil.Process]:
    found = []
    with suppress(psutil.Error):
        for process in psutil.Process(server).children(recursive=True):
            with suppress(psutil.Error):
                if process.status() != psutil.STATUS_ZOMBIE:
                    found.append(process)
    return found
