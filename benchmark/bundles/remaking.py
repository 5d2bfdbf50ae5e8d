"""Recompute forms of a bundle in a separate process; the plugin runs in another one."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import Arrays, load_arrays
from benchmark.bundles.archive import FACES, Entry, form_of
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.process import ForeignError
from benchmark.pipeline.method_run import MethodRun, require_arrays
from benchmark.pipeline.ranking import in_shuffled_order
from benchmark.pipeline.recipes import method_components
from benchmark.pipeline.storage.lock import versions_of
from benchmark.pipeline.storage.records import Record, answered_shapes, scorer_name
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.output_checks import distances_of, form_distances, signature_of
from benchmark.plugins.registry import MethodSpec, methods, variant
from benchmark.plugins.remote import close_to_plugins, unfolded
from benchmark.plugins.scorers import DEFAULT, scorer_of, scorers
from benchmark.report.artefact_reader import ArtefactReader


def remake(
    record: Record,
    entry: Entry,
    content: bytes,
    shapes: Sequence[str],
    target: str,
    data: tuple[str, Path | None],
    folders: tuple[Path, Path],
) -> dict[str, Any]:
    """Recompute forms of a record.

    Parameters
    ----------
    record, entry, content
        The record, and the file with its forms.
    shapes
        Names of the shapes to recompute.
    target
        Path and attribute of the plugin, as ``PATH:ATTRIBUTE``; "" for a method of the suite.
    data
        Local data set ("" if it is not available), and the folder of the official data sets.
    folders
        An empty results folder, and the folder of locally trained models.

    Returns
    -------
    dict
        ``apart``: largest distance from the forms of the bundle, relative to their size; ``distances``: of all pairs of
        descriptors of a plugin, otherwise None; ``is_same_code``: whether the method is the one in the record.
    """
    if target:
        close_to_plugins()
    base = str(record["recipe"]["method"])
    known = {base: MethodSpec(base, target)} if target else methods()
    spec = variant(record["method"], known)
    if target and spec.learns:
        raise ConfigurationError("its trained model is not in the bundle", "train it yourself, and submit")
    forms = unfolded(load_arrays(io.BytesIO(content), entry.key))
    items = dict(zip(answered_shapes(record), forms, strict=True))
    deviation, distances = 0.0, None
    try:
        if data[0]:
            run = _method_run(record, known, data, folders)
            deviation = max((_apart(run, name, items) for name in shapes), default=0.0)
        if target and entry.holds == "descriptors":
            method: Any = spec.create()
            vectors = [arrays["descriptor"] for arrays in items.values()]
            distances = in_shuffled_order(vectors, lambda vectors: distances_of(method, vectors)).tolist()
    except ForeignError as error:
        raise ConfigurationError(f"method '{record['method']}' raises {error}", "ask its author") from error
    is_same = (
        bool(target) or versions_of(method_components(spec)).items() <= record["recipe"].get("versions", {}).items()
    )
    return {"apart": min(deviation, 1e9), "distances": distances, "is_same_code": is_same}


def _method_run(
    record: Record, known: Mapping[str, MethodSpec], data: tuple[str, Path | None], folders: tuple[Path, Path]
) -> MethodRun:
    reader = ArtefactReader(Store.open(folders[0]), known, data[1], folders[1])
    run = reader.method_run({**record, "data": record["data"] | {"source": data[0]}})
    if {model.training: model.digest for model in run.models.values()} != record["recipe"].get("models", {}):
        raise ConfigurationError("its trained model is missing", "pass the results folder that has it as --results")
    return replace(run, scorer_spec=scorer_of(scorer_name(record) or DEFAULT, scorers()))


def _apart(run: MethodRun, name: str, items: Mapping[str, Arrays]) -> float:
    """Recompute the form of a shape and return its distance from the one in the bundle, relative to its size."""
    item = items[name]
    entry = next(entry for entry in run.preparation.dataset.entries if entry.identifier == name)
    arrays = require_arrays(run.answer(entry))
    if "descriptor" in item:
        one, other = arrays["descriptor"], item["descriptor"]
        if one.shape != other.shape:
            return np.inf
        return float(np.abs(one - other).max(initial=0.0) / np.abs(other).max(initial=1e-300))
    faces = arrays["faces"] if "faces" in arrays else run.preparation.shape(entry).mesh.faces
    if "vertices" in item:
        is_same = arrays["vertices"].shape == item["vertices"].shape
        if not (is_same and np.array_equal(faces, item.get("faces", item[FACES]))):
            return np.inf
        return rigid_distance(arrays["vertices"], item["vertices"])
    signature = signature_of(run.scorer, form_of({**arrays, "faces": faces}))
    others = [arrays for other, arrays in items.items() if other != name][:10]
    distances = form_distances(run.scorer, [signature, item, *others], 0)
    return float(distances[0, 1] / max(distances[1, 2:].mean(), 1e-300))


def rigid_distance(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Return the largest vertex distance after rigid alignment to the other form, relative to the other's radius."""
    a, b = (points - points.mean(axis=0) for points in (np.asarray(one, np.float64), np.asarray(other, np.float64)))
    left, _, right = np.linalg.svd(a.T @ b)
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    moves = np.linalg.norm(a @ left @ turn @ right - b, axis=1)
    return float(moves.max() / max(np.linalg.norm(b, axis=1).max(), 1e-300))
