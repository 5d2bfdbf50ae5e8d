"""What a worker does: treat the shapes of a share, or rank a gallery and write its record."""

from __future__ import annotations

import multiprocessing
import statistics
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmark.contracts import Method
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError, message
from benchmark.jobs import recipes
from benchmark.jobs.orders import Order, Ranking, Share, Task
from benchmark.jobs.plan import CHANGED, UNSAVED, difference
from benchmark.jobs.preparation import Preparation
from benchmark.jobs.stages import distances, measures
from benchmark.jobs.treatment import Treated, Treatment, features_of
from benchmark.storage import keys
from benchmark.storage.costs import Cost
from benchmark.storage.records import Record
from benchmark.storage.store import StorageError, Store
from benchmark.system import fingerprints

__all__ = ["failure", "keep", "make_forms", "ranked", "work"]


class Tell(Protocol):
    """Told which job a worker is at, how many steps are behind it, and at which shape or part of a ranking it is."""

    def __call__(self, job: str, steps: int, shape: str = "") -> object: ...


def work(task: Task, tell: Tell) -> None:
    """Do a task; whatever goes wrong becomes the record of the job in which it went wrong.

    Parameters
    ----------
    task
        Shapes to treat, or a gallery to rank.
    tell
        Told before each step.
    """
    if isinstance(task, Ranking):
        for done, order in enumerate(task.orders):
            tell(order.key, done)
            _rank(order, lambda said, key=order.key, done=done: tell(key, done, said))  # type: ignore[misc]
    else:
        _treat(task, tell)


def keep(order: Order, store: Store, content: Mapping[str, Any]) -> Record:
    """Complete a record with what every record tells, and write it."""
    record = {
        **order.facts,
        "key": order.key,
        "recipe": keys.plain(order.recipe),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        **content,
    }
    store.write_record(record)
    return record


def failure(status: str, reason: str, trace: str = "") -> dict[str, Any]:
    """Content of the record of a job that brought no scores."""
    return {"status": status, "reason": reason, "traceback": trace}


# Shapes --------------------------------------------------------------------------------------------------------------


def _treat(share: Share, tell: Tell) -> None:
    """Treat each shape by all methods in turn; a job that has failed, here or in another share, is left alone."""
    first = share.orders[0]
    store = Store.open(first.results)
    treatments: dict[str, Treatment] = {}
    made: dict[str, list[str]] = {order.key: [] for order in share.orders}
    tell(first.key, 0)
    try:
        dataset = open_dataset(first.dataset, first.data_root)
    except Exception:
        for order in share.orders:
            with _guarded(order, store):
                raise
        return
    by_identifier = _by_identifier(dataset)
    preparation = Preparation(dataset, first.input, store)
    wanted = {order.key: frozenset(order.identifiers) for order in share.orders}
    for order in share.orders:
        tell(order.key, 0)
        with _guarded(order, store):
            _require_same_code(order, dataset)
            treatments[order.key] = _treatment(order, preparation, store)
    for done, identifier in enumerate(share.identifiers):
        for order in share.orders:
            if identifier not in wanted[order.key] or order.key not in treatments or order.key in store.records:
                continue
            tell(order.key, done, identifier)
            with _guarded(order, store, identifier):
                try:
                    found = treatments[order.key].treat(by_identifier[identifier])
                except ShapeError:
                    continue  # ranking finds the reason in the store
                made[order.key] += [
                    a.key for a in (found.prepared, found.answer, found.features) if a and not a.was_cached
                ]
    fingerprints.forget()
    for order in share.orders:
        if order.key in store.records:
            continue
        tell(order.key, len(share.identifiers))
        with _guarded(order, store):
            try:
                _require_same_code(order, dataset)
            except _CodeChanged:
                for key in made[order.key]:
                    store.discard(key)  # nobody knows which of the two codes made it
                raise


def _treatment(order: Order, preparation: Preparation, store: Store) -> Treatment:
    treatment = Treatment(preparation, store, order.method, order.seed, order.models, order.scorer)
    if not isinstance(treatment.method, Method):
        return treatment
    seen = treatment.seen(_entries(order, preparation.dataset), preparation.dataset.name)
    if seen and order.all_unseen:
        raise ConfigurationError(
            f"{len(seen)} shapes were seen in training: {', '.join(seen[:3])}{' ...' if len(seen) > 3 else ''}",
            "test on shapes that the model has not been trained on, or take another training",
        )
    return treatment


class _CodeChanged(BenchmarkError):
    """Somebody edited the code while a run was under way."""


def _require_same_code(order: Order, dataset: Dataset) -> None:
    """Raise unless this process reads the code that the plan was made for."""
    found = keys.plain(recipes.job_code(recipes.dataset_module(dataset), order.input, order.method, order.scorer))
    planned = keys.plain(order.recipe["code"])
    if found != planned:
        changed = difference({"code": planned}, {"code": found})
        raise _CodeChanged(f"the code changed during the run ({changed})", "run again")


@contextmanager
def _guarded(order: Order, store: Store, identifier: str = "") -> Iterator[None]:
    """Turn whatever the body raises into the record of the job."""
    where = f"{identifier}: " if identifier else ""
    try:
        yield
    except MemoryError:
        keep(
            order, store, failure("memory", f"{where}out of memory; run with fewer jobs (-j 1) or on a larger machine")
        )
    except _CodeChanged as error:
        keep(order, store, failure(CHANGED, str(error)))
    except StorageError as error:
        keep(order, store, failure(UNSAVED, f"{where}{error}"))
    except BenchmarkError as error:
        keep(order, store, failure("failed", f"{where}{message(error)}"))
    except BaseException as error:  # also what ends a program: a method must not end the run
        if isinstance(error, KeyboardInterrupt) and multiprocessing.parent_process() is None:
            raise  # somebody interrupts jobs that are done in this process
        said = message(error)
        reason = f"{where}{type(error).__name__}: {said}" if said else f"{where}{type(error).__name__}"
        keep(order, store, failure("failed", reason, traceback.format_exc()))


def make_forms(order: Order, identifiers: Iterable[str], say: Callable[[str], None]) -> None:
    """Make the forms of some shapes of a job and keep them; of a shape that cannot be treated, the reason is kept.

    Parameters
    ----------
    order
        The job.
    identifiers
        The shapes.
    say
        Told each shape when it is done.
    """
    store = Store.open(order.results)
    dataset = open_dataset(order.dataset, order.data_root)
    treatment = _treatment(order, Preparation(dataset, order.input, store), store)
    by_identifier = _by_identifier(dataset)
    for identifier in identifiers:
        with suppress(ShapeError):
            treatment.answer(by_identifier[identifier])
        say(identifier)


# Galleries -----------------------------------------------------------------------------------------------------------


def _rank(order: Order, tell: Callable[[str], object]) -> None:
    store = Store.open(order.results)
    with _guarded(order, store):
        keep(order, store, ranked(order, store, tell))


def ranked(order: Order, store: Store, tell: Callable[[str], object] = lambda said: None) -> dict[str, Any]:
    """Return the content of the record of a job whose shapes are treated.

    Parameters
    ----------
    order
        The job.
    store
        Where its forms and signatures are; what is missing is made.
    tell
        Told which part of the ranking is under way.
    """
    start = time.perf_counter()
    dataset = open_dataset(order.dataset, order.data_root)
    _require_same_code(order, dataset)
    entries = _entries(order, dataset)
    treatment = _treatment(order, Preparation(dataset, order.input, store), store)
    found: dict[str, Treated] = {}
    refused: list[tuple[str, str]] = []
    for entry in entries:
        try:
            found[entry.identifier] = treatment.found(entry)
        except ShapeError as error:
            refused.append((entry.identifier, str(error)))
    kept = [entry for entry in entries if entry.identifier in found]
    labels = [entry.subject for entry in kept]
    if len(set(labels)) < 2 or len(set(labels)) == len(labels):
        reason = f"{len(kept)} of {len(entries)} shapes could be treated, too few to rank; first: {refused[0][1]}"
        return failure("unsupported", reason) | {"unsupported": refused}
    gallery = _Gallery(store, treatment, kept, found, tell)
    treated = list(found.values())
    return {
        "status": "ok",
        **measures.scores(gallery.matrices(), labels),
        **(measures.over_splits(gallery.matrices(), labels, order.split_size) if order.split_size else {}),
        "shapes": [entry.identifier for entry in kept],
        "labels": labels,
        "n_shapes": len(kept),
        "n_classes": len(set(labels)),
        "unsupported": refused,
        "notes": _summary(each.notes for each in treated),
        **_costs(treated),
        "wall_seconds": round(time.perf_counter() - start, 3),
        "environments": _environments(treated),
        "artefacts": sorted(
            {a.key for t in treated for a in (t.prepared, t.answer)}
            | {key for key in (*gallery.keys, treatment.preparation.frame_key) if key}
        ),
        **_learning(order, treatment, entries, dataset.name),
    }


class _Gallery:
    """Distances of a gallery, one draw of the scorer at a time.

    Of the distances, which are large, one matrix is held at a time.

    Parameters
    ----------
    store, treatment, entries
        The shapes.
    found
        What became of them; the arrays of their signatures are taken out.
    tell
        Told which draw is under way.
    """

    def __init__(
        self,
        store: Store,
        treatment: Treatment,
        entries: Sequence[Entry],
        found: dict[str, Treated],
        tell: Callable[[str], object],
    ) -> None:
        self._store, self._treatment, self._tell = store, treatment, tell
        forms = [treatment.recipe(entry) for entry in entries]
        draws: Sequence[int | None] = (None,) if treatment.describes else range(treatment.scorer.info.draws)
        self._recipes = {draw: recipes.distances_recipe(forms, treatment.scorer_spec, draw) for draw in draws}
        #: Names of the distances in the store.
        self.keys = [keys.digest(recipe) for recipe in self._recipes.values()]
        if treatment.describes:
            self._descriptors = [found[entry.identifier].answer.arrays["descriptor"] for entry in entries]
            return
        self._signatures = [features_of(found[entry.identifier]) for entry in entries]
        for identifier, each in found.items():
            found[identifier] = replace(each, features=each.features and replace(each.features, arrays={}))

    def matrices(self) -> Iterator[NDArray[Any]]:
        """The distances under each draw, shape (N, N) each."""
        yield from map(self._matrix, self._recipes)

    def _matrix(self, draw: int | None) -> NDArray[Any]:
        def compute() -> Mapping[str, NDArray[Any]]:
            method = self._treatment.method
            if draw is None:
                assert not isinstance(method, Method)  # noqa: S101
                return {"distances": distances.descriptor_distances(method, self._descriptors)}
            self._tell(f"comparing {len(self._signatures)} forms, {draw + 1} of {len(self._recipes)}")
            return {"distances": distances.form_distances(self._treatment.scorer, self._signatures, draw)}

        return self._store.get_or_compute(self._recipes[draw], compute, work="rank").arrays["distances"]


def _learning(order: Order, treatment: Treatment, entries: Iterable[Entry], dataset: str) -> dict[str, Any]:
    """What the record of a learner tells: its models, and which shapes they had seen; nothing for other methods."""
    if not order.models:
        return {}
    models = {model.training: model.summary() for model in order.models.values()}
    return {"models": list(models.values()), "seen": treatment.seen(entries, dataset)}


def _costs(treated: Sequence[Treated]) -> dict[str, Any]:
    """Seconds a shape by phase and memory of a form, without the first shape of each process where others are."""
    phases: dict[str, list[Cost]] = {}
    for each in treated:
        phases.setdefault("prepare", []).append(each.prepared.cost)
        for stage, cost in each.answer.cost.shared.items():
            phases.setdefault(stage, []).append(cost)
        phases.setdefault("canonicalise", []).append(each.answer.cost)
        if each.features is not None:
            phases.setdefault("features", []).append(each.features.cost)
    seconds = {
        phase: round(statistics.median(c.seconds for c in _settled(costs)), 4) for phase, costs in phases.items()
    }
    peaks = [cost.peak_mib for cost in _settled(phases["canonicalise"]) if cost.peak_mib is not None]
    return {
        "cost": {"seconds_per_shape": seconds, "shapes_timed": len(_settled(phases["canonicalise"]))},
        "peak_mib": round(max(peaks), 1) if peaks else None,
    }


def _settled(costs: Sequence[Cost]) -> list[Cost]:
    """Costs without those of first uses, which compile and load; all of them where there are no others."""
    return [cost for cost in costs if not cost.first_use] or list(costs)


def _environments(treated: Sequence[Treated]) -> list[dict[str, Any]]:
    """Where the artefacts were made: each environment with the number of artefacts."""
    counts = Counter(a.environment for t in treated for a in (t.prepared, t.answer, t.features) if a is not None)
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


def _entries(order: Order, dataset: Dataset) -> list[Entry]:
    by_identifier = _by_identifier(dataset)
    return [by_identifier[identifier] for identifier in order.identifiers]
