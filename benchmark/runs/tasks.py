"""Run the steps of a task; what goes wrong in one becomes its outcome."""

from __future__ import annotations

import traceback
from bdb import BdbQuit
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Descriptor, Mesh, Shape
from benchmark.api.datasets import Entry
from benchmark.errors import BenchmarkError, InvalidForm, InvalidSignature, ShapeError, locate
from benchmark.pipeline.cache import Arrays, Cache, StorageError
from benchmark.pipeline.forms import Aside, SharedStages, compute_answer, mesh_of, shape_of, sign
from benchmark.pipeline.keys import digest
from benchmark.pipeline.ranking import Ranking
from benchmark.pipeline.shapes import Preparation, SharedFailure, Unprepared, require_result
from benchmark.registry.components import Component
from benchmark.runs.jobs import Job, Outcome, Step, Task


class CodeChanged(BenchmarkError):
    """The code that a worker has is not that of the plan."""


#: Methods that this process has used, with their input: the first use includes loading and compiling.
_used: set[tuple[Component, str]] = set()


def run_task(task: Task, aside: Aside) -> Iterator[Outcome]:
    """Yield the outcome of each step of a task.

    Parameters
    ----------
    task
        The task.
    aside
        Told about work that is charged to no method: ``"loading"``, ``"preparation"``, ``"geodesics"``.

    Raises
    ------
    KeyboardInterrupt
        If the run is interrupted, which no method is to blame for; so is ``BdbQuit``, with which a debugger ends.
    """
    at_work = ShapeAtWork(task.shape, aside)
    for step in task.steps:
        yield attempt(lambda step=step: rank(task, step, aside) if task.gallery else at_work.process(step))  # type: ignore[misc]


def attempt(work: Callable[[], Outcome]) -> Outcome:
    """Return the outcome of a step, or what went wrong in it."""
    try:
        return work()
    except (KeyboardInterrupt, BdbQuit):
        raise
    except MemoryError:
        return Outcome("memory", "out of memory; run with fewer jobs (-j 1) or on a larger machine")
    except StorageError as error:
        return Outcome("storage", error.problem, error.hint)
    except CodeChanged as error:
        return Outcome("changed", str(error))
    except SharedFailure as error:
        return Outcome("lost", str(error))
    except (InvalidForm, InvalidSignature) as error:
        return Outcome("failed", str(error))
    except Unprepared as error:
        return Outcome("unprepared", str(error))
    except ShapeError as error:
        return Outcome("refused", str(error))
    except BenchmarkError as error:
        return Outcome("failed", str(error))
    except BaseException as error:  # SystemExit included: a method must not end its worker
        return Outcome("failed", locate(error), traceback.format_exc())


class ShapeAtWork:
    """A shape with what its steps share: its mesh, its prepared forms and their geodesics."""

    def __init__(self, name: str, aside: Aside) -> None:
        self.name, self.aside = name, aside
        self._shapes: dict[tuple[str, int], tuple[Shape, SharedStages]] = {}
        self._mesh: Mesh | None = None

    def process(self, step: Step, *, again: bool = False) -> Outcome:
        """Compute the files of a step that are missing, that of the prepared shape only if ``again``.

        Raises
        ------
        ShapeError
            If the shape is refused.
        """
        cache_ = Cache(step.job.results)
        if again:
            self._arrays(step)
        form = cache_.get("forms", step.keys.form, lambda: self._compute(step))
        require_result(form)
        if step.keys.signature:
            require_result(cache_.get("signatures", step.keys.signature, lambda: self._sign(step, form)))
        return Outcome("ok")

    def _compute(self, step: Step) -> Arrays:
        job = step.job
        with self.aside("loading"):
            method, first = load_method(job, step.model), (job.method, job.input) not in _used
        shape, shared = self._prepared(step)
        _used.add((job.method, job.input))
        return compute_answer(method, shape, shared, first=first)

    def _sign(self, step: Step, form: Arrays) -> Arrays:
        with self.aside("loading"):
            scorer = load_scorer(step.job)
        mesh = Mesh(form["vertices"], form["faces"]) if "faces" in form else mesh_of(form, self._arrays(step))
        return sign(scorer, mesh)

    def _prepared(self, step: Step) -> tuple[Shape, SharedStages]:
        place = (step.job.input, step.job.seed)
        if place not in self._shapes:
            shared = SharedStages(self.aside)
            shape = shape_of(self._arrays(step), self.name, step.job.seed, shared)
            self._shapes[place] = shape, shared
        return self._shapes[place]

    def _arrays(self, step: Step) -> Arrays:
        job = step.job
        with self.aside("preparation"):
            preparation = load_preparation(job.source, job.data_root, job.plugins, job.input, job.results)
            entry = entries_of(preparation)[self.name]
            try:
                return preparation.arrays(entry, lambda entry: self._load(preparation, entry))
            except MemoryError as error:
                raise SharedFailure("no memory to prepare it", "simplify the mesh, or use -j 1") from error

    def _load(self, preparation: Preparation, entry: Entry) -> Mesh:
        """Load the mesh once for both inputs: generated ones take a second."""
        if self._mesh is None:
            self._mesh = preparation.shapes.load(entry)
        return self._mesh


def rank(task: Task, step: Step, aside: Aside) -> Outcome:
    """Rank the gallery of a job, and keep its distances."""
    gallery, job, store = task.gallery, step.job, Cache(step.job.results)
    assert gallery is not None  # noqa: S101

    def compute(index: int) -> Outcome:
        missing = Step(job, gallery.keys[index], gallery.models[index])
        return attempt(lambda: ShapeAtWork(gallery.shapes[index], aside).process(missing, again=True))

    with aside("loading"):
        method = load_method(job, gallery.models[0])
        scorer = None if isinstance(method, Descriptor) else load_scorer(job)
    ranking = Ranking(store, gallery.shapes, gallery.labels, gallery.keys, compute, gallery.lost)
    if not ranking.answered:
        first = next(iter(ranking.refused.values()))
        return Outcome("unsupported", f"none of {len(gallery.shapes)} shapes could be processed; first: {first}")
    content, distances = ranking.content(method if isinstance(method, Descriptor) else None, scorer)
    store.write("records", job.key, distances)
    return Outcome("ok", content=content)


# Loading -------------------------------------------------------------------------------------------------------------


@cache
def load_preparation(
    source: str, data_root: Path | None, plugins: tuple[Path, ...], input_: Any, results: Path
) -> Preparation:
    """Open a data set, once in a process."""
    from benchmark.datasets.catalogue import open_dataset

    return Preparation(open_dataset(source, data_root), input_, Cache(results))


@cache
def entries_of(preparation: Preparation) -> dict[str, Entry]:
    """Return the shapes of a data set by name."""
    return {entry.identifier: entry for entry in preparation.shapes.shapes}


@cache
def load_method(job: Job, model: Path | None) -> Any:
    """Create the method of a job, with its model; each is created once."""
    require_code(job)
    method = job.method.create()
    return method.load(model) if model else method


@cache
def load_scorer(job: Job) -> Any:
    """Create the scorer of a job."""
    return job.scorer.create()


def require_code(job: Job) -> None:
    """Raise :class:`CodeChanged` unless this process would run the code of the plan."""
    if digest([_key(job.method), _key(job.scorer)]) != job.code:
        raise CodeChanged("its code changed during the run, or is another one on this machine", "run again")


_key = cache(Component.key)
