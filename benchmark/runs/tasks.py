"""Tasks, into which jobs are divided, and the program of a worker that runs them.

Each file of the cache is made by one step, in a process of its maker: prepared shapes by the suite,
a form by the suite or by the plugin of its method, a signature by that of its scorer. So what a
plugin changes in its process, such as a constant of the suite, changes no file of anybody else.

Messages of a worker are the name of work that begins and is charged to no method, None when it
ends, and outcomes.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
import traceback
from bdb import BdbQuit
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import (
    AbstractContextManager,
    chdir,
    contextmanager,
    nullcontext,
    redirect_stdout,
    suppress,
)
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

from benchmark.api.contracts import Shape
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import BenchmarkError, ConfigurationError, locate
from benchmark.pipeline import forms
from benchmark.pipeline.cache import RUNS, Cache, Stage, StorageError
from benchmark.pipeline.outputs import compute_output, make_distance_check, sign
from benchmark.pipeline.prepared import CHANGED, PreparedShapes, last_change
from benchmark.pipeline.ranking import DamagedFiles, rank
from benchmark.pipeline.records import Record, RowId
from benchmark.pipeline.stages import REFUSED, Arrays, Incomplete
from benchmark.reads import watch_this_process
from benchmark.registry.components import THIS_PROCESS, Component, watching_component
from benchmark.runs.unchanged import CodeChanged, PlannedCode, PlannedFiles, plan_code
from benchmark.text import Printed, clean_lines

#: Modules with the code of the suite that makes files of a stage, beside that of preparation and of
#: the component.
STAGE_MODULES: Mapping[Stage, str] = {"forms": forms.__name__, "records": rank.__module__}

T = TypeVar("T")

#: A file of the cache.
File = tuple[Stage, str]

# What a worker gets and gives
# ----------------------------------------------------------------------------------------


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
    """

    key: str
    row: RowId
    source: str
    data_root: Path | None
    method: Component
    scorer: Component
    results: Path


class Step(NamedTuple):
    """What makes a file: the frame of the camera, a prepared shape, a form, a signature, or the distances of a gallery.

    Parameters
    ----------
    job
        A job that needs the file; others may need it, too.
    stage, key
        The file.
    shape
        The shape; "" for a frame and for distances.
    keys
        Keys of the files of the shape by stage.
    model
        Trained model of the method.
    card
        Digest of the card of that model when the run was planned.
    code
        The code that the plan saw, of what determines a result; a process with other code leaves the
        job incomplete.
    source_shape
        The shape whose mesh is loaded: that which a view shows; "" as for the shape.
    """

    job: Job
    stage: Stage
    key: str
    shape: str = ""
    keys: Mapping[Stage, str] = {}
    model: Path | None = None
    card: str = ""
    code: PlannedCode | None = None
    source_shape: str = ""

    def __str__(self) -> str:
        work = "preparation" if self.stage == "prepared" else self.job.method.name
        return (
            f"{work}, {self.shape or 'camera'}"
            if self.stage != "records"
            else f"ranking {self.job.row}"
        )

    @property
    def file(self) -> File:
        """The file that it makes."""
        return self.stage, self.key

    @property
    def component(self) -> Component:
        """The method or scorer that makes the file, unless preparation does."""
        return (
            self.job.method if self.stage == "forms" or not self.job.row.scorer else self.job.scorer
        )

    @property
    def process(self) -> str:
        """Whose process it runs in: "" for the suite."""
        return "" if self.stage == "prepared" else self.component.process


def code_of_step(component: Component, stage: Stage) -> PlannedCode | None:
    """Return the code with which a method or scorer makes files of a stage; None if nobody knows it."""
    if component.is_unknown:
        return None
    modules = [STAGE_MODULES[stage]] if stage in STAGE_MODULES else []
    return plan_code(component.target, modules, component.files)


class Task(NamedTuple):
    """Work for one process: steps at one shape of a data set, or the ranking of one job, with its record so far."""

    steps: tuple[Step, ...]
    record: Record | None = None

    @property
    def process(self) -> str:
        """Whose process it runs in."""
        return self.steps[0].process


class Outcome(NamedTuple):
    """Result of a step.

    Parameters
    ----------
    status
        ``"ok"``, ``"refused"`` (the content of the shape), ``"incomplete"`` (no result, for a
        reason that is neither in the shape nor in the method), ``"stopped"`` (the run cannot go
        on), or the status of the record of a job that failed.
    reason, traceback
        Why there is no result.
    of_shape
        Whether an outcome without a result holds for all files of this shape.
    content
        Of a ranking: what its record says.
    ends_process
        Whether its process may hold code in memory that is not that of the plan.
    """

    status: str
    reason: str = ""
    traceback: str = ""
    of_shape: bool = False
    content: Mapping[str, Any] = {}
    ends_process: bool = False


class Queue:
    """Tasks to do, by the process that they run in.

    Parameters
    ----------
    is_open
        Says whether the outcome of a step is still wanted.
    """

    def __init__(self, is_open: Callable[[Step], bool]) -> None:
        self._is_open = is_open
        self._tasks = defaultdict[str, deque[Task]](deque)

    def add(self, task: Task, *, first: bool = False) -> None:
        """Add a task, behind or before all others."""
        tasks = self._tasks[task.process]
        tasks.appendleft(task) if first else tasks.append(task)

    def count(self, process: str) -> int:
        """Return the number of waiting tasks of a process."""
        return len(self._tasks[process])

    def take(self, process: str) -> Task | None:
        """Return the next task of a process with its open steps; None if there is none."""
        tasks = self._tasks[process]
        while tasks:
            task = tasks.popleft()
            if steps := tuple(filter(self._is_open, task.steps)):
                return task._replace(steps=steps)
        return None

    def take_any(self, processes: Iterable[str] = ()) -> Task | None:
        """Return the next task for workers: of one of some processes if there is one, so that they need not change."""
        others = (process for process in [*self._tasks] if process != THIS_PROCESS)
        return next(filter(None, map(self.take, [*processes, *others])), None)


# Steps
# ------------------------------------------------------------------------------------------------


class RunContext:
    """What a process keeps in memory for one run: open data sets, methods with their models, and scorers.

    It is made for a run and ends with it, in the program, in a worker and on a cluster alike, so
    that a later run sees plugins that were edited and files that were written since.

    Parameters
    ----------
    uncharged
        Context of work that is charged to no method: ``"loading"``, ``"geodesics"``.
    """

    def __init__(self, uncharged: forms.Uncharged = lambda _: nullcontext()) -> None:
        self.uncharged = uncharged
        self._components: dict[tuple[Component, Path | None], Any] = {}
        self._files: dict[tuple[Component, Stage, Path | None], PlannedFiles] = {}
        self._open = cache(_open)
        self._prepare = cache(
            lambda source, data_root, input_: PreparedShapes(self._open(source, data_root), input_)
        )

    def created(self, step: Step) -> Any:
        """Return the method of a step with its model, or its scorer."""
        model = step.model if step.stage == "forms" else None
        key = step.component, model
        if key not in self._components:
            with self.uncharged("loading"):
                created = step.component.create()
                created = created.load(model) if model else created
            self._components[key] = created
        return self._components[key]

    def unchanged(self, step: Step) -> AbstractContextManager[object]:
        """Return the context in which the files of a step must be those of the plan; see :class:`PlannedFiles`."""
        if step.code is None:
            return nullcontext()
        model = step.model if step.stage == "forms" else None
        key = step.component, step.stage, model
        if key not in self._files:
            self._files[key] = PlannedFiles(step.code, model, step.card)
        return self._files[key].unchanged()

    def prepared_shapes(self, job: Job) -> PreparedShapes:
        """Return the prepared shapes of a job."""
        with self.uncharged("loading"):
            return self._prepare(job.source, job.data_root, job.row.input)


class Unrunnable(BenchmarkError):
    """No job can run on this machine."""


def _open(source: str, data_root: Path | None) -> ShapeSet:
    """Open a data set that loads a mesh once for both inputs, unless its file changes: generated ones take a second."""
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.geometry.preparation import import_pymeshlab

    try:
        import_pymeshlab()
    except ConfigurationError as error:
        raise Unrunnable(error.located, error.hint) from error
    try:
        shapes = open_dataset(source, data_root)
    except BenchmarkError as error:  # the plan could open it
        raise Incomplete(f"{CHANGED}: {error.located}") from error
    load = lru_cache(1)(lambda entry, _key, _change: shapes.load(entry))

    def load_once(entry: Entry) -> Any:
        return load(entry, shapes.key(entry), last_change(shapes, entry))

    return replace(shapes, load=load_once)


class Work:
    """A task under way, with what its steps share: files, and the shape with its geodesics.

    Parameters
    ----------
    task, context
        The task, and what this process keeps for its run.
    """

    def __init__(self, task: Task, context: RunContext) -> None:
        self.task, self._context = task, context
        self._files: dict[File, Arrays] = {}
        self._shapes: dict[str, tuple[Shape, forms.SharedResults]] = {}

    def outcome(self, step: Step) -> Outcome:
        """Do a step; what goes wrong in it becomes its outcome.

        Raises
        ------
        KeyboardInterrupt
            If the run is interrupted, which no method is to blame for; so is ``BdbQuit``, with
            which a debugger ends.
        """
        try:
            return self._rank(step, self.task.record) if self.task.record else self._make(step)
        except (KeyboardInterrupt, BdbQuit):
            raise
        except (StorageError, Unrunnable) as error:
            return Outcome("stopped", str(error))
        except CodeChanged as error:
            return Outcome("incomplete", str(error), ends_process=True)
        except DamagedFiles as error:
            for file in error.files:
                Cache(step.job.results).remove(*file)
            return Outcome(
                "incomplete",
                str(Incomplete(f"a file of {step.shape or 'the gallery'} was damaged")),
            )
        except Incomplete as error:
            return Outcome(
                "incomplete",
                f"{step.shape} {error}".strip(),
                of_shape=isinstance(error, forms.NoGeodesics),
            )
        except BaseException as error:  # SystemExit included: a method must not end its worker
            out_of_memory = "out of memory" if isinstance(error, MemoryError) else ""
            if step.stage == "prepared":  # of the suite, so that no method is to blame
                problem = f"{step.shape or 'the camera'} was not prepared: {out_of_memory or locate(error)}"
                return Outcome("incomplete", str(Incomplete(problem)))
            if out_of_memory:
                return Outcome(
                    "memory", "out of memory; run with fewer jobs (-j 1) or on a larger machine"
                )
            if isinstance(error, BenchmarkError):
                return Outcome("failed", str(error))
            return Outcome("failed", locate(error), clean_lines(traceback.format_exc()))

    def _make(self, step: Step) -> Outcome:
        """Compute the file of a step, unless it is there; a shape that was refused before remains refused."""
        before, make = self._MAKERS[step.stage]
        arrays = self._read(step, before) if before else {}
        if REFUSED not in arrays:
            arrays = Cache(step.job.results).get(
                step.stage, step.key, lambda: self._watched(step, make)
            )
            self._files[step.file] = arrays
        refused = arrays.get(REFUSED)
        return (
            Outcome("ok")
            if refused is None
            else Outcome("refused", "; ".join(filter(None, refused.tolist())))
        )

    def _watched(self, step: Step, make: Callable[[Any, Step], T]) -> T:
        """Return what a step makes.

        Raises
        ------
        CodeChanged
            If a file on which it depends is not that of the plan, before or after it.
        ConfigurationError
            If a plugin reads what it does not declare.
        """
        allowed = filter(None, [step.job.results / RUNS, step.model])
        with (
            self._context.unchanged(step),
            chdir("."),
            watching_component(step.component, allowed) if step.process else nullcontext(),
        ):
            return make(self, step)

    def _read(self, step: Step, stage: Stage) -> Arrays:
        """Return a file of the shape of a step that was made before."""
        file = stage, step.keys[stage]
        if file not in self._files:
            arrays = Cache(step.job.results).read(*file)
            if arrays is None:
                raise DamagedFiles([file])
            self._files[file] = arrays
        return self._files[file]

    def _prepare(self, step: Step) -> Arrays:
        """Prepare a shape, or fit the frame of the camera; they must be those of the plan."""
        prepared_shapes = self._context.prepared_shapes(step.job)
        if not step.shape:
            if prepared_shapes.frame_key != step.key:
                raise Incomplete(f"the camera was not prepared: the data set {CHANGED}")
            return prepared_shapes.frame()
        entry, half_width = (
            prepared_shapes.find(step.shape, step.key),
            prepared_shapes.shapes.half_width or 0.0,
        )
        if prepared_shapes.input == "view" and prepared_shapes.frame_key:
            frame = step._replace(keys={"prepared": prepared_shapes.frame_key})
            half_width = float(self._read(frame, "prepared")["half_width"])
        return prepared_shapes.prepare(entry, half_width)

    def _form(self, step: Step) -> Arrays:
        method, key = self._context.created(step), step.keys["prepared"]
        if key not in self._shapes:
            prepared, shared = (
                self._read(step, "prepared"),
                forms.SharedResults(self._context.uncharged),
            )
            self._shapes[key] = (
                forms.shape_of(prepared, step.shape, step.job.row.seed, shared),
                shared,
            )
        shape, shared = self._shapes[key]
        shared.owner = step.component, step.model
        return compute_output(method, shape, shared)

    def _signature(self, step: Step) -> Arrays:
        scorer, form = self._context.created(step), self._read(step, "forms")
        return sign(
            scorer, forms.mesh_of(form, {} if "faces" in form else self._read(step, "prepared"))
        )

    #: By stage of a file: the one of the same shape that it is made from, and how.
    _MAKERS: ClassVar[Mapping[Stage, tuple[Stage | None, Callable[[Any, Step], Arrays]]]] = {
        "prepared": (None, _prepare),
        "forms": ("prepared", _form),
        "signatures": ("forms", _signature),
    }

    def _rank(self, step: Step, record: Record) -> Outcome:
        """Rank the gallery of a job, and keep its distances."""
        kept = Cache(step.job.results)

        def ranked(_: Any, step: Step) -> tuple[dict[str, Any], Arrays]:
            comparing = self._context.created(step)
            return rank(record, kept, comparing, make_distance_check(comparing))

        content, distances = self._watched(step, ranked)
        if not distances:
            name, reason = content["unsupported"][0]
            number = len(content["unsupported"])
            return Outcome(
                "unsupported", f"none of {number} shapes could be processed; {name}: {reason}"
            )
        kept.write(*step.file, distances)
        return Outcome("ok", content=content)


# The program of a worker
# ---------------------------------------------------------------------------------------------


def serve(descriptor: int, memory: int, parent: int) -> None:
    """Run the tasks that come from a connection until the program at its other end ends."""
    from numba.core import event

    _die_with(parent)
    watch_this_process()
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
                    outcome = Outcome(
                        "failed", f"it raises {type(error).__name__}: use a debugger with -j 0"
                    )
                connection.send(outcome)
                if outcome.ends_process:
                    return


def _die_with(parent: int) -> None:
    """Let the system end this process with its parent, also if that is killed."""
    with suppress(
        AttributeError, OSError
    ):  # only Linux has it; elsewhere, a worker ends after its task
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        sys.exit(1)
