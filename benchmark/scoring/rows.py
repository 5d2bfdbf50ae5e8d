"""Rows of tables for results of other programs: distances, and forms in mesh files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry
from benchmark.code_digest import code_of_modules, digest, digest_of_bytes
from benchmark.datasets.catalogue import is_known
from benchmark.errors import ConfigurationError, ShapeError, UnsupportedShape
from benchmark.files import file_digest
from benchmark.geometry.io import READABLE, read_mesh
from benchmark.pipeline.cache import Cache, writing
from benchmark.pipeline.data_names import label_data_sets, records_of
from benchmark.pipeline.environment import commit, packages
from benchmark.pipeline.records import EXTERNAL, Record, read_records, record_of, write_record
from benchmark.pipeline.stages import compute_distances, compute_signature
from benchmark.protocols.galleries import Gallery
from benchmark.registry import Component
from benchmark.report.frames import fold_of
from benchmark.runs.planning import RANKING, gallery_facts
from benchmark.scoring.evaluation import Evaluation
from benchmark.text import brief
from retrieval.measures import score_draws


def method_name(title: str) -> str:
    """Return the method name of an external row: ``external-TITLE``; no method of the suite can have it.

    Raises
    ------
    ConfigurationError
        If the title has neither letters nor digits.
    """
    words = re.sub("[^a-z0-9]+", "-", title.lower()).strip("-")
    if not words:
        raise ConfigurationError(f"'{title}' cannot be the title of a row", "use letters or digits")
    return f"{EXTERNAL}-{words[:50].rstrip('-')}"


def keep_distances(results: Path, evaluation: Evaluation, title: str, dataset: str, input_: Input) -> Record:
    """Store distances as a row beside those of a data set, and return its record.

    Parameters
    ----------
    results
        The results folder.
    evaluation
        Distances with the names and classes of their shapes.
    title, dataset, input_
        Title of the row; name of the data set or gallery, and the input of the rows beside it. A name that is not known
        makes a table of its own.

    Raises
    ------
    ConfigurationError
        If the shapes have no names, or differ from those of the other rows.
    """
    if evaluation.queries.index.dtype.kind == "i":  # numbers of rows
        hint = "name rows and columns in a CSV, or pass labels with lines 'name label' in the order of the rows"
        raise ConfigurationError("rows are paired by the names of shapes, and these distances have none", hint)
    labels = evaluation.queries["class"].to_dict()
    facts = _facts(record_beside(results, dataset, input_, title), dataset, labels)
    known = dict(zip(facts["shapes"], facts["labels"], strict=True))
    if known != labels:
        other = [name for name in labels if known.get(name) != labels[name]]
        what = f"the first that differs is '{other[0]}'" if other else f"they are {len(labels)}, not {len(known)}"
        first = " ".join(next(iter(known.items())))
        hint = f"name them with their classes as there ({first}, ...), or another --dataset"
        raise ConfigurationError(f"the shapes are not those of '{facts['gallery']}': {what}", hint)
    order = evaluation.queries.index.get_indexer(list(known))
    matrix = evaluation.distances[np.ix_(order, order)]
    parts = [facts["gallery_digest"], input_, title, digest_of_bytes(matrix.tobytes()), code_of_modules([RANKING])]
    key = digest(parts)
    content = {**facts, "input": input_, "scorer": "", "scorer_title": "", **score_draws([matrix], facts["labels"])}
    return _keep(results, key, title, content, matrix)


def record_beside(results: Path, dataset: str, input_: Input, title: str) -> Record | None:
    """Return a record beside whose row an external one is shown; None for a name that makes a table of its own.

    Raises
    ------
    ConfigurationError
        If the name means data without a row here, or cannot be that of a table.
    """
    every, method = read_records(results), method_name(title)
    whole = [record for record in every if not (fold_of(record) or record.data.quick)]
    of_data = {record.key for record in records_of(label_data_sets(whole), [dataset])}
    of_gallery = [record for record in every if record.key in of_data or record.gallery == dataset]
    rows = [record for record in of_gallery if record.input == input_]
    if beside := [record for record in rows if record.status == "ok" and record.method != method]:
        return beside[-1]
    if is_known(dataset) or Path(dataset).is_dir():
        problem = f"no row of '{dataset}', {input_}, is here, so its shapes are unknown"
        raise ConfigurationError(problem, "run a method on it first, or omit --dataset")
    if "/" in dataset or not dataset.strip() or not dataset.isprintable():
        raise ConfigurationError(f"'{dataset}' is neither a data set nor a folder", "name the table: --dataset mine")
    return None


def _facts(beside: Record | None, dataset: str, labels: Mapping[str, str]) -> dict[str, Any]:
    """Return the facts of the gallery of a record, or of a table of its own."""
    if beside:
        return {fact: getattr(beside, fact) for fact in ("gallery", "gallery_digest", "data", "shapes", "labels")}
    return {
        "gallery": dataset,
        "gallery_digest": digest([dataset, *labels.items()]),
        "data": {"name": dataset, "title": dataset, "source": dataset},
        "shapes": list(labels),
        "labels": list(labels.values()),
    }


def score_forms(
    gallery: Gallery,
    input_: Input,
    title: str,
    folder: Path,
    scorer: Component,
    results: Path,
    watched: Callable[[Iterable[Entry]], Iterator[Entry]] = iter,
) -> Record:
    """Score the meshes of a folder as forms of a gallery; store and return the record, or return the stored one.

    Parameters
    ----------
    gallery, input_
        The shapes, and the input of the other rows.
    title, folder
        Title of the row, and folder with a mesh ``SHAPE.off``, or in another format, for each shape. A missing mesh
        scores 0.
    scorer
        Compares the forms.
    results
        The results folder.
    watched
        Wraps the iteration over shapes, to show progress.

    Raises
    ------
    ConfigurationError
        If there is no such folder, it has no form of these shapes, or none is usable.
    """
    files = _files(gallery.entries, folder)
    facts = gallery_facts(gallery, input_)
    digests = {name: file_digest(path) for name, path in files.items()}
    key = digest([facts["gallery_digest"], input_, title, digests, scorer.key(), code_of_modules([RANKING])])
    for record in read_records(results, published=False):
        if record.key == key:
            return record
    created, signatures, refused = scorer.create(), {}, {}
    for entry in watched(gallery.entries):
        name = entry.identifier
        try:
            if name not in files:
                raise UnsupportedShape(f"{folder} has no form of this shape")
            signatures[name] = compute_signature(created, read_mesh(files[name]))
        except ShapeError as error:
            refused[name] = error.problem
    if not signatures:
        raise ConfigurationError(f"no form in {folder} is usable: {next(iter(refused.values()))}", "correct the meshes")
    matrices = [compute_distances(created, [*signatures.values()], draw) for draw in range(scorer.info.draws)]
    answered = [number for number, name in enumerate(facts["shapes"]) if name in signatures]
    scores = score_draws(matrices, facts["labels"], answered)
    by = {"scorer": scorer.name, "scorer_title": scorer.title, "unsupported": [*refused.items()]}
    return _keep(results, key, title, {**facts, **scores, **by}, np.mean(matrices, axis=0))


def _files(entries: Iterable[Entry], folder: Path) -> dict[str, Path]:
    """Return the mesh file of each shape that has one, by name."""
    if not folder.is_dir():
        raise ConfigurationError(f"{folder} is not a folder", "name the folder of the forms")
    names = [entry.identifier for entry in entries]
    paths = ((name, folder / f"{name}{suffix}") for suffix in reversed(READABLE) for name in names)
    files = {name: path for name, path in paths if path.is_file()}
    if not files:
        hint = f"name them like the shapes: {names[0]}.off"
        raise ConfigurationError(f"{folder} has no form of these shapes", hint)
    return files


def _keep(results: Path, key: str, title: str, content: Mapping[str, Any], distances: Any) -> Record:
    """Store the record of an external row in place of an earlier one, and return it."""
    own = {
        "key": key,
        "status": "ok",
        "method": method_name(title),
        "title": brief(title),
        "family": EXTERNAL,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "packages": packages(),
    }
    record = record_of({**msgspec.to_builtins(content), **own})
    with writing(results):
        before = [
            other
            for other in read_records(results, published=False)
            if other.row == record.row and other.has_data_of(record)
        ]
        if before and before[0].title != title:
            problem = f"'{before[0].title}' and '{title}' have one name, {record.method}"
            raise ConfigurationError(problem, "choose another title")
        Cache(results).write("records", key, {"distances": np.asarray(distances)})
        write_record(results, record, before[0].key if before else "")
    return record
