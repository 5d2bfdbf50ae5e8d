"""Tasks, into which jobs are divided, and the program of a worker that runs them.

Messages of a worker are pairs: ``("aside", name)`` when work begins that is charged to no method, ``("aside", "")``
when it ends, and ``("outcome", outcome)``.
"""

from __future__ import annotations

import ctypes
import io
import os
import resource
import signal
import sys
import traceback
from bdb import BdbQuit
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.api.contracts import Descriptor, Input, Shape
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.code_digest import digest
from benchmark.errors import BenchmarkError, InvalidForm, InvalidSignature, ShapeError, locate
from benchmark.pipeline import stages
from benchmark.pipeline.cache import Arrays, Cache, Keys, StorageError
from benchmark.pipeline.ranking import Ranked, rank
from benchmark.registry.components import Component
from benchmark.text import say

# What a worker gets and gives ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """A method on a gallery under one input, as a worker gets it: without the gallery.

    Parameters
    ----------
    key
        Key of its record.
    name
        Gallery, input and method, for messages.
    source, data_root
        Where the shapes come from: a name or a folder, and the folder of official sets.
    input, method, scorer, seed
        What to do with them.
    results
        The results folder.
    code
        Digest of the code that the plan saw; a worker with other code refuses the job.
    """

    key: str
    name: str
    source: str
    data_root: Path | None
    input: Input
    method: Component
    scorer: Component
    seed: int
    results: Path
    code: str

    @property
    def plugin(self) -> str:
        """Plugin files that it runs; a worker serves the suite or one plugin."""
        return " ".join(sorted({str(part.plugin) for part in (self.method, self.scorer) if part.plugin}))


class Step(NamedTuple):
    """A job at one shape, or its ranking."""

    job: Job
    keys: Keys = Keys("", "", "")
    model: Path | None = None


class Task(NamedTuple):
    """Work for one worker: all steps at one shape, or the ranking of one job.

    Parameters
    ----------
    steps
        The steps, of jobs on one data set.
    shape
        Name of the shape; "" for a ranking.
    gallery, models
        For a ranking: the shapes, and the model for each.
    """

    steps: tuple[Step, ...]
    shape: str = ""
    gallery: Ranked | None = None
    models: tuple[Path | None, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What became of a step.

    Parameters
    ----------
    status
        ``"ok"``, ``"refused"`` (the shape by this method), ``"unprepared"`` (by preparation), ``"lost"`` (the shape for
        all methods in this run), ``"storage"`` (the results folder cannot be written), ``"changed"`` (other code than
        in the plan), or the status of the record of a job that failed.
    reason, traceback
        Why there is no result.
    content
        Of a ranking: what its record says.
    """

    status: str
    reason: str = ""
    traceback: str = ""
    content: Mapping[str, Any] = field(default_factory=dict)


class Queue(deque[Task]):
    """Tasks to do.

    Parameters
    ----------
    is_open
        Says whether the outcome of a step at a shape is still wanted.
    """

    def __init__(self, is_open: Callable[[Step, str], bool]) -> None:
        super().__init__()
        self._is_open = is_open

    def take(self) -> Task | None:
        """Return the next task with its open steps; None if there is none."""
        while self:
            task = self.popleft()
            if steps := tuple(step for step in task.steps if self._is_open(step, task.shape)):
                return task._replace(steps=steps)
        return None


# Steps ---------------------------------------------------------------------------------------------------------------


class CodeChanged(BenchmarkError):
    """The code that a worker has is not that of the plan."""


#: Status of a step with an error of the suite; the first type that fits counts.
_STATUSES: Mapping[type[BenchmarkError], str] = {
    StorageError: "storage",
    CodeChanged: "changed",
    stages.SharedFailure: "lost",
    InvalidForm: "failed",
    InvalidSignature: "failed",
    stages.Unprepared: "unprepared",
    ShapeError: "refused",
    BenchmarkError: "failed",
}

#: Methods that this process has used, with their input: the first use includes loading and compiling.
_used: set[tuple[Component, str]] = set()


class Work:
    """A task under way, with what its steps share: the mesh of the shape, its prepared surfaces and their geodesics.

    Parameters
    ----------
    task
        The task.
    aside
        Told about work that is charged to no method: ``"loading"``, ``"preparation"``, ``"geodesics"``.
    """

    def __init__(self, task: Task, aside: stages.Aside = lambda _: nullcontext()) -> None:
        self.task, self.aside = task, aside
        self._shapes: dict[str, tuple[Shape, stages.SharedStages]] = {}

    def outcome(self, step: Step) -> Outcome:
        """Do a step; what goes wrong in it becomes its outcome.

        Raises
        ------
        KeyboardInterrupt
            If the run is interrupted, which no method is to blame for; so is ``BdbQuit``, with which a debugger ends.
        """
        try:
            return self._rank(step) if self.task.gallery else self._process(step)
        except (KeyboardInterrupt, BdbQuit):
            raise
        except MemoryError:
            return Outcome("memory", "out of memory; run with fewer jobs (-j 1) or on a larger machine")
        except BenchmarkError as error:
            return Outcome(next(status for kind, status in _STATUSES.items() if isinstance(error, kind)), str(error))
        except BaseException as error:  # SystemExit included: a method must not end its worker
            return Outcome("failed", locate(error), traceback.format_exc())

    def _process(self, step: Step) -> Outcome:
        """Compute the files of a step that are missing."""
        cache_ = Cache(step.job.results)
        form = stages.require_result(cache_.get("forms", step.keys.form, lambda: self._answer(step)))
        if step.keys.signature:
            stages.require_result(cache_.get("signatures", step.keys.signature, lambda: self._sign(step, form)))
        return Outcome("ok")

    def _answer(self, step: Step) -> Arrays:
        job = step.job
        with self.aside("loading"):
            method, first = load_method(job, step.model), (job.method, job.input) not in _used
        if job.input not in self._shapes:
            shared = stages.SharedStages(self.aside)
            self._shapes[job.input] = stages.shape_of(self.prepared(step), self.task.shape, job.seed, shared), shared
        _used.add((job.method, job.input))
        return stages.compute_answer(method, *self._shapes[job.input], first=first)

    def _sign(self, step: Step, form: Arrays) -> Arrays:
        with self.aside("loading"):
            scorer = load_scorer(step.job)
        return stages.sign(scorer, stages.mesh_of(form, {} if "faces" in form else self.prepared(step)))

    def prepared(self, step: Step) -> Arrays:
        """Return the arrays of the prepared shape; raise ``ShapeError`` if there are none."""
        job = step.job
        with self.aside("preparation"):
            preparation = _preparation(job.source, job.data_root, job.input, job.results)
            entries = _open(job.source, job.data_root)[1]
            try:
                return preparation.arrays(entries[self.task.shape])
            except MemoryError as error:
                raise stages.SharedFailure("no memory to prepare it", "simplify the mesh, or use -j 1") from error

    def _rank(self, step: Step) -> Outcome:
        """Rank the gallery of a job, and keep its distances."""
        job, gallery, models, cache_ = step.job, self.task.gallery, self.task.models, Cache(step.job.results)
        assert gallery is not None  # noqa: S101

        def compute(index: int) -> None:
            work = Work(Task((), gallery.shapes[index]), self.aside)
            again = Step(job, gallery.keys[index], models[index])
            with suppress(ShapeError):
                work.prepared(again)
            work.outcome(again)

        with self.aside("loading"):
            method = load_method(job, models[0])
            comparing = method if isinstance(method, Descriptor) else load_scorer(job)
        content, distances = rank(gallery, cache_, compute, comparing)
        if not distances:
            name, reason = content["unsupported"][0]
            number = len(gallery.shapes)
            return Outcome("unsupported", f"none of {number} shapes could be processed; {name}: {reason}")
        cache_.write("records", job.key, distances)
        return Outcome("ok", content=content)


@cache
def _open(source: str, data_root: Path | None) -> tuple[ShapeSet, dict[str, Entry]]:
    """Open a data set, which loads a mesh once for both inputs: generated ones take a second."""
    from benchmark.datasets.catalogue import open_dataset

    shapes = open_dataset(source, data_root)
    return replace(shapes, load=lru_cache(1)(shapes.load)), {entry.identifier: entry for entry in shapes.shapes}


@cache
def _preparation(source: str, data_root: Path | None, input_: Input, results: Path) -> stages.Preparation:
    return stages.Preparation(_open(source, data_root)[0], input_, Cache(results))


@cache
def load_method(job: Job, model: Path | None) -> Any:
    """Create the method of a job, with its model; raise :class:`CodeChanged` if it is not that of the plan."""
    if digest([_key(job.method), _key(job.scorer)]) != job.code:
        raise CodeChanged("its code changed during the run, or is another one on this machine", "run again")
    method = job.method.create()
    return method.load(model) if model else method


@cache
def load_scorer(job: Job) -> Any:
    """Create the scorer of a job."""
    return job.scorer.create()


_key = cache(Component.key)


# The program of a worker ---------------------------------------------------------------------------------------------


def serve(descriptor: int, memory: int, parent: int) -> None:
    """Run the tasks that come from a connection until the program at its other end ends."""
    from numba.core import event

    _die_with(parent)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    connection, printed, at_work = Connection(descriptor), _Printed(), [""]

    def begin(name: str) -> None:
        at_work.append(name)
        connection.send(("aside", name))

    def end() -> None:
        at_work.pop()
        connection.send(("aside", at_work[-1]))

    @contextmanager
    def aside(name: str) -> Iterator[None]:
        begin(name)
        try:
            yield
        finally:
            end()

    class Compiling(event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            begin("compiling")

        def on_end(self, event: object) -> None:
            end()

    event.register("numba:compile", Compiling())
    connection.send(("aside", ""))
    with suppress(EOFError, OSError), redirect_stdout(printed):  # the program has ended
        while True:
            work = Work(connection.recv(), aside)
            for step in work.task.steps:
                printed.name = f"{step.job.method.name}, {work.task.shape or 'ranking'}"
                try:
                    outcome = work.outcome(step)
                except (KeyboardInterrupt, BdbQuit) as error:  # there is no terminal here
                    outcome = Outcome("failed", f"it raises {type(error).__name__}: use a debugger with -j 0")
                connection.send(("outcome", outcome))


class _Printed(io.TextIOBase):
    """Standard output of plugins: lines on stderr that begin with the method and the shape."""

    name = rest = ""

    def write(self, text: str) -> int:
        *lines, self.rest = (self.rest + text).split("\n")
        for line in lines:
            say(f"{self.name}: {line}", err=True)
        return len(text)


def _die_with(parent: int) -> None:
    """Let the system end this process with its parent, also if that is killed."""
    with suppress(AttributeError, OSError):  # only Linux has it; elsewhere, a worker ends after its task
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        sys.exit(1)
