"""All methods on all shapes of TOSCA in one process, under the kernels that its environment variables name."""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.contracts import Descriptor, Method, Shape
from benchmark.datasets.base import Entry
from benchmark.datasets.settings import FolderDataset
from benchmark.datasets.tosca import tosca
from benchmark.errors import ShapeError
from benchmark.geometry.cleaning import clean
from benchmark.geometry.depth import depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.methods.registry import BUILT_IN, MethodSpec
from retrieval.cmbof import CMBOF, Features
from retrieval.features import detect_views
from retrieval.metrics import evaluate
from retrieval.pose import normalise
from retrieval.views import BACKGROUND, render

#: Models of TOSCA are not shipped, so methods that learn have no row.
METHODS = {name: MethodSpec(name, target) for name, target in BUILT_IN.items() if not target.startswith("learned.")}
INPUTS = ("mesh", "view")
MEASURES = ("nn", "ft", "st", "dcg")
CODEBOOK_SEEDS = (0, 1, 2)
N_VERTICES = 2000
SCORER = CMBOF()


def main() -> None:
    """Treat the shapes that are not yet in the folder, then score; arguments: data root, folder."""
    dataset, folder = tosca(Path(sys.argv[1])), Path(sys.argv[2])
    shared = folder.parent / "features"
    for each in (folder, shared):
        each.mkdir(parents=True, exist_ok=True)
    half_width = max(fit_half_width([clean(dataset.load(e))[0]], dataset.camera(e)) for e in dataset.entries)
    for input_ in INPUTS:
        for number, entry in enumerate(dataset.entries):
            path = folder / f"{input_}-{entry.identifier}.npz"
            if not path.exists():
                arrays = treat(prepared(dataset, entry, input_, half_width), shared)
                part = path.with_suffix(".part.npz")
                np.savez(part, **arrays)
                part.replace(path)
                print(f"{folder.name}: {input_} {number + 1} of {len(dataset.entries)}", flush=True)
    scores = {
        f"{name} {input_}": score(spec, [folder / f"{input_}-{e.identifier}.npz" for e in dataset.entries], dataset)
        for name, spec in METHODS.items()
        for input_ in INPUTS
    }
    (folder / "scores.json").write_text(json.dumps(scores, indent=1) + "\n")


def prepared(dataset: FolderDataset, entry: Entry, input_: str, half_width: float) -> Shape:
    """The shape as the harness would hand it to a method."""
    if input_ == "mesh":
        found = prepare(dataset.load(entry), N_VERTICES)
        return Shape(identifier=entry.identifier, mesh=found.mesh, source_area=found.source_area)
    view = depth_surface(clean(dataset.load(entry))[0], dataset.camera(entry), half_width)
    area = view.surface.area
    mesh = view.surface.with_vertices(view.surface.vertices / np.sqrt(area))
    return Shape(identifier=entry.identifier, mesh=mesh, depth=view.depth, source_area=area)


def treat(shape: Shape, shared: Path) -> dict[str, Any]:
    """Forms with their features, or descriptors, by method; nothing where a method refuses the shape."""
    arrays: dict[str, Any] = {}
    for name, spec in METHODS.items():
        method = spec.create()
        try:
            if not isinstance(method, Method):
                arrays[f"{name}:descriptor"] = method.describe(shape)
                continue
            form = method.canonicalise(shape).mesh
        except ShapeError:
            continue
        arrays[f"{name}:form"] = form.vertices
        arrays |= {f"{name}:{part}": array for part, array in features_of(form, shared).items()}
    return arrays


def features_of(form: Mesh, shared: Path) -> dict[str, Any]:
    """What the scorer sees of a form; computed once for all variants whose normalised forms are equal to the last bit.

    That the scorer makes the same of equal forms under every variant is for ``test_scorer.py`` to show, on some forms.
    """
    normal = normalise(form, SCORER.pose, SCORER.image_size)
    path = shared / f"{hashlib.sha256(normal.vertices.tobytes() + normal.faces.tobytes()).hexdigest()}.npz"
    if not path.exists():
        images = render(normal, SCORER.image_size)
        features = detect_views(images, peak_threshold=SCORER.peak_threshold, background=BACKGROUND)
        part = path.with_suffix(f".{os.getpid()}.npz")
        np.savez(part, **features.to_arrays())
        part.replace(path)
    with np.load(path) as arrays:
        return dict(arrays)


def score(spec: MethodSpec, paths: list[Path], dataset: FolderDataset) -> dict[str, Any]:
    """Mean measures over the codebooks, and a digest of what each shape was compared by."""
    found, labels, digests = [], [], {}
    for path, entry in zip(paths, dataset.entries, strict=True):
        with np.load(path) as arrays:
            parts = {
                key.removeprefix(f"{spec.name}:"): arrays[key] for key in arrays if key.startswith(f"{spec.name}:")
            }
        parts.pop("form", None)
        if parts:
            found.append(parts)
            labels.append(entry.subject)
            digests[entry.identifier] = hashlib.sha256(b"".join(a.tobytes() for a in parts.values())).hexdigest()[:16]
    method = spec.create()
    if isinstance(method, Descriptor):
        matrices = [method.distances([parts["descriptor"] for parts in found])]
    else:
        features = [Features.from_arrays(parts) for parts in found]
        matrices = []
        for seed in CODEBOOK_SEEDS:
            codebook = SCORER.train_codebook(features, seed)
            matrices.append(SCORER.distances([SCORER.quantise(each, codebook) for each in features]))
    all_scores = [evaluate(matrix, labels) for matrix in matrices]
    return {
        "measures": {name: float(np.mean([getattr(each, name) for each in all_scores])) for name in MEASURES},
        "digests": digests,
    }


if __name__ == "__main__":
    main()
