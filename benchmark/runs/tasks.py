"""Tasks, into which jobs are divided, and the program of a worker that runs them.

Messages of a worker are the name of work that begins and is charged to no method, None when it ends, and outcomes.
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmark.api.contracts import Descriptor, Input, Shape
from benchmark.api.datasets import ShapeSet
from benchmark.code_digest import digest
from benchmark.errors import BenchmarkError, InvalidForm, InvalidSignature, ShapeError, locate
from benchmark.pipeline import stages
from benchmark.pipeline.cache import Arrays, Cache, Kind, StorageError
from benchmark.pipeline.ranking import rank
from benchmark.pipeline.records import Record, Row
from benchmark.registry.components import Component
from benchmark.text import say

# What a worker gets and gives ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """A method on a gallery under one input, as a worker gets it: without the gallery.

    Parameters
    ----------
    key, row
        Key of its record, and what that is the result of.
    source, data_root
        Where the shapes come from: a name or a folder, and the folder of official sets.
    method, scorer
        What to do with them.
    results
        The results folder.
    code
        Digest of the code that the plan saw; a worker with other code refuses the job.
    """

    key: str
    row: Row
    source: str
    data_root: Path | None
    method: Component
    scorer: Component
    results: Path
    code: str

    @property
    def plugin(self) -> str:
        """Plugin files that it runs; a worker serves the suite or one plugin."""
        return " ".join(sorted({str(part.plugin) for part in (self.method, self.scorer) if part.plugin}))


class Step(NamedTuple):
    """A job at one shape, with the keys of its files and its model; or the ranking of its gallery."""

    job: Job
    shape: str = ""
    keys: Mapping[Kind, str] = {}
    model: Path | None = None

    def __str__(self) -> str:
        return f"{self.job.method.name}, {self.shape}" if self.shape else f"ranking {self.job.row}"


class Task(NamedTuple):
    """Work for one worker: all steps at one shape of a data set, or the ranking of one job.

    Parameters
    ----------
    steps
        The steps.
    record, shapes, lost
        For a ranking: the record without its outcome, the step at each shape, and why shapes were lost for all methods.
    """

    steps: tuple[Step, ...]
    record: Record | None = None
    shapes: Sequence[Step] = ()
    lost: Mapping[str, str] = {}


class Outcome(NamedTuple):
    """What became of a step.

    Parameters
    ----------
    status
        ``"ok"``, ``"refused"`` (the shape by this method), ``"lost"`` (the shape for all methods), ``"stopped"`` (the
        run cannot go on), or the status of the record of a job that failed.
    reason, traceback
        Why there is no result.
    content
        Of a ranking: what its record says.
    """

    status: str
    reason: str = ""
    traceback: str = ""
    content: Mapping[str, Any] = {}


class Queue(deque[Task]):
    """Tasks to do.

    Parameters
    ----------
    is_open
        Says whether the outcome of a step is still wanted.
    """

    def __init__(self, is_open: Callable[[Step], bool]) -> None:
        super().__init__()
        self._is_open = is_open

    def take(self) -> Task | None:
        """Return the next task with its open steps; None if there is none."""
        while self:
            task = self.popleft()
            if steps := tuple(filter(self._is_open, task.steps)):
                return task._replace(steps=steps)
        return None


# Steps ---------------------------------------------------------------------------------------------------------------


#: Methods that this process has used, with their input: the first use includes loading and compiling.
_used: set[tuple[Component, str]] = set()


class Work:
    """A task under way, with what its steps share: surfaces of the shape and their geodesics.

    Parameters
    ----------
    task
        The task.
    aside
        Told about work that is charged to no method: ``"loading"``, ``"preparation"``, ``"geodesics"``.
    rereading
        Whether files that exist are read to find damage; otherwise, the names of their arrays are enough.
    """

    def __init__(self, task: Task, aside: stages.Aside = lambda _: nullcontext(), *, rereading: bool = False) -> None:
        self.task, self._aside, self._rereading = task, aside, rereading
        self._surfaces: dict[str, tuple[Arrays, Shape, stages.SharedResults]] = {}

    def outcome(self, step: Step) -> Outcome:
        """Do a step; what goes wrong in it becomes its outcome.

        Raises
        ------
        KeyboardInterrupt
            If the run is interrupted, which no method is to blame for; so is ``BdbQuit``, with which a debugger ends.
        """
        job = step.job
        try:
            with self._aside("loading"):
                if not _is_as_planned(job):
                    problem = "its code changed during the run, or is another one on this machine"
                    return Outcome("stopped", f"{job.row}: {problem}; run again: finished jobs are kept")
                method, scorer = _load_method(job, step.model), _load_scorer(job)
            if self.task.record:
                return self._rank(self.task.record, job, method if isinstance(method, Descriptor) else scorer)
            return self._process(step, method, scorer)
        except (KeyboardInterrupt, BdbQuit):
            raise
        except MemoryError:
            return Outcome("memory", "out of memory; run with fewer jobs (-j 1) or on a larger machine")
        except StorageError as error:
            return Outcome("stopped", str(error))
        except stages.Unprepared as error:
            return Outcome("lost", str(error))
        except (InvalidForm, InvalidSignature) as error:
            return Outcome("failed", str(error))
        except ShapeError as error:
            return Outcome("refused", str(error))
        except BenchmarkError as error:
            return Outcome("failed", str(error))
        except BaseException as error:  # SystemExit included: a method must not end its worker
            return Outcome("failed", locate(error), traceback.format_exc())

    def _process(self, step: Step, method: Any, scorer: Any) -> Outcome:
        """Compute the files of a step that are missing."""
        job, cache_, input_ = step.job, Cache(step.job.results), step.job.row.input
        # Another job has made them, as a rule.
        made = [] if self._rereading else [cache_.names(kind, key) for kind, key in step.keys.items()]
        if made and all(made) and stages.REFUSED not in set().union(*made):
            return Outcome("ok")
        if input_ not in self._surfaces:
            with self._aside("preparation"):
                preparation = _preparation(job.source, job.data_root, input_, job.results)
                entry = next(entry for entry in preparation.shapes.shapes if entry.identifier == step.shape)
                prepared = preparation.arrays(entry)
            shared = stages.SharedResults(self._aside)
            self._surfaces[input_] = prepared, stages.shape_of(prepared, step.shape, job.row.seed, shared), shared
        prepared, shape, shared = self._surfaces[input_]

        def answer() -> Arrays:
            is_first = (job.method, input_) not in _used
            _used.add((job.method, input_))
            arrays = stages.compute_output(method, shape, shared)
            return {**arrays, stages.FIRST: np.asarray(True)} if is_first else arrays

        form = stages.require_result(cache_.get("forms", step.keys["forms"], answer))
        if "signatures" in step.keys:
            mesh = stages.mesh_of(form, prepared)
            stages.require_result(cache_.get("signatures", step.keys["signatures"], lambda: stages.sign(scorer, mesh)))
        return Outcome("ok")

    def _rank(self, record: Record, job: Job, comparing: Any) -> Outcome:
        """Rank the gallery of a job, and keep its distances."""
        cache_ = Cache(job.results)

        def remake(index: int) -> None:
            step = self.task.shapes[index]
            Work(Task((step,)), self._aside, rereading=True).outcome(step)

        content, distances = rank(record, self.task.lost, cache_, remake, comparing)
        if not distances:
            name, reason = content["unsupported"][0]
            number = len(record.shapes)
            return Outcome("unsupported", f"none of {number} shapes could be processed; {name}: {reason}")
        cache_.write("records", job.key, distances)
        return Outcome("ok", content=content)


@cache
def _is_as_planned(job: Job) -> bool:
    return digest([job.method.key(), job.scorer.key()]) == job.code


@cache
def _load_method(job: Job, model: Path | None) -> Any:
    method = job.method.create()
    return method.load(model) if model else method


@cache
def _load_scorer(job: Job) -> Any:
    return job.scorer.create()


@cache
def _open(source: str, data_root: Path | None) -> ShapeSet:
    """Open a data set, which loads a mesh once for both inputs: generated ones take a second."""
    from benchmark.datasets.catalogue import open_dataset

    shapes = open_dataset(source, data_root)
    return replace(shapes, load=lru_cache(1)(shapes.load))


@cache
def _preparation(source: str, data_root: Path | None, input_: Input, results: Path) -> stages.Preparation:
    return stages.Preparation(_open(source, data_root), input_, Cache(results))


# The program of a worker ---------------------------------------------------------------------------------------------


def serve(descriptor: int, memory: int, parent: int) -> None:
    """Run the tasks that come from a connection until the program at its other end ends."""
    from numba.core import event

    _die_with(parent)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, resource.getrlimit(resource.RLIMIT_DATA)[1]))
    connection, printed = Connection(descriptor), _Printed()

    @contextmanager
    def aside(name: str) -> Iterator[None]:
        connection.send(name)
        try:
            yield
        finally:
            connection.send(None)

    class Compiling(event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            connection.send("compiling")

        def on_end(self, event: object) -> None:
            connection.send(None)

    event.register("numba:compile", Compiling())
    connection.send(None)  # started
    with suppress(EOFError, OSError), redirect_stdout(printed):  # the program has ended
        while True:
            work = Work(connection.recv(), aside)
            for step in work.task.steps:
                printed.name = str(step)
                try:
                    outcome = work.outcome(step)
                except (KeyboardInterrupt, BdbQuit) as error:  # there is no terminal here
                    outcome = Outcome("failed", f"it raises {type(error).__name__}: use a debugger with -j 0")
                connection.send(outcome)


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
