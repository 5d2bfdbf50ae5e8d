"""Tasks, into which jobs are divided, and the program of a worker that runs them.

Messages of a worker are the name of work that begins and is charged to no method, None when it ends, and outcomes.
"""

from __future__ import annotations

import ctypes
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
from functools import lru_cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Literal, NamedTuple

from benchmark.api.contracts import Descriptor, Input, Shape
from benchmark.api.datasets import ShapeSet
from benchmark.code_digest import code_of_modules, digest
from benchmark.errors import BenchmarkError, ConfigurationError, InvalidForm, InvalidSignature, ShapeError, locate
from benchmark.pipeline import stages
from benchmark.pipeline.cache import Arrays, Cache, Kind, StorageError
from benchmark.pipeline.ranking import rank
from benchmark.pipeline.records import Record, Row
from benchmark.registry.components import Component
from benchmark.registry.modules import check_modules, remember_modules
from benchmark.text import Printed, clean_lines

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
        Digest of the code that the plan saw; a worker with other code leaves the job incomplete.
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

    @property
    def place(self) -> tuple[str, Path | None, Input, str]:
        """The shape and how it is seen, for all jobs."""
        return self.job.source, self.job.data_root, self.job.row.input, self.shape


class Task(NamedTuple):
    """Work for one worker: all steps at one shape of a data set, or the ranking of one job.

    Parameters
    ----------
    steps
        The steps.
    record, shapes
        For a ranking: the record without its outcome, and the step at each shape.
    """

    steps: tuple[Step, ...]
    record: Record | None = None
    shapes: Sequence[Step] = ()


class Outcome(NamedTuple):
    """Result of a step.

    Parameters
    ----------
    status
        ``"ok"``, ``"refused"`` (the content of the shape), ``"incomplete"`` (no result, for a reason that is neither in
        the shape nor in the method), ``"stopped"`` (the run cannot go on), or the status of the record of a job that
        failed.
    reason, traceback
        Why there is no result.
    scope
        What an outcome without a result holds for: this step, all jobs at this shape, or this job at all shapes.
    content
        Of a ranking: what its record says.
    """

    status: str
    reason: str = ""
    traceback: str = ""
    scope: Literal["step", "shape", "job"] = "step"
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


class RunContext:
    """What a process keeps in memory for one run: open data sets, methods with their models, and scorers.

    It is made for a run and ends with it, in the program, in a worker and on a cluster alike, so that a later run sees
    plugins that were edited and files that were written since.

    Parameters
    ----------
    uncharged
        Context of work that is charged to no method: ``"loading"``, ``"preparation"``, ``"geodesics"``.
    """

    def __init__(self, uncharged: stages.Uncharged = lambda _: nullcontext()) -> None:
        self.uncharged = uncharged
        self._components: dict[tuple[Job, Path | None], tuple[Any, Any]] = {}
        self._datasets: dict[tuple[str, Path | None], ShapeSet] = {}
        self._preparations: dict[tuple[str, Path | None, Input, Path], stages.Preparation] = {}

    def components(self, job: Job, model: Path | None) -> tuple[Any, Any]:
        """Return the method of a job with its model, and its scorer; raise ``CodeChanged`` if the plan saw others."""
        if (job, model) not in self._components:
            _check_code(job)
            method, scorer = job.method.create(), job.scorer.create()
            method = method.load(model) if model else method
            _check_code(job)  # what was imported is what was planned
            self._components[job, model] = method, scorer
        return self._components[job, model]

    def preparation(self, job: Job) -> stages.Preparation:
        """Return the preparation of the shapes of a job, ready for the first one."""
        data, key = (job.source, job.data_root), (job.source, job.data_root, job.row.input, job.results)
        if data not in self._datasets:
            try:
                self._datasets[data] = _open(*data)
            except BenchmarkError as error:  # the plan could open it
                raise stages.Incomplete(f"{stages.CHANGED}: {error.problem}") from error
        if key not in self._preparations:
            preparation = stages.Preparation(self._datasets[data], job.row.input, Cache(job.results))
            try:
                preparation.get_ready()
            except ConfigurationError as error:
                raise Unrunnable(error.problem, error.hint) from error
            self._preparations[key] = preparation
        return self._preparations[key]


class Unrunnable(BenchmarkError):
    """No job can run on this machine."""


class CodeChanged(BenchmarkError):
    """The code of a job is not that of its plan."""


def _check_code(job: Job) -> None:
    ranking = code_of_modules([rank.__module__])
    if digest([job.method.key(), job.scorer.key(), ranking]) != job.code:
        raise CodeChanged("its code changed during the run, or is another one on this machine", "run again")


def _open(source: str, data_root: Path | None) -> ShapeSet:
    """Open a data set that loads a mesh once for both inputs, unless its file changes: generated ones take a second."""
    from benchmark.datasets.catalogue import open_dataset

    shapes = open_dataset(source, data_root)
    load = lru_cache(1)(lambda entry, _key, _change: shapes.load(entry))
    return replace(shapes, load=lambda entry: load(entry, shapes.key(entry), stages.last_change(entry)))


class Work:
    """A task under way, with what its steps share: surfaces of the shape and their geodesics.

    Parameters
    ----------
    task, context
        The task, and what this process keeps for its run.
    rereading
        Whether files that exist are read to find damage; otherwise, the names of their arrays are enough.
    """

    def __init__(self, task: Task, context: RunContext, *, rereading: bool = False) -> None:
        self.task, self._context, self._rereading = task, context, rereading
        self._surfaces: dict[str, tuple[Arrays, Shape, stages.SharedResults]] = {}

    def outcome(self, step: Step) -> Outcome:
        """Do a step; what goes wrong in it becomes its outcome.

        Raises
        ------
        KeyboardInterrupt
            If the run is interrupted, which no method is to blame for; so is ``BdbQuit``, with which a debugger ends.
        """
        try:
            with self._context.uncharged("loading"):
                method, scorer = self._context.components(step.job, step.model)
            if self.task.record:
                return self._rank(self.task.record, step.job, method if isinstance(method, Descriptor) else scorer)
            return self._process(step, method, scorer)
        except (KeyboardInterrupt, BdbQuit):
            raise
        except MemoryError:
            return Outcome("memory", "out of memory; run with fewer jobs (-j 1) or on a larger machine")
        except (StorageError, Unrunnable) as error:
            return Outcome("stopped", str(error))
        except CodeChanged as error:
            return Outcome("incomplete", str(error), scope="job")
        except stages.Incomplete as error:
            return Outcome("incomplete", f"{step.shape} {error}".strip(), scope="shape" if step.shape else "step")
        except (InvalidForm, InvalidSignature) as error:
            return Outcome("failed", str(error))
        except ShapeError as error:
            return Outcome("refused", str(error), scope="shape" if isinstance(error, stages.Unprepared) else "step")
        except BenchmarkError as error:
            return Outcome("failed", str(error))
        except BaseException as error:  # SystemExit included: a method must not end its worker
            return Outcome("failed", locate(error), clean_lines(traceback.format_exc()))

    def _process(self, step: Step, method: Any, scorer: Any) -> Outcome:
        """Compute the files of a step that are missing."""
        cache = Cache(step.job.results)
        if not self._rereading:  # another job has made them, as a rule
            names = [cache.names(kind, key) for kind, key in step.keys.items()]
            if all(names) and stages.REFUSED not in set().union(*names):
                return Outcome("ok")
        prepared, shape, shared = self._surface(step)

        def compute() -> Arrays:
            remember_modules()
            output = stages.compute_output(method, shape, shared)
            if step.job.method.plugin:
                check_modules(step.job.method.target)
            return output

        form = self._stage(step, "forms", compute)
        if "signatures" in step.keys:
            mesh = stages.mesh_of(form, prepared)
            self._stage(step, "signatures", lambda: stages.sign(scorer, mesh))
        return Outcome("ok")

    def _surface(self, step: Step) -> tuple[Arrays, Shape, stages.SharedResults]:
        """Return the prepared shape of a step, which must be that of the plan, and what methods get of it."""
        job, uncharged = step.job, self._context.uncharged
        if job.row.input not in self._surfaces:
            try:
                with uncharged("loading"):
                    preparation = self._context.preparation(job)
                with uncharged("preparation"):
                    entry = preparation.find(step.shape, step.keys["prepared"])
                    prepared = preparation.arrays(entry)
            except MemoryError as error:
                raise stages.Incomplete("was not prepared: out of memory") from error
            shared = stages.SharedResults(uncharged)
            shape = stages.shape_of(prepared, step.shape, job.row.seed, shared)
            self._surfaces[job.row.input] = prepared, shape, shared
        return self._surfaces[job.row.input]

    def _stage(self, step: Step, kind: Kind, compute: Callable[[], Arrays]) -> Arrays:
        return stages.require_result(Cache(step.job.results).get(kind, step.keys[kind], compute))

    def _rank(self, record: Record, job: Job, comparing: Any) -> Outcome:
        """Rank the gallery of a job, and keep its distances."""
        cache = Cache(job.results)

        def remake(index: int) -> None:
            step = self.task.shapes[index]
            outcome = Work(Task((step,)), self._context, rereading=True).outcome(step)
            if outcome.status == "incomplete":
                raise stages.Incomplete(outcome.reason.removesuffix(f"; {stages.AGAIN}"))

        content, distances = rank(record, cache, remake, comparing)
        if not distances:
            name, reason = content["unsupported"][0]
            number = len(content["unsupported"])
            return Outcome("unsupported", f"none of {number} shapes could be processed; {name}: {reason}")
        cache.write("records", job.key, distances)
        return Outcome("ok", content=content)


# The program of a worker ---------------------------------------------------------------------------------------------


def serve(descriptor: int, memory: int, parent: int) -> None:
    """Run the tasks that come from a connection until the program at its other end ends."""
    from numba.core import event

    _die_with(parent)
    limits = resource.getrlimit(resource.RLIMIT_DATA)  # of the user, which may be lower
    allowed = [limit for limit in limits if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([memory, *allowed]), limits[1]))
    connection, printed = Connection(descriptor), Printed()

    @contextmanager
    def uncharged(name: str) -> Iterator[None]:
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
    context = RunContext(uncharged)
    with suppress(EOFError, OSError), redirect_stdout(printed):  # the program has ended
        while True:
            work = Work(connection.recv(), context)
            for step in work.task.steps:
                printed.name = str(step)
                try:
                    outcome = work.outcome(step)
                except (KeyboardInterrupt, BdbQuit) as error:  # there is no terminal here
                    outcome = Outcome("failed", f"it raises {type(error).__name__}: use a debugger with -j 0")
                connection.send(outcome)


def _die_with(parent: int) -> None:
    """Let the system end this process with its parent, also if that is killed."""
    with suppress(AttributeError, OSError):  # only Linux has it; elsewhere, a worker ends after its task
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        sys.exit(1)
