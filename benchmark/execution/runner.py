"""Run a task: process shapes, compute a block of distances, or rank a gallery and write its record."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Any

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError, message, one_line
from benchmark.execution.job_specs import Job, Status, Task
from benchmark.execution.plan import CHANGED, UNSAVED, difference
from benchmark.execution.processes.process import ForeignError, ProcessEnded, is_child
from benchmark.pipeline import recipes
from benchmark.pipeline.artefact_ranking import GalleryRanking
from benchmark.pipeline.method_run import MethodRun, Preparation, in_random_order
from benchmark.pipeline.storage import keys, lock
from benchmark.pipeline.storage.environment import commit
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import StorageError, Store
from benchmark.plugins.remote import close_to_plugins

#: Last gallery compared by this process, by the key of its job: the next block usually needs it again.
_compared: dict[str, GalleryRanking] = {}


def work(task: Task, tell: Callable[[Status], object]) -> None:
    """Run a task; an error becomes the record of the job in which it occurs.

    Parameters
    ----------
    task
        The task.
    tell
        Called with the status before each step.
    """
    if not (task.block and task.jobs[0].key in _compared):
        _compared.clear()
    if task.identifiers:
        _treat(task, tell)
        return
    for done, job in enumerate(task.jobs):
        status = Status(job.key, done)
        tell(status)
        store = Store.open(job.results)
        with _guarded(job, store):
            _rank(job, store, task, lambda part, status=status: tell(replace(status, shape=part)))  # type: ignore[misc]


def keep(job: Job, store: Store, content: Mapping[str, Any]) -> Record:
    """Add the entries common to all records, and write the record."""
    record = {
        **job.facts,
        "key": job.key,
        "recipe": keys.plain(job.recipe),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        **content,
    }
    store.write_record(record)
    return record


def failure(status: str, reason: str, trace: str = "") -> dict[str, Any]:
    """Return the content of the record of a failed job."""
    return {"status": status, "reason": reason, "traceback": trace}


def make_forms(job: Job, identifiers: Iterable[str], say: Callable[[str], None]) -> None:
    """Compute and store the forms of shapes of a job, in a child process; ``say`` gets each finished shape.

    If a shape is refused, the reason is stored.
    """
    close_to_plugins()
    store = Store.open(job.results)
    run = _method_run(job, _preparation(job, store), store)

    def make(entry: Entry) -> None:
        with suppress(ShapeError):
            run.answer(entry)
        say(entry.identifier)

    in_random_order(make, _entries(identifiers, run.preparation.dataset))


def _treat(task: Task, tell: Callable[[Status], object]) -> None:
    """Process each shape by all methods in turn, except methods of jobs that failed here or in another task."""
    store = Store.open(task.jobs[0].results)
    preparation: Preparation | None = None
    runs: dict[str, MethodRun] = {}
    computed: dict[str, list[str]] = {job.key: [] for job in task.jobs}
    for job in task.jobs:
        tell(Status(job.key))
        with _guarded(job, store):
            preparation = preparation or _preparation(job, store)
            _require_same_code(job, preparation.dataset)
            runs[job.key] = _method_run(job, preparation, store)
    if preparation is None:
        return
    entries = {entry.identifier: entry for entry in preparation.dataset.shapes}
    shapes_of = {job.key: frozenset(job.identifiers) for job in task.jobs}
    for done, identifier in enumerate(task.identifiers):
        for job in task.jobs:
            if identifier not in shapes_of[job.key] or job.key not in runs or job.key in store.records:
                continue
            tell(Status(job.key, done, identifier))
            with _guarded(job, store, identifier), suppress(ShapeError):  # the reason is in the store
                result = runs[job.key].treat(entries[identifier])
                computed[job.key] += [artefact.key for artefact in result.artefacts if not artefact.was_cached]
    lock.forget()
    for job in task.jobs:
        if job.key in store.records:
            continue
        tell(Status(job.key, len(task.identifiers)))
        with _guarded(job, store):
            try:
                _require_same_code(job, preparation.dataset)
            except _CodeChanged:
                for key in computed[job.key]:
                    store.discard(key)  # computed by either version of the code
                raise


def _rank(job: Job, store: Store, task: Task, tell: Callable[[str], object]) -> None:
    """Write the record of a job whose shapes are finished, or compute a block of its distances."""
    begun = time.perf_counter()
    ranking = _compared.get(job.key)
    preparation = ranking.run.preparation if ranking else _preparation(job, store)
    dataset = preparation.dataset
    _require_same_code(job, dataset)
    if ranking is None:
        run = _method_run(job, preparation, store)
        ranking = GalleryRanking(run, _entries(job.identifiers, dataset))
    ranking.tell = tell
    data = partial(recipes.source_data, dataset)
    if not task.block and recipes.gallery_digest(ranking.gallery, data) != job.recipe["gallery"]:
        raise _CodeChanged("the data changed during the run, or are others on this machine", "run again")
    if task.block:
        _compared[job.key] = ranking
        ranking.compare(*task.block)
    elif ranking.results:
        keep(job, store, ranking.content(begun))
    else:
        reason = f"none of {len(job.identifiers)} shapes could be processed; first: {ranking.refused[0][1]}"
        keep(job, store, failure("unsupported", reason) | {"unsupported": ranking.refused})


def _preparation(job: Job, store: Store) -> Preparation:
    return Preparation(open_dataset(job.dataset, job.data_root), job.input, store)


def _entries(identifiers: Iterable[str], dataset: ShapeSet) -> list[Entry]:
    by_identifier = {entry.identifier: entry for entry in dataset.shapes}
    return [by_identifier[identifier] for identifier in identifiers]


def _method_run(job: Job, preparation: Preparation, store: Store) -> MethodRun:
    run = MethodRun(preparation, store, job.method, job.seed, job.model_of, job.scorer)
    seen = [] if run.describes else run.seen(_entries(job.identifiers, preparation.dataset))
    if seen and job.all_unseen:
        raise ConfigurationError(
            f"{len(seen)} shapes were seen in training: {', '.join(seen[:3])}{' ...' if len(seen) > 3 else ''}",
            "test on shapes that the model has not been trained on, or take another training",
        )
    return run


class _CodeChanged(BenchmarkError):
    """Code or data changed during the run."""


def _require_same_code(job: Job, dataset: ShapeSet) -> None:
    """Raise unless the code on disk is the code of the plan."""
    versions = recipes.job_versions(dataset, job.input, job.method, job.scorer)
    now = {"plugin": None, "versions": versions, **recipes.job_plugins(dataset, job.method, job.scorer)}
    if lock.key_of(job.recipe) != job.key:
        changed = lock.words_of_edit(lock.edited(versions)) if lock.edited(versions) else "an edit was undone"
    elif (planned := {part: job.recipe.get(part) for part in now}) != now:
        changed = difference(planned, now)
    else:
        return
    raise _CodeChanged(f"the code changed during the run ({changed})", "run again")


@contextmanager
def _guarded(job: Job, store: Store, identifier: str = "") -> Iterator[None]:
    """Turn an error in the body into the record of the job."""
    where = f"{identifier}: " if identifier else ""
    try:
        yield
    except MemoryError:
        keep(job, store, failure("memory", f"{where}out of memory; run with fewer jobs (-j 1) or on a larger machine"))
    except _CodeChanged as error:
        keep(job, store, failure(CHANGED, str(error)))
    except StorageError as error:
        keep(job, store, failure(UNSAVED, f"{where}{error}"))
    except BenchmarkError as error:
        keep(job, store, failure("failed", f"{where}{message(error)}"))
    except ForeignError as error:
        keep(job, store, failure("failed", f"{where}{error}", error.trace))
    except ProcessEnded:
        raise  # the scheduler finds out which job is to blame
    except BaseException as error:  # including SystemExit: a method must not end the run
        if isinstance(error, KeyboardInterrupt) and not is_child():
            raise  # Ctrl-C with jobs that run in the main process
        keep(job, store, failure("failed", f"{where}{one_line(error)}", traceback.format_exc()))
