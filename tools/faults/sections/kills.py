"""Signals at random to the harness, its workers and what their methods started, at every age of a worker."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from tools.faults.cases import Border, Case
from tools.faults.commands import Running
from tools.faults.plugin_files import LIGHT
from tools.faults.scene import INNOCENT, INTERRUPTED, NOT_OK, OK, STALL, USAGE, Scene

#: Kills in one results folder, after which its jobs are brought to their end.
PER_CASE = 5

#: Longest age at which a worker is struck, in seconds; most live less long.
LIFE = 4.0

METHODS = (INNOCENT, "light-size", "light-children")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
TARGETS = ("worker", "worker", "worker", "harness", "session", "child")

#: Exit codes of a run that was struck: a plugin file is refused if all processes that look at it are killed.
_ENDS = (OK, NOT_OK, USAGE)

#: Repetitions after which jobs that nobody perturbs must be done.
_REPETITIONS = 3


@dataclass(frozen=True)
class Stroke:
    """One kill.

    Parameters
    ----------
    target
        A worker, a program that its method runs, the harness, or the harness with all of its session.
    number
        The signal.
    age
        Age in seconds of the youngest worker when it happens.
    """

    target: str
    number: signal.Signals
    age: float

    @classmethod
    def drawn(cls, draw: random.Random) -> Stroke:
        """Half of the ages are from the whole life, half from the first second."""
        number = draw.choices(SIGNALS, (5, 2, 1, 2))[0]
        return cls(draw.choice(TARGETS), number, draw.uniform(0.0, draw.choice((LIFE, 1.0))))

    @property
    def fells_harness(self) -> bool:
        """Whether the run ends by it."""
        return self.target in ("harness", "session")

    def __str__(self) -> str:
        return f"{self.number.name} to the {self.target} at {self.age:.2f} s"


def cases(n_kills: int) -> list[Case]:
    """Cases of a few kills each."""
    return [Case(f"kills/{number:03}", _strike_and_recover) for number in range(-(-n_kills // PER_CASE))]


def _strike_and_recover(scene: Scene) -> None:
    _Siege(scene).go([Stroke.drawn(scene.random) for _ in range(PER_CASE)])


@dataclass
class _Siege:
    """Runs that are struck again and again in one results folder, until their jobs are done all the same."""

    scene: Scene
    running: Running | None = None
    kept: dict[str, bytes] = field(default_factory=dict)
    started: dict[int, float] = field(default_factory=dict)
    struck: set[int] = field(default_factory=set)
    struck_at: float | None = None
    said: str = ""

    def go(self, strokes: list[Stroke]) -> None:
        (self.scene.folder / "light.py").write_text(LIGHT)
        for stroke in strokes:
            self._strike(stroke)
            self.scene.outcome.tried += 1
        self._finish()

    def _strike(self, stroke: Stroke) -> None:
        """Wait for the moment and strike; the moment comes earlier if the run ends before."""
        age = stroke.age
        while True:
            if self.running is None:
                self._start()
            elif (victim := self._victim(stroke, age)) is not None:
                break
            elif self.running.has_ended():
                self._look_at_end(_ENDS)
                age /= 2
            time.sleep(0.01)
        assert self.running is not None
        self._keep()
        self.said = str(stroke)
        with suppress(ProcessLookupError):
            if stroke.target == "session":
                os.killpg(victim, stroke.number)
            else:
                os.kill(victim, stroke.number)
        self.struck.update(self.started)
        self.struck_at = time.time()
        if stroke.fells_harness:  # it may have come to its end in the very moment
            self._look_at_end((-stroke.number, 128 + stroke.number, INTERRUPTED, *_ENDS))

    def _victim(self, stroke: Stroke, age: float) -> int | None:
        """Number of the process to strike, if it is there and the youngest worker is of the right age."""
        assert self.running is not None
        now = time.monotonic()
        workers = self.running.workers()
        for worker in workers:
            self.started.setdefault(worker.pid, now)
        self._notice_recovery()
        for worker in workers:
            if worker.pid in self.struck or now - self.started[worker.pid] < age:
                continue
            if stroke.fells_harness:
                return self.running.pid
            if stroke.target == "worker":
                return int(worker.pid)
            with suppress(psutil.Error):
                if children := worker.children():
                    return int(children[0].pid)
        return None

    def _notice_recovery(self) -> None:
        """Work goes on as soon as some worker, after the kill, has said what it is at."""
        if self.struck_at is None:
            return
        for path in (self.scene.results / "runs" / "progress").glob("*"):
            with suppress(OSError):
                if path.stat().st_mtime > self.struck_at:
                    self._recovered()
                    return

    def _recovered(self) -> None:
        if self.struck_at is not None:
            self.scene.outcome.recoveries.append(time.time() - self.struck_at)
        self.struck_at = None

    def _start(self) -> None:
        options = ("-j", 1, "--retry", "all", "--timeout", "100s")
        selection = self.scene.selection(INNOCENT, plugin=self.scene.folder / "light.py")
        self.running = self.scene.start("run", *selection, *options)

    def _look_at_end(self, codes: tuple[int, ...]) -> None:
        """Look at what a run has left; where all jobs are done, begin with an empty folder."""
        assert self.running is not None
        done = self.scene.finish(self.running, f"run, {self.said or 'undisturbed'}", codes=codes)
        self.running = None
        self._look_at_records()
        if done.code == OK:
            self._recovered()
            self.scene.check_scores(*METHODS)
            shutil.rmtree(self.scene.results)
            self.kept.clear()

    def _keep(self) -> None:
        """Remember the records that are finished now."""
        records = self.scene.record_files()
        self.kept |= {name: content for name, content in records.items() if b'"status": "ok"' in content}

    def _look_at_records(self) -> None:
        now = self.scene.record_files()
        for name, content in self.kept.items():
            self.scene.require(now.get(name) == content, Border.LOST, f"{name} after {self.said}")
        self.scene.records()

    def _finish(self) -> None:
        """Bring the jobs to their end without further kills."""
        for _ in range(_REPETITIONS):
            if self.running is None:
                self._start()
            assert self.running is not None
            deadline = time.monotonic() + STALL
            while not self.running.has_ended(0.05) and time.monotonic() < deadline:
                self._notice_recovery()
            if self._ends_well():
                return
        self.scene.cross(Border.STALL, f"jobs not done by {_REPETITIONS} runs after {self.said}")

    def _ends_well(self) -> bool:
        assert self.running is not None
        done = self.scene.finish(self.running, f"run after {self.said}", codes=_ENDS, seconds=1.0)
        self.running = None
        self._look_at_records()
        if done.code != OK:
            return False
        self._recovered()
        self.scene.check_scores(*METHODS)
        self._look_for_rubbish()
        return True

    def _look_for_rubbish(self) -> None:
        runs = self.scene.results / "runs"
        left = [path for path in _files(runs) if path.name.endswith(".tmp") or path.parent.name == "progress"]
        self.scene.require(not left, Border.HALF, f"left behind after {self.said}: {[path.name for path in left]}")


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]
