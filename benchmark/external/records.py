"""External rows: records of results of other programs, next to those of the suite."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry
from benchmark.arrays import Arrays, digest_of
from benchmark.datasets.base import Watched
from benchmark.datasets.catalogue import is_known
from benchmark.errors import ConfigurationError, ShapeError, UnsupportedShape
from benchmark.execution.plan import data_facts, data_recipe
from benchmark.external.files import Labels
from benchmark.external.scoring import Task
from benchmark.files import file_digest
from benchmark.geometry.io import READABLE, read_mesh
from benchmark.pipeline import recipes
from benchmark.pipeline.method_run import attempted, require_arrays
from benchmark.pipeline.stages import measures
from benchmark.pipeline.storage.keys import digest, plain
from benchmark.pipeline.storage.lock import key_of, versions_of
from benchmark.pipeline.storage.records import DEFAULT_SCORER, EXTERNAL, NO_SCORER, Record
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.output_checks import form_distances, signature_of
from benchmark.plugins.specs import ScorerSpec
from benchmark.protocols.galleries import Gallery
from benchmark.text import LONGEST_NAME
from retrieval.chance import chance_levels


def method_name(title: str) -> str:
    """Return the method name of an external row; no method of the suite can have it."""
    plain = title.lower().replace(" ", "-")
    name = f"{EXTERNAL}-{re.sub('[^a-z0-9]+', '-', plain).strip('-')}"
    if name == f"{EXTERNAL}-{plain}" and len(name) <= LONGEST_NAME:
        return name
    return f"{name[: LONGEST_NAME - 7].rstrip('-')}-{digest(title)[:6]}"  # titles may differ in other characters only


def _store(
    store: Store,
    data: Mapping[str, Any],
    gallery: str,
    title: str,
    recipe: Mapping[str, Any],
    scored: Mapping[str, Any],
) -> Record:
    """Store the record of an external row, and return it.

    Parameters
    ----------
    store
        The store.
    data, gallery
        The shapes, as in other records.
    title
        Title of the row.
    recipe
        Everything that determines the scores.
    scored
        ``scores``, ``per_query``, ``shapes``, ``labels`` and other facts of a finished job.
    """
    labels = scored["labels"]
    record = {
        "key": key_of(recipe),
        "gallery": gallery,
        "input": recipe["input"],
        "method": method_name(title),
        "title": title,
        "family": EXTERNAL,
        "parameters": {},
        "target": "",
        "data": dict(data),
        "recipe": dict(recipe),
        "status": "ok",
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "n_shapes": len(labels),
        "n_classes": len(set(labels)),
        "unsupported": [],
        "coverage": 1.0,
        "cost": {"seconds_per_shape": {}},
        **scored,
    }
    store.write_record(record)
    return record


# Distances -----------------------------------------------------------------------------------------------------------


def keep_distances(store: Store, task: Task, title: str, dataset: str, input_: Input) -> Record:
    """Store a square matrix with one label per shape as an external row.

    Raises
    ------
    ConfigurationError
        If it does not rank each shape against all others, or its shapes differ from those of the other rows of the data
        set.
    """
    if not task.is_square or any(len(classes) > 1 for classes in task.queries.classes):
        raise ConfigurationError(
            "rows of tables rank shapes with one label against each other", "omit --results to score this matrix"
        )
    beside = _beside(store, dataset, input_, method_name(title))
    if beside is None and is_known(dataset):
        raise ConfigurationError(
            f"no row of '{dataset}' is here, so its shapes are unknown", "run a method on it first, or omit --dataset"
        )
    labels = [classes[0] for classes in task.queries.classes]
    names = _names(beside, task.queries, labels)
    gallery, data = (beside["gallery"], beside["data"]) if beside else (dataset, own_data(dataset, labels))
    arrays = {"distances": task.values}
    recipe = {"stage": "distances", EXTERNAL: digest_of(arrays), "title": title, "versions": {}}
    artefact = store.get_or_compute(recipe, lambda: arrays)
    of_row = {
        "input": input_,
        "method": method_name(title),
        "gallery": digest([gallery, *zip(names, labels, strict=True)]),
        EXTERNAL: artefact.digest,
        "versions": versions_of(["measures"]),
    }
    scored = measures.scores([list(task.values)], labels)  # row by row, because the matrix may be asymmetric
    del scored["codebook_deviation"]
    scored |= {"scorer": NO_SCORER, "shapes": names, "labels": labels, "artefacts": [artefact.key]}
    return _store(store, data, gallery, title, of_row, scored)


def own_data(dataset: str, labels: Sequence[str]) -> dict[str, Any]:
    """Return the facts of a record on shapes that the suite does not have."""
    return {
        "name": dataset,
        "title": dataset,
        "stand_in_for": "",
        "source": dataset,
        "module": "",
        "quick": False,
        "n_shapes": len(labels),
        "n_classes": len(set(labels)),
        "chance": chance_levels(labels),
    }


def _beside(store: Store, dataset: str, input_: Input, method: str) -> Record | None:
    """Return the newest of the records next to which an external row is shown; None if there is none."""
    records = [
        record
        for record in store.all_records()
        if record["status"] == "ok" and record["input"] == input_ and not record["data"]["quick"]
        and dataset in (record["gallery"], record["data"]["name"]) and record["method"] != method
    ]  # fmt: skip
    # A gallery of this name is preferred to others of its data set, such as a held-out part.
    records = [record for record in records if record["gallery"] == dataset] or records
    galleries = {record["gallery"] for record in records}
    if len(galleries) > 1:
        raise ConfigurationError(
            f"the rows of '{dataset}' are of several galleries",
            f"choose one with --dataset: {', '.join(sorted(galleries))}",
        )
    return records[-1] if records else None


def _names(beside: Record | None, shapes: Labels, labels: Sequence[str]) -> list[str]:
    """Return the names of the shapes as in the other rows."""
    names = list(shapes.names)
    if beside is None:
        return names or [str(place) for place in range(1, len(labels) + 1)]
    if not names and labels == beside["labels"]:
        return list(beside["shapes"])
    known = dict(zip(beside["shapes"], beside["labels"], strict=True))
    if dict(zip(names, labels, strict=False)) != known:
        other = [name for name, label in zip(names, labels, strict=False) if known.get(name) != label]
        what = f"the first that differs is '{other[0]}'" if other else f"they are {len(labels)}, not {len(known)}"
        example = f"{beside['shapes'][0]} {beside['labels'][0]}"
        hint = f"name them with their labels as there ({example}, ...), or name another --dataset"
        raise ConfigurationError(f"the shapes are not those of '{beside['gallery']}': {what}", hint)
    return names


# Forms ---------------------------------------------------------------------------------------------------------------


def score_forms(
    gallery: Gallery, input_: Input, title: str, folder: Path, spec: ScorerSpec, store: Store, watched: Watched
) -> Record:
    """Score the meshes of a folder as forms of a gallery and store the record, or return the stored one.

    Parameters
    ----------
    gallery, input_
        The shapes, and the input of the other rows.
    title, folder
        Title of the row, and folder with a mesh ``SHAPE.off``, or in another format, for each shape. A missing mesh
        scores 0.
    spec
        Compares the forms.
    store
        Where signatures, distances and the record are stored.
    watched
        Wraps the iteration over shapes, to show progress.

    Raises
    ------
    ConfigurationError
        If the folder has no form of these shapes, or none is usable.
    """
    if spec.is_foreign:
        raise ConfigurationError(
            f"scorer '{spec.name}' is a plugin", "score forms of other programs with a scorer of the suite"
        )
    files = _files(gallery.entries, folder)
    digests = {name: file_digest(path) for name, path in files.items()}
    common = {"scorer": recipes.scorer_recipe(spec), "versions": versions_of([f"scorer/{spec.base_name}", "measures"])}
    of_row = {**data_recipe(gallery, input_), "method": method_name(title), EXTERNAL: digest(digests), **common}
    before = store.records.read(key_of(of_row))
    if before is not None:
        return before
    start, scorer = time.perf_counter(), spec.create()
    signatures: dict[str, Arrays] = {}
    refused: list[tuple[str, str]] = []
    for name in (entry.identifier for entry in watched(gallery.entries)):
        try:
            if name not in files:
                raise UnsupportedShape(f"{folder} has no form of this shape")
            recipe = {"stage": "features", EXTERNAL: digests[name], **common}
            compute = partial(attempted, partial(_signature, scorer, files[name]))
            signatures[name] = require_arrays(store.get_or_compute(recipe, compute, work="features"))
        except ShapeError as error:
            refused.append((name, error.problem))
    if not signatures:
        raise ConfigurationError(f"no form in {folder} is usable: {refused[0][1]}", "correct the meshes")
    names, labels = ([getattr(e, part) for e in gallery.entries] for part in ("identifier", "subject"))
    answered = [place for place, name in enumerate(names) if name in signatures] if refused else None
    draws = (form_distances(scorer, list(signatures.values()), draw) for draw in range(spec.info.draws))
    scored = {
        **measures.scores(draws, labels, answered),
        **({} if spec.name == DEFAULT_SCORER else {"scorer": spec.name, "scorer_title": spec.title}),
        "shapes": names,
        "labels": labels,
        "unsupported": refused,
        "coverage": len(signatures) / len(names),
        "wall_seconds": round(time.perf_counter() - start, 3),
    }
    return _store(store, plain(data_facts(gallery)), gallery.name, title, plain(of_row), scored)


def _signature(scorer: Any, path: Path) -> Arrays:
    return signature_of(scorer, read_mesh(path))


def _files(entries: Iterable[Entry], folder: Path) -> dict[str, Path]:
    """Return the mesh file of each shape that has one, by name."""
    files = {}
    for entry in entries:
        paths = (folder / f"{entry.identifier}{extension}" for extension in READABLE)
        if path := next((path for path in paths if path.is_file()), None):
            files[entry.identifier] = path
    if not files:
        first = next(iter(entries)).identifier
        raise ConfigurationError(f"{folder} has no form of these shapes", f"name them like the shapes: {first}.off")
    return files
