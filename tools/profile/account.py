"""Time of a worker by stage and method; a worker writes one line about a task when it ends."""

from __future__ import annotations

import json
import os
import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import psutil

from benchmark.jobs import method_run, preparation
from benchmark.jobs.execution import runner, worker
from benchmark.jobs.job_specs import Task
from benchmark.jobs.stages import measures
from benchmark.storage import store
from benchmark.storage.costs import Meter
from benchmark.system import fingerprints

#: Variable that names the file of the lines.
LINES = "CANONICAL_FORMS_PROFILE"

#: What is done, for which method, and whether for the first time in the process.
Part = tuple[str, str, bool]

STARTING, OTHER = "start of a process", "else in a worker"

#: Functions outside the measured stages, and the part that their time belongs to.
PARTS: tuple[tuple[object, str, str], ...] = (
    (store, "_load", "reading arrays"),
    (store.Store, "_write", "writing arrays"),
    (store.Store, "write_record", "writing records"),
    (runner, "open_dataset", "opening data sets"),
    (runner, "_require_same_code", "checking the code"),
    (measures, "scores", "measures"),
    (measures, "over_splits", "measures"),
    (store, "digest", "keys"),
    (preparation.Preparation, "recipe", "keys"),
    (method_run.MethodRun, "recipe", "keys"),
)

#: First word of the work of a measured stage, and what it is called.
STAGES = {
    "load": "making generated meshes", "canonicalise": "form", "features": "signature", "rank": "distances",
    "frame": "frame of the camera",
}  # fmt: skip


class Account:
    """Time of this process, each moment in one part: that of the innermost body that is under way."""

    def __init__(self) -> None:
        self.seconds: Counter[Part] = Counter()
        self.processor: Counter[Part] = Counter()
        self._open: list[Part] = [(OTHER, "", False)]
        self._since = time.perf_counter(), time.process_time()

    @contextmanager
    def within(self, part: str = "", method: str = "", *, first: bool = False) -> Iterator[None]:
        """Book the body under a part, a method or both; what is not named stays as it is around the body.

        Parameters
        ----------
        part, method
            What the body is.
        first
            Whether it is done for the first time in this process, with all that is loaded and compiled for it.
        """
        self._turn()
        outer = self._open[-1]
        self._open.append((part or outer[0], method or outer[1], first or outer[2]))
        try:
            yield
        finally:
            self._turn()
            self._open.pop()

    def restart(self) -> None:
        """Forget what was booked so far."""
        self._turn()
        self.seconds.clear()
        self.processor.clear()

    def _turn(self) -> None:
        now = time.perf_counter(), time.process_time()
        self.seconds[self._open[-1]] += now[0] - self._since[0]
        self.processor[self._open[-1]] += now[1] - self._since[1]
        self._since = now


def stage_of(work: str) -> str:
    """Return the part of a measured stage: ``"canonicalise mesh gps"`` is a form."""
    first = work.split(" ")[0]
    return STAGES.get(first, work if first == "prepare" else first)


def watch(account: Account) -> None:
    """Let the functions of a worker book their time."""
    for owner, name, part in PARTS:
        _book(owner, name, lambda _, part=part: account.within(part))  # type: ignore[misc]
    _book(method_run.MethodRun, "treat", lambda run: account.within(method=run.spec.base_name))
    for name in ("ranked", "_compare"):
        _book(runner, name, lambda job: account.within(method=job.method.base_name))
    measured = Meter.measured

    @contextmanager
    def booked(meter: Meter, work: str) -> Iterator[Any]:
        with account.within(stage_of(work), first=work not in meter._used), measured(meter, work) as cost:
            yield cost

    Meter.measured = booked  # type: ignore[method-assign]


def _book(owner: object, name: str, within: Callable[[Any], Any]) -> None:
    function = getattr(owner, name)

    @wraps(function)
    def booked(first: Any, *others: Any, **named: Any) -> Any:
        with within(first):
            return function(first, *others, **named)

    setattr(owner, name, booked)


def do_in_turn(task: str, status_file: Path, known: fingerprints.ImportCache) -> None:
    """Do the tasks of a worker and write where the time of each went."""
    account = Account()
    began: list[float] = [psutil.Process().create_time()]
    account.seconds[STARTING, "", False] += time.time() - began[0]
    account.processor[STARTING, "", False] += time.process_time()
    watch(account)
    work = runner.work

    def booked(task: Task, tell: runner.Tell) -> None:
        if not began:  # what comes between two tasks of a process belongs to neither
            account.restart()
            began.append(time.time())
        try:
            work(task, tell)
        finally:
            with account.within():
                parts = [[*part, value, account.processor[part]] for part, value in account.seconds.items()]
            line = {"began": began.pop(), "ended": time.time(), "parts": parts}
            with Path(os.environ[LINES]).open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(line) + "\n")

    runner.work = booked
    worker._do_in_turn(task, status_file, known)


def processor_seconds() -> float:
    """Processor seconds of this process and of those that it started and waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)
