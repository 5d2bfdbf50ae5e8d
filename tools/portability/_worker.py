"""All methods on all shapes of TOSCA in one process, under the kernels that its environment variables name.

First the forms, then, in another call, the scores of those rows in which the variants differ at all.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.contracts import Descriptor, Method, Shape
from benchmark.datasets.base import Entry
from benchmark.datasets.official.tosca import tosca
from benchmark.datasets.settings import FolderDataset
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
    """Treat the shapes that are not yet in the folder, or score rows; arguments: data root, folder, names of rows."""
    dataset, folder, rows = tosca(Path(sys.argv[1])), Path(sys.argv[2]), sys.argv[3:]
    folder.mkdir(parents=True, exist_ok=True)
    if rows:
        scores = {row: score(row, dataset, folder) for row in rows}
        (folder / "scores.json").write_text(json.dumps(scores, indent=1) + "\n")
        return
    half_width = max(fit_half_width([clean(dataset.load(e))[0]], dataset.camera(e)) for e in dataset.entries)
    for input_ in INPUTS:
        for number, entry in enumerate(dataset.entries):
            path = folder / f"{input_}-{entry.identifier}.npz"
            if not path.exists():
                arrays = treat(prepared(dataset, entry, input_, half_width))
                part = path.with_suffix(".part.npz")
                np.savez(part, **arrays)
                part.replace(path)
                print(f"{folder.name}: {input_} {number + 1} of {len(dataset.entries)}", flush=True)


def prepared(dataset: FolderDataset, entry: Entry, input_: str, half_width: float) -> Shape:
    """The shape as the harness would hand it to a method."""
    if input_ == "mesh":
        found = prepare(dataset.load(entry), N_VERTICES)
        return Shape(identifier=entry.identifier, mesh=found.mesh, source_area=found.source_area)
    view = depth_surface(clean(dataset.load(entry))[0], dataset.camera(entry), half_width)
    area = view.surface.area
    mesh = view.surface.with_vertices(view.surface.vertices / np.sqrt(area))
    return Shape(identifier=entry.identifier, mesh=mesh, depth=view.depth, source_area=area)


def treat(shape: Shape) -> dict[str, Any]:
    """Forms and what the scorer makes of their pose, or descriptors; nothing where a method refuses the shape."""
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
        normal = normalise(form, SCORER.pose, SCORER.image_size)
        arrays |= {
            f"{name}:form": form.vertices,
            f"{name}:normal": normal.vertices,
            f"{name}:faces": normal.faces,
        }
    return arrays


def score(row: str, dataset: FolderDataset, folder: Path) -> dict[str, float]:
    """Mean measures of a method under an input over the codebooks."""
    name, input_ = row.split()
    found, labels = [], []
    for entry in dataset.entries:
        with np.load(folder / f"{input_}-{entry.identifier}.npz") as arrays:
            if f"{name}:descriptor" in arrays:
                found.append(arrays[f"{name}:descriptor"])
            elif f"{name}:normal" in arrays:
                found.append(features_of(arrays[f"{name}:normal"], arrays[f"{name}:faces"], folder.parent / "features"))
            else:
                continue
        labels.append(entry.subject)
    method = METHODS[name].create()
    if isinstance(method, Descriptor):
        matrices = [method.distances(found)]
    else:
        codebooks = [SCORER.train_codebook(found, seed) for seed in CODEBOOK_SEEDS]
        matrices = [SCORER.distances([SCORER.quantise(each, book) for each in found]) for book in codebooks]
    scores = [evaluate(matrix, labels) for matrix in matrices]
    return {measure: float(np.mean([getattr(each, measure) for each in scores])) for measure in MEASURES}


def features_of(vertices: Any, faces: Any, shared: Path) -> Features:
    """Features of a form in its pose; computed once for all variants that have it to the last bit."""
    shared.mkdir(exist_ok=True)
    path = shared / f"{hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest()}.npz"
    if not path.exists():
        images = render(Mesh(vertices, faces), SCORER.image_size)
        features = detect_views(images, peak_threshold=SCORER.peak_threshold, background=BACKGROUND)
        part = path.with_suffix(".part.npz")
        np.savez(part, **features.to_arrays())
        part.replace(path)
    with np.load(path) as arrays:
        return Features.from_arrays(dict(arrays))


if __name__ == "__main__":
    main()
