"""Tasks, into which jobs are divided, and the program of a worker that runs them.

Each file of the cache is made by one step, in a process of its maker: prepared shapes by the suite,
a form by the suite or by the plugin of its method, a signature by that of its scorer. So what a
plugin changes in its process, such as a constant of the suite, changes no file of anybody else.

Messages of a worker are the name of work that begins and is charged to no method,
:data:`UNCHARGED_WORK_ENDS`, and outcomes.
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
from functools import cache, lru_cache, partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.api.contracts import Input, Shape
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import BenchmarkError, ConfigurationError, locate, with_hint
from benchmark.machine import copies_end, same_umask
from benchmark.pipeline import forms
from benchmark.pipeline.cache import (
    RUNS,
    Cache,
    CachedFile,
    Stage,
    StorageError,
    UnreadableFile,
)
from benchmark.pipeline.outputs import compute_output, make_distance_check, sign
from benchmark.pipeline.prepared import CHANGED, PreparedShapes, last_change
from benchmark.pipeline.ranking import DamagedFiles, rank
from benchmark.pipeline.records import Record, RowId
from benchmark.pipeline.stages import REFUSED, Arrays, Incomplete
from benchmark.reads import watch_this_process
from benchmark.registry.components import THIS_PROCESS, Component, watching_component
from benchmark.runs.unchanged import (
    CodeChanged,
    PlannedCode,
    PlannedFiles,
    plan_code,
    state_of_suite,
)
from benchmark.text import Printed, clean_lines

#: Modules with the code of the suite that makes files of a stage, beside that of preparation and of
#: the component.
STAGE_MODULES: Mapping[Stage, str] = {"forms": forms.__name__, "records": rank.__module__}

#: Message of a worker: the work that it named last, which is charged to no method, has ended.
UNCHARGED_WORK_ENDS = None

#: Option of ``prctl`` that has the system send a process a signal when its parent ends.
_PR_SET_PDEATHSIG = 1

# What a worker gets and gives
# ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """A method on a gallery under one input, as a worker gets it: without the shapes.

    Parameters
    ----------
    key, row
        Key of its record, and what that is the result of.
    method, scorer
        What to do with the shapes.
    results
        The results folder.
    """

    key: str
    row: RowId
    method: Component
    scorer: Component
    results: Path


class ShapeSource(NamedTuple):
    """Where a worker gets shapes.

    Parameters
    ----------
    name
        Name of a data set, or path of a folder.
    data_root
        Folder of the official data sets.
    input
        What is prepared of each shape.
    """

    name: str
    data_root: Path | None
    input: Input


class Step(NamedTuple):
    """What makes a file: a camera's frame, a prepared shape, a form, a signature, or distances.

    Parameters
    ----------
    job
        A job that needs the file; others may need it, too.
    source
        The data set of the shape, of the frame, or of the queries of distances.
    stage, key
        The file.
    view
        Name of the shape, or of the view where it has several; "" for a frame and for distances.
    shape
        The shape whose mesh is loaded; "" for a frame and for distances.
    keys
        Keys of the files of the view by stage.
    model
        Trained model of the method.
    card
        Digest of the card of that model when the run was planned.
    code
        The code that the plan saw, of what determines a result; a process with other code leaves
        the job incomplete.
    """

    job: Job
    source: ShapeSource
    stage: Stage
    key: str
    view: str = ""
    shape: str = ""
    keys: Mapping[Stage, str] = {}
    model: Path | None = None
    card: str = ""
    code: PlannedCode | None = None

    def __str__(self) -> str:
        if self.stage == "records":
            return f"ranking {self.job.row}"
        work = "preparation" if self.stage == "prepared" else self.job.method.name
        return f"{work}, {self.view or 'camera'}"

    @property
    def file(self) -> CachedFile:
        """The file that it makes."""
        return CachedFile(self.stage, self.key)

    @property
    def component(self) -> Component:
        """The method or scorer that makes the file, unless preparation does."""
        if self.stage == "forms" or not self.job.row.scorer:
            return self.job.method
        return self.job.scorer

    @property
    def process(self) -> str:
        """Whose process it runs in: "" for the suite."""
        return "" if self.stage == "prepared" else self.component.process


def code_of_step(component: Component, stage: Stage) -> PlannedCode | None:
    """Return the code with which a component makes files of a stage; None if nobody knows it."""
    if component.is_unknown:
        return None
    modules = [STAGE_MODULES[stage]] if stage in STAGE_MODULES else []
    return plan_code(component.target, modules, component.files)


class Task(NamedTuple):
    """Work for one process.

    Parameters
    ----------
    steps
        Steps at one shape of a data set, or the ranking of one job.
    record
        Of a ranking: the record of the job without its outcome.
    """

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
        Whether an outcome without a result holds for all methods that need the geodesics of this
        shape.
    content
        Of a ranking: what its record says.
    ends_process
        Whether its process may hold code in memory that is not that of the plan.
    damaged
        Files that it needs, which are missing or damaged, and have to be made again.
    """

    status: str
    reason: str = ""
    traceback: str = ""
    of_shape: bool = False
    content: Mapping[str, Any] = {}
    ends_process: bool = False
    damaged: tuple[CachedFile, ...] = ()


class Queue:
    """Tasks to do, by the process that they run in.

    Parameters
    ----------
    is_open
        Says whether the outcome of a step is still wanted.
    """

    def __init__(self, is_open: Callable[[Step], bool]) -> None:
        self._is_open = is_open
        self._tasks: defaultdict[str, deque[Task]] = defaultdict(deque)

    def add(self, task: Task, *, first: bool = False) -> None:
        """Add a task, behind or before all others."""
        tasks = self._tasks[task.process]
        if first:
            tasks.appendleft(task)
        else:
            tasks.append(task)

    def count(self, process: str) -> int:
        """Return the number of waiting tasks of a process."""
        return len(self._tasks[process])

    def take(self, process: str) -> Task | None:
        """Return the next task of a process with its open steps; None if there is none."""
        tasks = self._tasks[process]
        while tasks:
            task = tasks.popleft()
            open_steps = tuple(filter(self._is_open, task.steps))
            if open_steps:
                return task._replace(steps=open_steps)
        return None

    def take_any(self, preferred: Iterable[str] = ()) -> Task | None:
        """Return the next task for workers; None if there is none.

        Parameters
        ----------
        preferred
            Processes that run already: their tasks come first, so that none need be started.
        """
        for process in [*preferred, *self._tasks]:
            if process == THIS_PROCESS:
                continue
            task = self.take(process)
            if task is not None:
                return task
        return None


# Steps
# ------------------------------------------------------------------------------------------------


class RunContext:
    """What a process keeps in memory for one run: data sets, methods with their models, scorers.

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
        # Both inputs of a data set share what it loads.
        self._open_set = cache(_open_set)
        self._prepared_shapes: dict[ShapeSource, PreparedShapes] = {}

    def create_component(self, step: Step) -> Any:
        """Return the method of a step with its model, or its scorer."""
        model = step.model if step.stage == "forms" else None
        key = step.component, model
        if key not in self._components:
            with self.uncharged("loading"):
                component = step.component.create()
                if model:
                    component = component.load(model)
            self._components[key] = component
        return self._components[key]

    def unchanged(self, step: Step) -> AbstractContextManager[object]:
        """Return the context in which the files of a step must be those of the plan.

        See :class:`benchmark.runs.unchanged.PlannedFiles`.
        """
        if step.code is None:
            return nullcontext()
        model = step.model if step.stage == "forms" else None
        key = step.component, step.stage, model
        if key not in self._files:
            self._import_plugin(step)
            self._files[key] = PlannedFiles(step.code, model, step.card)
        return self._files[key].unchanged()

    def _import_plugin(self, step: Step) -> None:
        """Import the plugin of a step, if its component is of one.

        The plan did so before it looked for the files of its code: a plugin may add folders to the
        path of modules. An error is left to the step, which imports the plugin again.
        """
        if step.component.plugin:
            with self.uncharged("loading"), suppress(BenchmarkError):
                step.component.load()

    def prepared_shapes(self, source: ShapeSource) -> PreparedShapes:
        """Return the prepared shapes of a data set."""
        if source not in self._prepared_shapes:
            with self.uncharged("loading"):
                shapes = self._open_set(source.name, source.data_root)
                self._prepared_shapes[source] = PreparedShapes(shapes, source.input)
        return self._prepared_shapes[source]


class Unrunnable(BenchmarkError):
    """No job can run on this machine."""


def _open_set(name: str, data_root: Path | None) -> ShapeSet:
    """Open a data set that keeps the mesh it loaded last.

    Surface and view of a shape are prepared one after the other, and generating a mesh takes a
    second. A mesh whose file has changed is loaded again.

    Raises
    ------
    Unrunnable
        If PyMeshLab, which prepares all meshes, cannot be imported.
    Incomplete
        If the data set has changed since the plan, which could open it.
    """
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.geometry.preparation import import_pymeshlab

    try:
        import_pymeshlab()
    except ConfigurationError as error:
        raise Unrunnable(error.located, error.hint) from error
    try:
        shapes = open_dataset(name, data_root)
    except BenchmarkError as error:  # the plan could open it
        raise Incomplete(f"{CHANGED}: {error.located}") from error

    @lru_cache(maxsize=1)
    def load(entry: Entry, _key: object, _last_change: object) -> Any:
        """Return the mesh of a shape; the unused arguments tell when it has changed."""
        return shapes.load(entry)

    def load_once(entry: Entry) -> Any:
        """Return the mesh of a shape."""
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
        self.task = task
        self._context = context
        self._arrays: dict[CachedFile, Arrays] = {}
        #: Shapes as methods get them, and what methods share of them, by the prepared shape.
        self._shapes: dict[str, tuple[Shape, forms.SharedResults]] = {}

    def outcome(self, step: Step) -> Outcome:
        """Run a step, and return how it ended; an error of the step becomes an outcome, too.

        Raises
        ------
        KeyboardInterrupt
            If the user interrupts the run.
        BdbQuit
            If the user leaves the debugger.
        """
        try:
            return self._run(step)
        except (KeyboardInterrupt, BdbQuit):
            raise
        except BaseException as error:  # SystemExit included: a method must not end its worker
            return _outcome_of_error(step, error)

    def _run(self, step: Step) -> Outcome:
        """Run a step; damaged files of the cache are named.

        They are left to the step that makes them, which writes over them: another process may have
        done so since this one has read them.
        """
        try:
            if self.task.record:
                return self._rank(step, self.task.record)
            return self._make(step)
        except DamagedFiles as error:
            damaged = tuple(CachedFile(*file) for file in error.files)
            outcome = _incomplete(f"a file of {step.view or 'the gallery'} was damaged")
            return outcome._replace(damaged=damaged)

    def _make(self, step: Step) -> Outcome:
        """Compute the file of a step, unless it is in the cache, and return how that ended.

        A form is computed from a prepared shape, and a signature from a form. A shape that was
        refused in one stage, and so has a reason in place of arrays, is refused in all later ones.
        """
        source: Arrays = {}
        if step.stage == "forms":
            source = self._read(step, "prepared")
        elif step.stage == "signatures":
            source = self._read(step, "forms")

        arrays = source
        if REFUSED not in source:
            cache_of_run = Cache(step.job.results)
            arrays = cache_of_run.get(step.stage, step.key, lambda: self._compute(step))
            self._arrays[step.file] = arrays

        if REFUSED in arrays:
            reasons = arrays[REFUSED].tolist()
            return Outcome("refused", "; ".join(filter(None, reasons)))
        return Outcome("ok")

    def _compute(self, step: Step) -> Arrays:
        """Return what a step makes."""
        with self._guarded(step):
            if step.stage == "prepared":
                return self._prepare(step) if step.view else self._fit_frame(step)
            if step.stage == "forms":
                return self._form(step)
            return self._signature(step)

    @contextmanager
    def _guarded(self, step: Step) -> Iterator[None]:
        """Run the code of a step.

        Raises
        ------
        CodeChanged
            If a file on which it depends is not that of the plan, before or after it.
        ConfigurationError
            If a plugin reads what it does not declare.
        """
        # A method may change the working folder and the umask for itself alone.
        with (
            self._context.unchanged(step),
            chdir("."),
            same_umask(),
            _watching(step),
            copies_end(),
        ):
            yield

    def _read(self, step: Step, stage: Stage) -> Arrays:
        """Return a file of the view of a step that was made before."""
        return self._read_file(step, CachedFile(stage, step.keys[stage]))

    def _read_file(self, step: Step, file: CachedFile) -> Arrays:
        """Return a file of the cache; raise ``DamagedFiles`` if it is missing or damaged."""
        if file not in self._arrays:
            arrays = Cache(step.job.results).read(*file)
            if arrays is None:
                raise DamagedFiles([file])
            self._arrays[file] = arrays
        return self._arrays[file]

    def _fit_frame(self, step: Step) -> Arrays:
        """Fit the frame of a camera: the square that holds all shapes of a data set.

        Raises
        ------
        Incomplete
            If the camera is no longer that of the plan.
        """
        prepared_shapes = self._context.prepared_shapes(step.source)
        if prepared_shapes.frame_key != step.key:
            raise Incomplete(f"the camera was not prepared: the data set {CHANGED}")
        return prepared_shapes.frame()

    def _prepare(self, step: Step) -> Arrays:
        """Prepare the shape of a step: clean its mesh, or render a depth view of it.

        Raises
        ------
        Incomplete
            If the shape is no longer that of the plan.
        """
        prepared_shapes = self._context.prepared_shapes(step.source)
        entry = prepared_shapes.find(step.view, step.key)
        half_width = prepared_shapes.shapes.half_width or 0.0
        if prepared_shapes.input == "view" and prepared_shapes.frame_key:
            # The frame was fitted to all shapes by an earlier step.
            frame = self._read_file(step, CachedFile("prepared", prepared_shapes.frame_key))
            half_width = float(frame["half_width"])
        return prepared_shapes.prepare(entry, half_width)

    def _form(self, step: Step) -> Arrays:
        """Compute the form of a shape, or its descriptor."""
        method = self._context.create_component(step)
        shape, shared = self._shape_of(step)
        shared.owner = step.component, step.model
        return compute_output(method, shape, shared)

    def _shape_of(self, step: Step) -> tuple[Shape, forms.SharedResults]:
        """Return the shape of a step, and what methods share of it, such as its geodesics.

        All steps of a task get the same objects.
        """
        prepared_key = step.keys["prepared"]
        if prepared_key not in self._shapes:
            prepared = self._read(step, "prepared")
            shared = forms.SharedResults(self._context.uncharged)
            shape = forms.shape_of(prepared, step.view, step.job.row.seed, shared)
            self._shapes[prepared_key] = shape, shared
        return self._shapes[prepared_key]

    def _signature(self, step: Step) -> Arrays:
        """Compute the signature of a form."""
        scorer = self._context.create_component(step)
        form = self._read(step, "forms")
        # A form that keeps the faces of its shape is stored without them.
        prepared = {} if "faces" in form else self._read(step, "prepared")
        return sign(scorer, forms.mesh_of(form, prepared))

    def _rank(self, step: Step, record: Record) -> Outcome:
        """Rank the shapes of a job, store their distances, and return their scores as outcome.

        Parameters
        ----------
        step
            The step, whose component compares shapes: a scorer, or a method that makes descriptors.
        record
            Record of the job, which names the shapes and their files, and lacks the scores.
        """
        cache_of_run = Cache(step.job.results)
        with self._guarded(step):
            scorer = self._context.create_component(step)
            content, arrays = rank(record, cache_of_run, scorer, make_distance_check(scorer))
        if not arrays:  # every shape was refused
            refused = content["unsupported"]
            name, reason = refused[0]
            problem = f"none of {len(refused)} shapes could be processed; {name}: {reason}"
            return Outcome("unsupported", problem)
        cache_of_run.write(*step.file, arrays)
        return Outcome("ok", content=content)


def _watching(step: Step) -> AbstractContextManager[object]:
    """Return the context in which the plugin of a step may read what it declares."""
    if not step.process:
        return nullcontext()
    allowed = [step.job.results / RUNS]
    if step.model:
        allowed.append(step.model)
    return watching_component(step.component, allowed)


def _outcome_of_error(step: Step, error: BaseException) -> Outcome:
    """Return the outcome of a step that raised an error.

    It is ``"stopped"`` if the whole run has to end, ``"incomplete"`` if the method is not to blame,
    and a failure of the method otherwise.
    """
    subject = "the ranking" if step.stage == "records" else step.view or "the camera"
    if isinstance(error, StorageError) and step.process and not error.is_of_disk:
        # A plugin may have limited what its process can write.
        reason = with_hint(
            f"{subject} has no result: the process of the plugin {error.problem}",
            "see what the plugin changes, and run again",
        )
        return Outcome("incomplete", reason, ends_process=True)
    if isinstance(error, StorageError | Unrunnable):
        return Outcome("stopped", str(error), ends_process=True)
    if isinstance(error, CodeChanged):
        # This process may have imported the code before or after the change.
        return Outcome("incomplete", str(error), ends_process=True)
    if isinstance(error, UnreadableFile):
        return Outcome("incomplete", f"{subject} has no result: {error}")
    if isinstance(error, Incomplete):
        # Without geodesics, other methods that need them have no form of this shape either.
        has_no_geodesics = isinstance(error, forms.NoGeodesics)
        return Outcome("incomplete", f"{step.view} {error}".strip(), of_shape=has_no_geodesics)
    if step.stage == "prepared":  # by the suite
        cause = "out of memory" if isinstance(error, MemoryError) else locate(error)
        return _incomplete(f"{step.view or 'the camera'} was not prepared: {cause}")
    return _failure_of_method(error)


def _incomplete(problem: str) -> Outcome:
    """Return an outcome that no method is to blame for, with the advice to run again."""
    return Outcome("incomplete", str(Incomplete(problem)))


def _failure_of_method(error: BaseException) -> Outcome:
    """Return the outcome of a step whose method or scorer raised an error."""
    if isinstance(error, MemoryError):
        hint = "run with fewer jobs (-j 1) or on a larger machine"
        return Outcome("memory", with_hint("out of memory", hint))
    if isinstance(error, BenchmarkError):
        return Outcome("failed", str(error))
    trace = clean_lines("".join(traceback.format_exception(error)))
    return Outcome("failed", locate(error), trace)


# The program of a worker
# ---------------------------------------------------------------------------------------------


def serve(descriptor: int, memory: int, parent: int, suite: int) -> None:
    """Run tasks in this process, a worker, until the program that started it ends.

    A task is received from a connection, and the outcome of each of its steps is sent back. Work
    that counts against no time limit is announced by its name when it begins, and by
    :data:`UNCHARGED_WORK_ENDS` when it ends. The process also ends if its code is not that of the
    plan.

    Parameters
    ----------
    descriptor
        File descriptor of the connection.
    memory
        Most bytes of memory that this process may take.
    parent
        Identifier of the process that started it.
    suite
        State of the source files of the suite when this process was started.
    """
    _exit_when_ended(parent)
    watch_this_process()
    _limit_memory(memory)
    connection = Connection(descriptor)
    tell = partial(_tell, connection, os.getpid())
    _announce_compiling(tell)
    tell(UNCHARGED_WORK_ENDS)  # the start of this process was the first such work

    # After an edit, some modules may have been imported before it, and some after it.
    if state_of_suite() != suite:
        reason = str(CodeChanged("the suite"))
        with suppress(EOFError, OSError):
            connection.recv()
            connection.send(Outcome("incomplete", reason, ends_process=True))
        return
    context = RunContext(partial(_uncharged, tell))
    printed = Printed()  # what methods print is shown with the name of their step
    # EOFError and OSError: the other end has closed the connection.
    with suppress(EOFError, OSError), redirect_stdout(printed):
        has_planned_code = True
        while has_planned_code:
            work = Work(connection.recv(), context)
            has_planned_code = _serve_task(work, connection, printed)


def _tell(connection: Connection, process: int, message: str | None) -> None:
    """Send a message from one process, and not from copies of it that a method has forked.

    A copy may be killed after work has begun, which would then never end.
    """
    if os.getpid() == process:
        connection.send(message)


@contextmanager
def _uncharged(tell: Callable[[str | None], None], name: str) -> Iterator[None]:
    """Tell the other end when work begins and ends that counts against no time limit."""
    tell(name)
    try:
        yield
    finally:
        tell(UNCHARGED_WORK_ENDS)


def _serve_task(work: Work, connection: Connection, printed: Printed) -> bool:
    """Run the steps of a task, and send the outcome of each.

    Parameters
    ----------
    work
        The task, and what its steps share.
    connection
        Connection to the program that started this process.
    printed
        Takes what is printed to stdout, and shows it with the name of the step.

    Returns
    -------
    bool
        Whether this process still holds the code that was planned.
    """
    for step in work.task.steps:
        printed.name = str(step)
        try:
            outcome = work.outcome(step)
        except (KeyboardInterrupt, BdbQuit) as error:  # there is no terminal here
            reason = f"it raises {type(error).__name__}: use a debugger with -j 0"
            outcome = Outcome("failed", reason)
        connection.send(outcome)
        if outcome.ends_process:
            return False
    return True


def _announce_compiling(tell: Callable[[str | None], None]) -> None:
    """Tell the other end when kernels are compiled, which counts against no time limit."""
    from numba.core import event

    class Compiling(event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            tell("compiling")

        def on_end(self, event: object) -> None:
            tell(UNCHARGED_WORK_ENDS)

    event.register("numba:compile", Compiling())


def _limit_memory(n_bytes: int) -> None:
    """Limit the memory of this process, unless the user set a lower limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    for limit in (soft, hard):
        if limit != resource.RLIM_INFINITY:
            n_bytes = min(n_bytes, limit)
    resource.setrlimit(resource.RLIMIT_DATA, (n_bytes, hard))


def _exit_when_ended(parent: int) -> None:
    """Let the system end this process with its parent, also if that is killed."""
    # Only Linux can; elsewhere, a worker ends after its task.
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        sys.exit(1)
