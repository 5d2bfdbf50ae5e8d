"""Work of a worker: run methods on the shapes of a batch, or rank a gallery and write its record."""

from __future__ import annotations

import statistics
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import Any, Protocol

import numpy as np

from benchmark.api.contracts import Method
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError, message
from benchmark.execution.job_specs import ComparisonTask, Job, ScoringTask, ShapeBatch, Task, job_of
from benchmark.execution.plan import CHANGED, UNSAVED, difference
from benchmark.execution.processes.process import ForeignError, is_child
from benchmark.pipeline import recipes
from benchmark.pipeline.gallery import RankedGallery, Signatures, settled
from benchmark.pipeline.method_run import MethodRun, ShapeResult, files_of
from benchmark.pipeline.preparation import Preparation
from benchmark.pipeline.stages import measures
from benchmark.pipeline.storage import keys, lock
from benchmark.pipeline.storage.costs import Cost
from benchmark.pipeline.storage.environment import commit
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import StorageError, Store
from benchmark.plugins.remote import close_to_plugins

__all__ = ["failure", "keep", "make_forms", "ranked", "work"]


class Tell(Protocol):
    """Told which job a worker is at, how many steps are behind it, and at which shape or part of a ranking it is."""

    def __call__(self, job: str, steps: int, shape: str = "") -> object: ...


def work(task: Task, tell: Tell) -> None:
    """Do a task; whatever goes wrong becomes the record of the job in which it went wrong.

    Parameters
    ----------
    task
        Shapes to treat, a gallery to rank, or one to compare for that.
    tell
        Told before each step.
    """
    if isinstance(task, ScoringTask):
        for done, job in enumerate(task.jobs):
            tell(job.key, done)
            _rank(job, lambda said, key=job.key, done=done: tell(key, done, said))  # type: ignore[misc]
    elif isinstance(task, ComparisonTask):
        (job,) = task.jobs
        tell(job.key, 0)
        _compare(job, task.draw, lambda said: tell(job.key, 0, said))
    else:
        _treat(task, tell)


def keep(job: Job, store: Store, content: Mapping[str, Any]) -> Record:
    """Complete a record with what every record tells, and write it."""
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
    """Content of the record of a job that brought no scores."""
    return {"status": status, "reason": reason, "traceback": trace}


# Shapes --------------------------------------------------------------------------------------------------------------


def _treat(batch: ShapeBatch, tell: Tell) -> None:
    """Treat each shape by all methods in turn; a job that has failed, here or in another batch, is left alone."""
    first = batch.jobs[0]
    store = Store.open(first.results)
    method_runs: dict[str, MethodRun] = {}
    made: dict[str, list[str]] = {job.key: [] for job in batch.jobs}
    tell(first.key, 0)
    try:
        dataset = open_dataset(first.dataset, first.data_root)
    except Exception:
        for job in batch.jobs:
            with _guarded(job, store):
                raise
        return
    by_identifier = _by_identifier(dataset)
    preparation = Preparation(dataset, first.input, store)
    wanted = {job.key: frozenset(job.identifiers) for job in batch.jobs}
    for job in batch.jobs:
        tell(job.key, 0)
        with _guarded(job, store):
            _require_same_code(job, dataset)
            method_runs[job.key] = _method_run(job, preparation, store)
    for done, identifier in enumerate(batch.identifiers):
        for job in batch.jobs:
            if identifier not in wanted[job.key] or job.key not in method_runs or job.key in store.records:
                continue
            tell(job.key, done, identifier)
            with _guarded(job, store, identifier):
                try:
                    found = method_runs[job.key].treat(by_identifier[identifier])
                except ShapeError:
                    continue  # ranking finds the reason in the store
                made[job.key] += [
                    a.key for a in (found.prepared, found.answer, found.features) if a and not a.was_cached
                ]
    lock.forget()
    for job in batch.jobs:
        if job.key in store.records:
            continue
        tell(job.key, len(batch.identifiers))
        with _guarded(job, store):
            try:
                _require_same_code(job, dataset)
            except _CodeChanged:
                for key in made[job.key]:
                    store.discard(key)  # nobody knows which of the two codes made it
                raise


def _method_run(job: Job, preparation: Preparation, store: Store) -> MethodRun:
    method_run = MethodRun(preparation, store, job.method, job.seed, job.model_of, job.scorer)
    if not isinstance(method_run.method, Method):
        return method_run
    seen = method_run.seen(_entries(job, preparation.dataset), preparation.dataset.name)
    if seen and job.all_unseen:
        raise ConfigurationError(
            f"{len(seen)} shapes were seen in training: {', '.join(seen[:3])}{' ...' if len(seen) > 3 else ''}",
            "test on shapes that the model has not been trained on, or take another training",
        )
    return method_run


class _CodeChanged(BenchmarkError):
    """Somebody edited the code while a run was under way."""


def _require_same_code(job: Job, dataset: Dataset) -> None:
    """Raise unless this process reads the code that the plan was made for."""
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
    """Turn whatever the body raises into the record of the job."""
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
    except BaseException as error:  # also what ends a program: a method must not end the run
        if isinstance(error, KeyboardInterrupt) and not is_child():
            raise  # somebody interrupts jobs that are done in this process
        said = message(error)
        reason = f"{where}{type(error).__name__}: {said}" if said else f"{where}{type(error).__name__}"
        keep(job, store, failure("failed", reason, traceback.format_exc()))


def make_forms(description: str, identifiers: Iterable[str], say: Callable[[str], None]) -> None:
    """Make the forms of some shapes of a job and keep them, in a process of its own.

    Of a shape that cannot be treated, the reason is kept.

    Parameters
    ----------
    description
        The job, as :func:`benchmark.execution.job_specs.to_json` writes it.
    identifiers
        The shapes.
    say
        Told each shape when it is done.
    """
    close_to_plugins()
    job = job_of(description)
    store = Store.open(job.results)
    dataset = open_dataset(job.dataset, job.data_root)
    method_run = _method_run(job, Preparation(dataset, job.input, store), store)
    by_identifier = _by_identifier(dataset)
    for identifier in identifiers:
        with suppress(ShapeError):
            method_run.answer(by_identifier[identifier])
        say(identifier)


# Galleries -----------------------------------------------------------------------------------------------------------


def _rank(job: Job, tell: Callable[[str], object]) -> None:
    store = Store.open(job.results)
    with _guarded(job, store):
        keep(job, store, ranked(job, store, tell))


def _compare(job: Job, draw: int | None, tell: Callable[[str], object]) -> None:
    """Keep what ranking will read of one draw; only what goes wrong becomes a record."""
    store = Store.open(job.results)
    with _guarded(job, store):
        _, gallery = _gallery(job, store, tell)
        if gallery.found:
            gallery.compared(draw)


def _gallery(job: Job, store: Store, tell: Callable[[str], object]) -> tuple[list[Entry], RankedGallery]:
    """All shapes of a job, and those of them that can be ranked."""
    dataset = open_dataset(job.dataset, job.data_root)
    _require_same_code(job, dataset)
    entries = _entries(job, dataset)
    method_run = _method_run(job, Preparation(dataset, job.input, store), store)
    return entries, RankedGallery.of(store, method_run, entries, tell)


def ranked(job: Job, store: Store, tell: Callable[[str], object] = lambda said: None) -> dict[str, Any]:
    """Return the content of the record of a job whose shapes are treated.

    Parameters
    ----------
    job
        The job.
    store
        Where its forms and signatures are; what is missing is made.
    tell
        Told which part of the ranking is under way.
    """
    start = time.perf_counter()
    entries, gallery = _gallery(job, store, tell)
    refused, names = gallery.refused, [entry.identifier for entry in entries]
    if not gallery.found:
        reason = f"none of {len(entries)} shapes could be treated; first: {refused[0][1]}"
        return failure("unsupported", reason) | {"unsupported": refused}
    labels = [entry.subject for entry in entries]
    answered = [place for place, name in enumerate(names) if name in gallery.found] if refused else None
    results = list(gallery.found.values())
    scored = measures.scores(gallery.matrices(), labels, answered)
    if job.split_size:
        scored |= measures.over_splits(gallery.matrices(), labels, job.split_size, answered)
    return {
        "status": "ok",
        **scored,
        "shapes": names,
        "labels": labels,
        "n_shapes": len(entries),
        "n_classes": len(set(labels)),
        "unsupported": refused,
        "unprepared": gallery.unprepared,
        "coverage": len(gallery.found) / max(len(entries) - len(gallery.unprepared), 1),
        "digests": gallery.digests,
        "notes": _summary(each.notes for each in results),
        **_costs(results, gallery.signatures),
        "wall_seconds": round(time.perf_counter() - start + gallery.seconds_before, 3),
        "environments": _environments(results, gallery.signatures),
        "artefacts": sorted(
            {a.key for t in results for a in (t.prepared, t.answer)}
            | {key for key in (*gallery.keys, gallery.method_run.preparation.frame_key) if key}
        ),
        **_files(results, gallery),
        **_learning(job, gallery.method_run, entries),
    }


def _files(results: Sequence[ShapeResult], gallery: RankedGallery) -> dict[str, Any]:
    """Return the part of a record that names the files that plugins have read; empty where they read none."""
    artefacts = [a for result in results for a in (result.prepared, result.answer, result.features) if a]
    files: dict[str, str] = {}
    for part in (*(artefact.files for artefact in artefacts), files_of(gallery.scorer)):
        files |= part
    return {"files": files} if files else {}


def _learning(job: Job, method_run: MethodRun, entries: Iterable[Entry]) -> dict[str, Any]:
    """Return the part of a learner's record: its models, and which shapes they had seen; empty for other methods."""
    if not job.models:
        return {}
    seen = method_run.seen(entries, method_run.preparation.dataset.name)
    return {"models": [model.summary() for model in job.models.values()], "seen": seen}


def _costs(results: Sequence[ShapeResult], signatures: Signatures) -> dict[str, Any]:
    """Seconds a shape by phase and memory of a form, without the first shape of each process where others are."""
    phases: dict[str, list[Cost]] = {}
    for each in results:
        phases.setdefault("prepare", []).append(each.prepared.cost)
        for stage, cost in each.answer.cost.shared.items():
            phases.setdefault(stage, []).append(cost)
        phases.setdefault("canonicalise", []).append(each.answer.cost)
    seconds = {phase: round(statistics.median(c.seconds for c in settled(costs)), 4) for phase, costs in phases.items()}
    if signatures.environments:
        seconds["features"] = signatures.seconds
    peaks = [cost.peak_mib for cost in settled(phases["canonicalise"]) if cost.peak_mib is not None]
    return {
        "cost": {"seconds_per_shape": seconds, "shapes_timed": len(settled(phases["canonicalise"]))},
        "peak_mib": round(max(peaks), 1) if peaks else None,
    }


def _environments(results: Sequence[ShapeResult], signatures: Signatures) -> list[dict[str, Any]]:
    """Return where the artefacts were made: each environment with the number of artefacts."""
    counts = Counter(a.environment for t in results for a in (t.prepared, t.answer)) + Counter(signatures.environments)
    return [{"environment": text, "artefacts": count} for text, count in sorted(counts.items())]


def _summary(all_notes: Iterable[Mapping[str, float | str]]) -> dict[str, Any]:
    """Mean and largest value of each numeric note, and counts of each text."""
    collected: dict[str, list[float | str]] = {}
    for note in all_notes:
        for name, value in note.items():
            collected.setdefault(name, []).append(value)
    summary: dict[str, Any] = {}
    for name, values in sorted(collected.items()):
        if all(isinstance(value, (int, float)) for value in values):
            numbers = np.asarray(values, dtype=np.float64)
            summary[name] = (
                {"mean": float(numbers.mean()), "max": float(numbers.max())} if np.isfinite(numbers).all() else None
            )
        else:
            summary[name] = {str(value): values.count(value) for value in values}
    return summary


def _by_identifier(dataset: Dataset) -> dict[str, Entry]:
    return {entry.identifier: entry for entry in dataset.entries}


def _entries(job: Job, dataset: Dataset) -> list[Entry]:
    by_identifier = _by_identifier(dataset)
    return [by_identifier[identifier] for identifier in job.identifiers]
