"""Forms of a bundle made again, in a process of its own that imports no plug-in; the plug-in has another one."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import Arrays, load_arrays
from benchmark.bundles.archive import Archive
from benchmark.bundles.manifest import Entry, Plugin
from benchmark.bundles.outcome import Fault, claim, lie
from benchmark.bundles.writing import FACES
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.execution.processes.calls import Guard, call_apart
from benchmark.execution.processes.process import ForeignError
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.method_run import MethodRun
from benchmark.pipeline.preparation import Preparation, require_arrays
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
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.models import Model, find_models
from benchmark.report.content import own_table

#: Farthest that a form, or a descriptor, made again may be from that of a bundle, relative to its size; and a signature
#: in distances of the scorer, relative to their mean. Other processors move forms by 2e-4 at most.
TOLERANCE = {"forms": 0.01, "descriptors": 0.01, "signatures": 0.05}


@dataclass(frozen=True)
class Remade:
    """Outcome of making forms again.

    Parameters
    ----------
    faults
        Why they are not the same, or could not be made.
    shapes
        Whose forms were made again.
    apart
        How far they are from those of the bundle at most.
    distances
        Of all pairs of descriptors, by their own method; None where they are nobody's but ours to make.
    """

    faults: tuple[Fault, ...] = ()
    shapes: tuple[str, ...] = ()
    apart: float = 0.0
    distances: list[list[float]] | None = None


@dataclass(frozen=True)
class Remaking:
    """Forms to make again.

    Parameters
    ----------
    record, entry
        Of which record.
    source, data_root
        Its data set, as it is opened here; "" where it is not here.
    results
        Results folder with models that were trained here.
    shapes
        The shapes.
    """

    record: Record
    entry: Entry
    source: str
    data_root: Path | None
    results: Path
    shapes: tuple[str, ...]


def unpack_plugin(archive: Archive, plugin: Plugin, folder: Path) -> Path:
    """Write the source of a plug-in into an empty folder and return its path; names were looked at before."""
    for name in plugin.digests:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(archive.read(name))
    return (folder / plugin.file).resolve()


def made_again(remaking: Remaking, archive: Archive, plugin: Plugin | None, limit: float | None) -> Remade:
    """Make forms again and compare them with those of the bundle.

    Parameters
    ----------
    remaking
        Which forms.
    archive, plugin
        The bundle, and its plug-in, which is run; None for a method of the suite.
    limit
        Seconds that it may take.
    """
    name = remaking.record["method"]
    with TemporaryDirectory(prefix="canonical-forms-") as place:
        folder = Path(place)
        content = archive.read(remaking.entry.arrays)  # in no file that the plug-in could read
        target = f"{unpack_plugin(archive, plugin, folder)}:{plugin.attribute}" if plugin else ""
        guard = Guard(f"method '{name}'", "ask its author, or pass a longer --timeout", limit, quiet=True)
        try:
            told = call_apart(_make, remaking, target, content, folder, guard=guard)
        except BenchmarkError as error:
            return Remade((claim("not-made-again", error.problem, error.hint),))
    made = Remade((), remaking.shapes, told["apart"], told["distances"])
    if told["apart"] <= TOLERANCE[remaking.entry.holds]:
        return made
    said = f"forms made again are apart from those of the bundle, by {told['apart']:.2g} of their size at most"
    if not told["is_same_code"]:
        hint = "verify it by the version of the suite that made it"
        fault = claim("other-code", f"{said}; and the method is another one here than the one that made it", hint)
    else:
        fault = lie("not-made-again", said, "take the forms for those of something else")
    return Remade((fault,), made.shapes, made.apart, made.distances)


def _make(remaking: Remaking, target: str, content: bytes, folder: Path) -> dict[str, Any]:
    """Make and compare the forms, in a process of its own."""
    try:
        return _made(remaking, target, content, folder)
    except ForeignError as error:
        raise ConfigurationError(f"method '{remaking.record['method']}' raises {error}", "ask its author") from error


def _made(remaking: Remaking, target: str, content: bytes, folder: Path) -> dict[str, Any]:
    record, entry = remaking.record, remaking.entry
    base = str(record["recipe"]["method"])
    if target:
        close_to_plugins()
        spec = MethodSpec(base, target, record["parameters"])
        if spec.learns:
            raise ConfigurationError("its trained model is not in the bundle", "train it yourself, and submit")
    else:
        spec = variant(record["method"], methods())
    items = dict(zip(answered_shapes(record), unfolded(load_arrays(io.BytesIO(content), entry.key)), strict=True))
    made, apart = None, 0.0
    if remaking.source:
        run = _method_run(remaking, spec, folder)
        by_name = {each.identifier: each for each in run.preparation.dataset.entries}
        for name in remaking.shapes:
            arrays = dict(require_arrays(run.answer(by_name[name])))
            if entry.holds != "descriptors":
                arrays.setdefault(FACES, arrays.get("faces", run.preparation.shape(by_name[name]).mesh.faces))
            apart = max(apart, _apart(arrays, name, items, run))
    if target and entry.holds == "descriptors":
        method: Any = spec.create()
        vectors = [arrays["descriptor"] for arrays in items.values()]
        compare = lambda items: distances_of(method, items)  # noqa: E731
        made = in_shuffled_order(vectors, compare).tolist()
    versions = versions_of(method_components(spec))
    is_same = bool(target) or versions.items() <= record["recipe"].get("versions", {}).items()
    return {"apart": min(apart, 1e9), "distances": made, "is_same_code": is_same}


def _method_run(remaking: Remaking, spec: MethodSpec, folder: Path) -> MethodRun:
    record, store = remaking.record, Store.open(folder / "results")
    dataset = open_dataset(remaking.source, remaking.data_root)
    shapes = set(record["shapes"])
    entries = tuple(entry for entry in dataset.entries if entry.identifier in shapes)
    gallery = Gallery(own_table(dataset.name), remaking.source, dataset, entries, data_root=remaking.data_root)
    models = {} if spec.is_foreign else find_models(spec, gallery, remaking.results / "models")
    if _digests(models) != record["recipe"].get("models", {}):
        raise ConfigurationError("its trained model is not here", "pass the results folder that has it as --results")
    scorer = scorer_of(scorer_name(record) or ScorerSpec().name, scorers())
    seed = int(record["recipe"].get("seed", 0))
    return MethodRun(Preparation(dataset, record["input"], store), store, spec, seed, models, scorer)


def _digests(models: Mapping[str, Model]) -> dict[str, str]:
    return {model.training: model.digest for model in models.values()}


def _apart(made: Arrays, name: str, items: Mapping[str, Arrays], run: MethodRun) -> float:
    """Return the distance of what was made again of a shape from what the bundle holds, relative to its size."""
    told = items[name]
    if "descriptor" in made:
        if made["descriptor"].shape != told["descriptor"].shape:
            return np.inf
        size = np.abs(told["descriptor"]).max(initial=1e-300)
        return float(np.abs(made["descriptor"] - told["descriptor"]).max(initial=0.0) / size)
    if "vertices" in told:
        one, other = (each.get("faces", each[FACES]) for each in (made, told))
        if made["vertices"].shape != told["vertices"].shape or not np.array_equal(one, other):
            return np.inf
        return rigid_distance(made["vertices"], told["vertices"])
    form = Mesh(made["vertices"], made.get("faces", made[FACES]))
    others = [arrays for other, arrays in items.items() if other != name][:10]
    found = form_distances(run.scorer, [signature_of(run.scorer, form), told, *others], 0)
    return float(found[0, 1] / max(found[1, 2:].mean(), 1e-300))


def rigid_distance(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Return the largest distance of two vertices after one is moved rigidly onto the other, relative to its radius."""
    a, b = (
        np.asarray(each, dtype=np.float64) - np.asarray(each, dtype=np.float64).mean(axis=0) for each in (one, other)
    )
    left, _, right = np.linalg.svd(a.T @ b)
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    moves = np.linalg.norm(a @ left @ turn @ right - b, axis=1)
    return float(moves.max() / max(np.linalg.norm(b, axis=1).max(), 1e-300))
