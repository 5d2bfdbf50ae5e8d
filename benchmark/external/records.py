"""External rows: records of scores of what other programs computed, beside those of the suite."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from benchmark.api.contracts import Input
from benchmark.arrays import digest_of
from benchmark.errors import ConfigurationError
from benchmark.external.labels import Labels
from benchmark.external.scoring import Task
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.lock import key_of, versions_of
from benchmark.pipeline.storage.records import EXTERNAL, NO_SCORER, Record
from benchmark.pipeline.storage.store import Store
from benchmark.text import LONGEST_NAME
from retrieval.chance import chance_levels
from retrieval.metrics import Scores


def method_name(title: str) -> str:
    """Name of an external row, which no method of the suite has."""
    return f"{EXTERNAL}-{re.sub('[^a-z0-9]+', '-', title.lower()).strip('-')}"[:LONGEST_NAME]


def external_record(
    data: Mapping[str, Any],
    gallery: str,
    input_: Input,
    title: str,
    recipe: Mapping[str, Any],
    scored: Mapping[str, Any],
) -> Record:
    """Return the record of an external row.

    Parameters
    ----------
    data, gallery, input_
        The shapes, as other records name them.
    title
        What the row is called.
    recipe
        What determines the scores.
    scored
        ``scores``, ``per_query``, ``shapes``, ``labels`` and what else a finished job tells.
    """
    labels = scored["labels"]
    return {
        "key": key_of(recipe),
        "gallery": gallery,
        "input": input_,
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


def keep_distances(store: Store, task: Task, scores: Scores, title: str, dataset: str, input_: Input) -> Record:
    """Keep a square matrix with one label a shape as an external row.

    Raises
    ------
    ConfigurationError
        If it has no place among rows that rank each shape against all others, or its shapes are not those of the rows
        of the same data set.
    """
    if not task.is_square or any(len(classes) > 1 for classes in task.queries.classes):
        raise ConfigurationError(
            "rows of tables rank shapes with one label against each other", "leave --results out to score this matrix"
        )
    beside = _beside(store, dataset, input_)
    labels = [classes[0] for classes in task.queries.classes]
    data = beside["data"] if beside else own_data(dataset, labels)
    names = _names(beside, task.queries, labels)
    arrays = {"distances": task.values}
    recipe = {"stage": "distances", EXTERNAL: digest_of(arrays), "title": title, "versions": {}}
    artefact = store.get_or_compute(recipe, lambda: arrays)
    gallery = beside["gallery"] if beside else dataset
    of_row = {
        "input": input_,
        "method": method_name(title),
        "gallery": digest([gallery, *zip(names, labels, strict=True)]),
        EXTERNAL: artefact.digest,
        "versions": versions_of(["measures"]),
    }
    scored = {
        "scorer": NO_SCORER,
        "scores": scores.means,
        "chance": chance_levels(labels),
        "per_query": {
            name: [None if np.isnan(value) else round(float(value), 6) for value in values]
            for name, values in scores.per_query.items()
        },
        "tied_queries": scores.tied_queries,
        "lone_queries": scores.lone_queries,
        "shapes": names,
        "labels": labels,
        "artefacts": [artefact.key],
    }
    record = external_record(data, gallery, input_, title, of_row, scored)
    store.write_record(record)
    return record


def own_data(dataset: str, labels: Sequence[str]) -> dict[str, Any]:
    """Return what a record tells of shapes of which the suite has no data."""
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


def _beside(store: Store, dataset: str, input_: Input) -> Record | None:
    """The newest record of a data set whose rows an external one stands beside; None where there is none."""
    records = [
        record
        for record in (*store.published, *store.records)
        if record["status"] == "ok" and record["input"] == input_ and not record["data"]["quick"]
        and dataset in (record["gallery"], record["data"]["name"]) and record["family"] != EXTERNAL
    ]  # fmt: skip
    # A gallery of this name comes before others of its data set, such as a held-out part.
    records = [record for record in records if record["gallery"] == dataset] or records
    galleries = {record["gallery"] for record in records}
    if len(galleries) > 1:
        raise ConfigurationError(
            f"the rows of '{dataset}' are of several galleries",
            f"name one by --dataset: {', '.join(sorted(galleries))}",
        )
    return records[-1] if records else None


def _names(beside: Record | None, shapes: Labels, labels: Sequence[str]) -> list[str]:
    """Names of the shapes as the rows beside have them."""
    names = list(shapes.names) or ([] if beside else [str(place) for place in range(1, len(labels) + 1)])
    if beside is None:
        return names
    known = dict(zip(beside["shapes"], beside["labels"], strict=True))
    if not names and labels == beside["labels"]:
        return list(beside["shapes"])
    if dict(zip(names, labels, strict=False)) != known:
        other = [name for name in names if known.get(name) != labels[names.index(name)]]
        what = f"the first that differs is '{other[0]}'" if other else f"they are {len(labels)}, not {len(known)}"
        hint = f"name them with their labels as there: {beside['shapes'][0]} {beside['labels'][0]}, ..."
        raise ConfigurationError(f"the shapes are not those of '{beside['gallery']}': {what}", hint)
    return names
