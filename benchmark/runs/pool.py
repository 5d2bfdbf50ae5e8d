"""Run tasks in worker processes; one that dies or hangs is replaced, and the rest of its task goes back."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from multiprocessing.connection import wait

from benchmark.errors import BenchmarkError
from benchmark.runs.jobs import Outcome, Step, Task
from benchmark.runs.tasks import run_task
from benchmark.runs.worker import Worker
from benchmark.text import say

#: What the tasks of a pool give: each step with its outcome.
Ended = Iterator[tuple[Task, Step, Outcome]]

#: Says whether the outcome of a step at a shape is still wanted.
IsOpen = Callable[[Step, str], bool]

#: Seconds between looks at the workers.
INTERVAL = 0.2


def run_here(queue: deque[Task], is_open: IsOpen, **_: object) -> Ended:
    """Run tasks in this process, so that ``breakpoint()`` works: without time-outs, and a crash ends the run."""
    while queue:
        task = queue.popleft()
        task = task._replace(steps=tuple(step for step in task.steps if is_open(step, task.shape)))
        yield from ((task, *pair) for pair in zip(task.steps, run_task(task, lambda _: nullcontext()), strict=True))


class Pool:
    """Workers on this machine.

    Parameters
    ----------
    size
        Number of workers.
    memory
        Most bytes of memory of each.
    timeout
        Seconds that a method may take for a shape.
    """

    def __init__(self, size: int, memory: int, timeout: float) -> None:
        self.size, self.memory, self.timeout = size, memory, timeout
        self._idle: list[Worker] = []
        self._busy: list[Worker] = []
        self._deaths: Counter[str] = Counter()

    @property
    def working(self) -> list[str]:
        """What the workers are doing."""
        names = ((worker.waiting[0].job, worker.task.shape) for worker in self._busy if worker.waiting)
        return [f"{job.method.name}, {shape}" if shape else f"ranking {job.name}" for job, shape in names]

    def run(self, queue: deque[Task], is_open: IsOpen) -> Ended:
        """Run the tasks of a queue, which may grow meanwhile, for the steps of jobs that are still open.

        Yields
        ------
        tuple
            A task, a step and its outcome; the task is empty where nothing has ended for a moment.
        """
        while queue or self._busy:
            while queue and len(self._busy) < self.size:
                self._start(queue.popleft(), is_open)
            wait([worker.connection for worker in self._busy], INTERVAL)
            for worker in list(self._busy):
                yield from self._look_at(worker, queue)
            yield Task(()), Step(None), Outcome("")  # type: ignore[arg-type]

    def close(self) -> None:
        """End the workers."""
        for worker in self._busy + self._idle:
            worker.kill()

    def _start(self, task: Task, is_open: IsOpen) -> None:
        task = task._replace(steps=tuple(step for step in task.steps if is_open(step, task.shape)))
        if task.steps:
            worker = self._take(task.steps[0].job.plugin)
            worker.begin(task, self.timeout)
            self._busy.append(worker)

    def _take(self, plugin: str) -> Worker:
        """Return an idle worker that serves a plugin, or a new one; one of another plugin makes room."""
        alive = [worker for worker in self._idle if worker.is_alive]
        fitting = [worker for worker in alive if worker.plugin == plugin]
        for worker in self._idle:
            if worker not in alive or (not fitting and worker is alive[0]):
                worker.kill()
        if not fitting:
            self._idle = alive[1:]
            try:
                return Worker(self.memory)
            except OSError as error:
                raise BenchmarkError(
                    f"no process can be started: {error.strerror}", "end other programs, or use -j 0"
                ) from error
        self._idle = [worker for worker in alive if worker is not fitting[0]]
        return fitting[0]

    def _look_at(self, worker: Worker, queue: deque[Task]) -> Ended:
        for step, outcome in worker.outcomes():
            if outcome.status in ("crashed", "killed") and self._tries_again(worker, step, outcome):
                queue.appendleft(worker.task._replace(steps=(step,)))
            else:
                yield worker.task, step, outcome
        for line in worker.printed:
            say(line, err=True)
        worker.printed.clear()
        if not worker.is_alive:
            worker.kill()  # its children
            self._busy.remove(worker)
            if worker.waiting:
                queue.appendleft(worker.task._replace(steps=tuple(worker.waiting)))
        elif not worker.waiting:
            self._busy.remove(worker)
            self._idle.append(worker)

    def _tries_again(self, worker: Worker, step: Step, outcome: Outcome) -> bool:
        """Return whether a step gets a second worker: another job of the task, or a user, may be the cause."""
        self._deaths[step.job.key] += 1
        is_alone = len(worker.task.steps) == 1
        return self._deaths[step.job.key] == 1 and (outcome.status == "killed" or not is_alone)
