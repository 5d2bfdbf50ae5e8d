"""External rows of forms in mesh files, which a scorer of the suite compares."""

from __future__ import annotations

import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.arrays import Arrays
from benchmark.datasets.base import Entry, Watched
from benchmark.datasets.files import file_digest
from benchmark.datasets.folder import EXTENSIONS
from benchmark.errors import ConfigurationError
from benchmark.execution.plan import data_facts, data_recipe
from benchmark.external.records import external_record, method_name
from benchmark.geometry.io import read_mesh
from benchmark.pipeline import recipes
from benchmark.pipeline.preparation import attempted
from benchmark.pipeline.stages import measures
from benchmark.pipeline.storage.keys import digest, plain
from benchmark.pipeline.storage.lock import key_of, versions_of
from benchmark.pipeline.storage.records import DEFAULT_SCORER, EXTERNAL, Record
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.output_checks import REFUSED, form_distances, signature_of
from benchmark.plugins.specs import ScorerSpec
from benchmark.protocols.galleries import Gallery


def score_forms(
    gallery: Gallery, input_: Input, title: str, folder: Path, spec: ScorerSpec, store: Store, watched: Watched
) -> Record:
    """Score the meshes of a folder as forms of a gallery, and keep the record; one that is kept is returned.

    Parameters
    ----------
    gallery, input_
        The shapes, and the input of the rows beside.
    title, folder
        Name of the row; holds a mesh ``SHAPE.off``, or of another format, for each shape. A missing one counts 0.
    spec
        What compares them.
    store
        Where signatures, distances and the record are kept.
    watched
        Told each shape.

    Raises
    ------
    ConfigurationError
        If the folder has no form of these shapes, or none can be used.
    """
    if spec.is_foreign:
        raise ConfigurationError(f"scorer '{spec.name}' is a plugin", "score forms of other programs by one of ours")
    files = _files(gallery.entries, folder)
    versions = versions_of([f"scorer/{spec.base_name}", "measures"])
    of_row = {
        **data_recipe(gallery, input_),
        "method": method_name(title),
        EXTERNAL: digest({name: file_digest(path) for name, path in files.items()}),
        "scorer": recipes.scorer_recipe(spec),
        "versions": versions,
    }
    before = store.records.read(key_of(of_row))
    if before is not None:
        return before
    start, scorer = time.perf_counter(), spec.create()
    signatures: dict[str, Arrays] = {}
    refused: list[tuple[str, str]] = []
    for entry in watched(gallery.entries):
        name, path = entry.identifier, files.get(entry.identifier)
        if path is None:
            refused.append((name, f"{folder} has no form of it"))
            continue
        recipe = {"stage": "features", EXTERNAL: file_digest(path), "scorer": of_row["scorer"], "versions": versions}
        kept = store.get_or_compute(recipe, partial(attempted, partial(_signature, scorer, path)), work="features")
        if REFUSED in kept.arrays:
            refused.append((name, str(kept.arrays[REFUSED][0])))
        else:
            signatures[name] = kept.arrays
    if not signatures:
        raise ConfigurationError(f"no form in {folder} can be used: {refused[0][1]}", "correct the meshes")
    names, labels = ([getattr(e, part) for e in gallery.entries] for part in ("identifier", "subject"))
    answered = [place for place, name in enumerate(names) if name in signatures] if refused else None
    compared = (form_distances(scorer, list(signatures.values()), draw) for draw in range(spec.info.draws))
    is_default = spec.name == DEFAULT_SCORER
    scored = {
        **measures.scores(compared, labels, answered),
        **({} if is_default else {"scorer": spec.name, "scorer_title": spec.title}),
        "shapes": names,
        "labels": labels,
        "unsupported": refused,
        "coverage": len(signatures) / len(names),
        "wall_seconds": round(time.perf_counter() - start, 3),
    }
    record = external_record(plain(data_facts(gallery)), gallery.name, input_, title, plain(of_row), scored)
    store.write_record(record)
    return record


def _signature(scorer: Any, path: Path) -> Arrays:
    return signature_of(scorer, read_mesh(path))


def _files(entries: Iterable[Entry], folder: Path) -> dict[str, Path]:
    """The mesh of each shape that has one, by its name."""
    files = {}
    for entry in entries:
        paths = (folder / f"{entry.identifier}{extension}" for extension in EXTENSIONS)
        if path := next((path for path in paths if path.is_file()), None):
            files[entry.identifier] = path
    if not files:
        first = next(iter(entries)).identifier
        raise ConfigurationError(f"{folder} has no form of these shapes", f"name them as the shapes: {first}.off, ...")
    return files
