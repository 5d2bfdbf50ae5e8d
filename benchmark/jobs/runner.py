"""One job: a method on a gallery, from shapes to a record."""

from __future__ import annotations

import datetime
import platform
import resource
import sys
import time
import traceback
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.contracts import Descriptor, Input
from benchmark.datasets.base import Entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError
from benchmark.jobs.plan import Job
from benchmark.jobs.stages import CODEBOOK_SEEDS, SCORER, Stages
from benchmark.methods.registry import MethodSpec
from benchmark.protocols.models import Maker, Model
from benchmark.storage import keys
from benchmark.storage.store import Store
from retrieval.chance import chance_levels
from retrieval.cmbof import CMBOF
from retrieval.metrics import evaluate

#: Packages whose versions can move a result.
ENVIRONMENT = ("numpy", "scipy", "numba", "libigl", "pymeshlab", "potpourri3d", "torch", "anny")

#: Measures by the name they have in tables, and the attributes of ``Scores`` and of its ``per_query``.
MEANS = {"NN": "nn", "FT": "ft", "ST": "st", "DCG": "dcg", "E": "e", "nDCG": "ndcg", "mAP": "mean_ap"}
PER_QUERY = MEANS | {"mAP": "ap"}

Matrix = NDArray[np.float64]
Treat = Callable[[Entry], tuple[Any, Mapping[str, float | str]]]
Match = Callable[[list[Entry], list[Any]], list[Matrix]]


@dataclass(frozen=True)
class Order:
    """Everything that a worker needs to do a job, in plain data that travels between processes."""

    key: str
    gallery: str
    dataset: str
    data_root: Path | None
    identifiers: tuple[str, ...]
    input: Input
    method: MethodSpec
    seed: int
    results: Path
    recipe: Mapping[str, Any]
    models: Mapping[str, Model]
    all_unseen: bool

    @classmethod
    def of(cls, job: Job, results: Path, data_root: Path | None, seed: int) -> Order:
        """Write the order for a job of the plan."""
        return cls(
            key=job.key,
            gallery=job.gallery.name,
            dataset=job.gallery.source,
            data_root=data_root,
            identifiers=tuple(entry.identifier for entry in job.gallery.entries),
            input=job.input,
            method=job.method,
            seed=seed,
            results=results,
            recipe=job.recipe,
            models=job.models,
            all_unseen=job.gallery.table.all_unseen,
        )

    @property
    def name(self) -> str:
        """Data set, input and method, as people name a job."""
        return f"{self.gallery} {self.input} {self.method.name}"


def run(order: Order) -> dict[str, Any]:
    """Do a job and keep its record, whatever happens.

    Parameters
    ----------
    order
        The job.

    Returns
    -------
    dict
        The record. Its ``status`` is ``ok``; ``unsupported`` when too few shapes could be treated; ``memory`` or
        ``failed`` with the traceback when the method broke.
    """
    store = Store.open(order.results)
    start = time.perf_counter()
    try:
        content = _run(order, store)
    except MemoryError:
        content = failure("memory", "out of memory; run with fewer jobs (-j 1) or on a larger machine")
    except BenchmarkError as error:
        content = failure("failed", str(error))
    except Exception as error:
        content = failure("failed", f"{type(error).__name__}: {error}", traceback.format_exc())
    return keep(order, store, content, time.perf_counter() - start)


def keep(order: Order, store: Store, content: Mapping[str, Any], wall_seconds: float) -> dict[str, Any]:
    """Complete a record with what every record tells, and write it."""
    record = {
        "key": order.key,
        "gallery": order.gallery,
        "input": order.input,
        "method": order.method.name,
        "recipe": keys.plain(order.recipe),
        "environment": environment(),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "wall_seconds": round(wall_seconds, 3),
        **content,
    }
    store.write_record(order.key, record)
    store.forget_progress(order.key)
    return record


def failure(status: str, reason: str, trace: str = "") -> dict[str, Any]:
    """Content of the record of a job that brought no scores."""
    return {"status": status, "reason": reason, "traceback": trace}


@cache
def environment() -> dict[str, str]:
    """Versions that can move a result."""
    found = {"python": platform.python_version(), "machine": platform.machine(), "system": platform.system()}
    for name in ENVIRONMENT:
        try:
            found[name] = version(name)
        except ImportError:
            continue
    return found


def _run(order: Order, store: Store) -> dict[str, Any]:
    dataset = open_dataset(order.dataset, order.data_root)
    by_identifier = {entry.identifier: entry for entry in dataset.entries}
    entries = [by_identifier[identifier] for identifier in order.identifiers]
    stages = Stages(store, dataset, order.input, order.seed, CMBOF())
    method = order.method.create()

    learning: dict[str, Any] = {}
    if isinstance(method, Descriptor):
        treat, match = _describing(method, stages)
    else:
        maker = Maker(order.method, method, order.models)
        learning = _learning(order, maker, entries, dataset.name)
        treat, match = _extracting(order, store, maker, stages)
    results, unsupported, notes = _treat_all(order, store, entries, treat)
    kept = [entry for entry in entries if entry.identifier in results]
    labels = [entry.subject for entry in kept]
    if len(set(labels)) < 2 or len(set(labels)) == len(labels):
        reason = f"{len(kept)} of {len(entries)} shapes could be treated, too few to rank; first: {unsupported[0][1]}"
        return failure("unsupported", reason) | {"unsupported": unsupported}

    matrices = match(kept, [results[entry.identifier] for entry in kept])
    evaluations = [evaluate(matrix, labels) for matrix in matrices]
    return {
        "status": "ok",
        "scores": {
            name: float(np.mean([getattr(e, attribute) for e in evaluations])) for name, attribute in MEANS.items()
        },
        "spread": {
            name: float(np.std([getattr(e, attribute) for e in evaluations])) for name, attribute in MEANS.items()
        },
        "per_query": {
            name: [None if np.isnan(value) else round(float(value), 6) for value in np.mean(values, axis=0)]
            for name, attribute in PER_QUERY.items()
            for values in [[getattr(e.per_query, attribute) for e in evaluations]]
        },
        "tied_queries": max(e.tied_queries for e in evaluations),
        "lone_queries": evaluations[0].lone_queries,
        "chance": chance_levels(labels),
        "shapes": [entry.identifier for entry in kept],
        "labels": labels,
        "n_shapes": len(kept),
        "n_classes": len(set(labels)),
        "unsupported": unsupported,
        "notes": notes,
        "phase_seconds": {phase: round(seconds, 4) for phase, seconds in stages.clock.seconds.items()},
        "from_cache": stages.clock.cached,
        "peak_mib": _peak_mib(),
        **learning,
    }


def _learning(order: Order, maker: Maker, entries: Iterable[Entry], dataset: str) -> dict[str, Any]:
    """What the record of a learner tells: its models, and which shapes they had seen; nothing for other methods."""
    if not order.models:
        return {}
    seen = maker.seen(entries, dataset)
    if seen and order.all_unseen:
        raise ConfigurationError(
            f"{len(seen)} shapes were seen in training: {', '.join(seen[:3])}{' ...' if len(seen) > 3 else ''}",
            "test on shapes that the model has not been trained on, or take another training",
        )
    models = {model.training: model.summary() for model in order.models.values()}
    return {"models": list(models.values()), "seen": seen}


def _extracting(order: Order, store: Store, maker: Maker, stages: Stages) -> tuple[Treat, Match]:
    """How a method's forms become features, and features distances."""

    def treat(entry: Entry) -> tuple[Any, Mapping[str, float | str]]:
        form, notes = stages.form(entry, maker)
        return stages.features(entry, maker, form), {**stages.preparation_notes(entry), **notes}

    def match(entries: list[Entry], features: list[Any]) -> list[Matrix]:
        return [_score(order, store, stages, maker, entries, features, seed) for seed in CODEBOOK_SEEDS]

    return treat, match


def _describing(method: Descriptor, stages: Stages) -> tuple[Treat, Match]:
    """How a descriptor treats a shape, and compares."""

    def treat(entry: Entry) -> tuple[Any, Mapping[str, float | str]]:
        descriptor = np.asarray(method.describe(stages.shape(entry)), dtype=np.float64)
        return descriptor, stages.preparation_notes(entry)

    def match(_: list[Entry], descriptors: list[Any]) -> list[Matrix]:
        return [np.asarray(method.distances(descriptors), dtype=np.float64)]

    return treat, match


def _treat_all(
    order: Order, store: Store, entries: list[Entry], treat: Treat
) -> tuple[dict[str, Any], list[tuple[str, str]], dict[str, dict[str, float]]]:
    """Treat every shape; those that cannot be treated are listed with the reason.

    Jobs start at different shapes, so that two jobs side by side share the stages that both need instead of doing them
    twice. The order changes no result.
    """
    results: dict[str, Any] = {}
    unsupported: list[tuple[str, str]] = []
    notes: dict[str, Mapping[str, float | str]] = {}
    offset = zlib.crc32(order.method.name.encode()) % len(entries)
    for done, entry in enumerate(entries[offset:] + entries[:offset]):
        store.report_progress(order.key, done, len(entries))
        try:
            results[entry.identifier], notes[entry.identifier] = treat(entry)
        except ShapeError as error:
            unsupported.append((entry.identifier, str(error)))
    place = {entry.identifier: i for i, entry in enumerate(entries)}
    unsupported.sort(key=lambda pair: place[pair[0]])
    return results, unsupported, _summary(notes[entry.identifier] for entry in entries if entry.identifier in notes)


def _summary(notes: Iterable[Mapping[str, float | str]]) -> dict[str, Any]:
    """Mean and largest value of each numeric note, and counts of each text."""
    collected: dict[str, list[float | str]] = {}
    for note in notes:
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


def _score(
    order: Order, store: Store, stages: Stages, maker: Maker, entries: list[Entry], features: list[Any], seed: int
) -> Matrix:
    """Distance matrix of the gallery under the codebook of one seed."""
    recipe = {
        "stage": "distances",
        "job": {part: value for part, value in order.recipe.items() if part != "code"},
        "forms": [stages.form_recipe(entry, maker) for entry in entries],
        "codebook": seed,
        "code": keys.code_digest(SCORER),
    }

    def compute() -> dict[str, NDArray[Any]]:
        codebook = stages.scorer.train_codebook(features, seed)
        signatures = [stages.scorer.quantise(feature, codebook) for feature in features]
        return {"distances": stages.scorer.distances(signatures)}

    return stages.clock.add("match", store.get_or_compute(recipe, compute))["distances"]


def _peak_mib() -> int:
    """Largest resident memory of this process so far; the job's own where each job has a fresh process."""
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit)
