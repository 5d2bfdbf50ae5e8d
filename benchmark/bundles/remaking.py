"""Forms of a bundle made again, in a process of its own that imports no plugin; the plugin has another one."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import Arrays, load_arrays
from benchmark.bundles.reading import FACES, Entry, form_of
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
from benchmark.plugins.remote import close_to_plugins
from benchmark.plugins.scorers import ScorerSpec, scorer_of, scorers
from benchmark.plugins.serving import unfolded
from benchmark.report.artefact_reader import ArtefactReader


class Remaking(NamedTuple):
    """Forms to make again.

    Parameters
    ----------
    record, entry, arrays
        Of which record, and the file of its forms.
    shapes
        Names of the shapes.
    source, data_root
        Its data set, as it is opened here; "" where it is not here.
    models
        Folder of the models that were trained here.
    target
        The method of the plugin; "" for one of the suite.
    folder
        An empty folder.
    """

    record: Record
    entry: Entry
    arrays: bytes
    shapes: tuple[str, ...]
    source: str
    data_root: Path | None
    models: Path
    target: str
    folder: Path


def remake(remaking: Remaking) -> dict[str, Any]:
    """Make forms again.

    Returns
    -------
    dict
        ``apart``: largest distance from those of the bundle, relative to their size; ``distances`` of all pairs of
        descriptors of a plugin, else None; ``is_same_code``: whether the method is the one of the record.
    """
    try:
        return _remake(remaking)
    except ForeignError as error:
        raise ConfigurationError(f"method '{remaking.record['method']}' raises {error}", "ask its author") from error


def _remake(remaking: Remaking) -> dict[str, Any]:
    record, entry, target = remaking.record, remaking.entry, remaking.target
    base = str(record["recipe"]["method"])
    if target:
        close_to_plugins()
    known = {base: MethodSpec(base, target)} if target else methods()
    spec = variant(record["method"], known)
    if target and spec.learns:
        raise ConfigurationError("its trained model is not in the bundle", "train it yourself, and submit")
    forms = unfolded(load_arrays(io.BytesIO(remaking.arrays), entry.key))
    items = dict(zip(answered_shapes(record), forms, strict=True))
    apart, distances = 0.0, None
    if remaking.source:
        run = _method_run(remaking, known)
        entries = {each.identifier: each for each in run.preparation.dataset.entries}
        for name in remaking.shapes:
            arrays = dict(require_arrays(run.answer(entries[name])))
            if entry.holds != "descriptors":
                arrays.setdefault(FACES, arrays.get("faces", run.preparation.shape(entries[name]).mesh.faces))
            apart = max(apart, _apart(arrays, name, items, run))
    if target and entry.holds == "descriptors":
        method: Any = spec.create()
        vectors = [arrays["descriptor"] for arrays in items.values()]
        distances = in_shuffled_order(vectors, lambda items: distances_of(method, items)).tolist()
    versions = versions_of(method_components(spec))
    is_same = bool(target) or versions.items() <= record["recipe"].get("versions", {}).items()
    return {"apart": min(apart, 1e9), "distances": distances, "is_same_code": is_same}


def _method_run(remaking: Remaking, known: Mapping[str, MethodSpec]) -> MethodRun:
    record = remaking.record
    store = Store.open(remaking.folder / "results")
    reader = ArtefactReader(store, known, remaking.data_root, remaking.models)
    run = reader.method_run({**record, "data": record["data"] | {"source": remaking.source}})
    if {model.training: model.digest for model in run.models.values()} != record["recipe"].get("models", {}):
        raise ConfigurationError("its trained model is not here", "pass the results folder that has it as --results")
    return replace(run, scorer_spec=scorer_of(scorer_name(record) or ScorerSpec().name, scorers()))


def _apart(arrays: Arrays, name: str, items: Mapping[str, Arrays], run: MethodRun) -> float:
    """Return the distance of what was made again of a shape from what the bundle holds, relative to its size."""
    told = items[name]
    if "descriptor" in arrays:
        if arrays["descriptor"].shape != told["descriptor"].shape:
            return np.inf
        size = np.abs(told["descriptor"]).max(initial=1e-300)
        return float(np.abs(arrays["descriptor"] - told["descriptor"]).max(initial=0.0) / size)
    faces = arrays.get("faces", arrays[FACES])
    if "vertices" in told:
        is_same = arrays["vertices"].shape == told["vertices"].shape
        if not (is_same and np.array_equal(faces, told.get("faces", told[FACES]))):
            return np.inf
        return rigid_distance(arrays["vertices"], told["vertices"])
    signature = signature_of(run.scorer, form_of(arrays))
    others = [item for other, item in items.items() if other != name][:10]
    distances = form_distances(run.scorer, [signature, told, *others], 0)
    return float(distances[0, 1] / max(distances[1, 2:].mean(), 1e-300))


def rigid_distance(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Return the largest distance of two vertices after one is moved rigidly onto the other, relative to its radius."""
    a, b = (points - points.mean(axis=0) for points in (np.asarray(one, np.float64), np.asarray(other, np.float64)))
    left, _, right = np.linalg.svd(a.T @ b)
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    moves = np.linalg.norm(a @ left @ turn @ right - b, axis=1)
    return float(moves.max() / max(np.linalg.norm(b, axis=1).max(), 1e-300))
