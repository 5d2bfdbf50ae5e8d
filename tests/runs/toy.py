"""Plans of toy galleries, and runs of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args
from unittest.mock import patch

from benchmark.pipeline.cache import Stage
from benchmark.pipeline.records import Record
from benchmark.registry.components import THIS_PROCESS
from benchmark.registry.modules import import_plugins_anew
from benchmark.runs.planning import Planned, plan_selection
from benchmark.runs.runner import run_jobs
from benchmark.runs.tasks import Outcome, Queue, RunContext, Step, Task, Work
from tests.toy import wait_for

FAULTS = Path(__file__).with_name("faults.py")
#: The scorer of runs whose scores do not matter.
LIGHT_SCORER = Path(__file__).with_name("light_scorer.py")
LIGHT = ("--scorer", "light", "--plugin", LIGHT_SCORER)


class ThisProcess:
    """Workers of tests that need no process: all steps run in this one, also those of the suite."""

    working: tuple[str, ...] = ()

    def __init__(self) -> None:
        self._context = RunContext()

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        if task := queue.take(THIS_PROCESS) or queue.take_any():
            work = Work(task, self._context)
            for number, step in enumerate(task.steps, 1):
                outcome = work.outcome(step)
                yield step, outcome
                if outcome.ends_process:
                    import_plugins_anew()
                    self._context = RunContext()
                    if left := task.steps[number:]:
                        queue.add(task._replace(steps=left), first=True)
                    break

    def close(self) -> None:
        """End nothing."""


class LateStagesFirst(ThisProcess):
    """Workers that begin all tasks of a queue at once, and end first what is made last of a shape.

    A task that may be done too early by them may be so by any two processes.
    """

    def poll(self, queue: Queue) -> Iterator[tuple[Step, Outcome]]:
        begun: list[Task] = []
        while task := queue.take_any():
            begun.append(task)
        stages = get_args(Stage)
        for task in sorted(begun, key=lambda task: -stages.index(task.steps[0].stage)):
            one = Queue(lambda _: True)
            one.add(task)
            yield from super().poll(one)


@contextmanager
def without_processes() -> Iterator[None]:
    """Let runs do everything in this process, whatever starts them: a process takes seconds."""
    with patch("benchmark.runs.runner.start_workers", lambda *_: ThisProcess()):
        yield


def planned(
    folder: Path | str, results: Path, *methods: Any, plugins: tuple[Path, ...] = (), **options: Any
) -> list[Planned]:
    chosen = {"scorer": "light", "input": "mesh"} | options
    return plan_selection(
        results, datasets=[str(folder)], methods=methods, plugins=[*plugins, LIGHT_SCORER], **chosen
    )


def done(jobs: list[Planned], results: Path, **options: Any) -> dict[str, Record]:
    """Run jobs and return their records by method; without options, in this process, which is
    seconds faster.
    """
    options = options or {"workers": ThisProcess()}
    return {record.method: record for record in run_jobs(jobs, results, **options)}


def run_toy(
    folder: Path, results: Path, *methods: Any, size: int = 0, timeout: float = 60.0, **options: Any
) -> Any:
    """Plan toy jobs and run them: in this process, or in so many others."""
    jobs = planned(folder, results, *methods, **options)
    return done(jobs, results, size=size, timeout=timeout) if size else done(jobs, results)


def noted(path: Path) -> list[int]:
    """Return the processes that a method has noted in a file, once there are some."""
    return [int(word) for word in wait_for(lambda: path.is_file() and path.read_text().split())]
