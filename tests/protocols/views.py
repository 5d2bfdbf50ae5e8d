"""The first shape of a data set as a depth camera sees it."""

from __future__ import annotations

from typing import Any

from benchmark.api.contracts import Shape
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.preparation import prepare_view


def view(dataset: Any) -> Shape:
    entry = dataset.shapes[0]
    arrays = prepare_view(dataset.load(entry), dataset.camera(entry), dataset.half_width)
    mesh = Mesh(arrays["vertices"], arrays["faces"])
    return Shape(identifier=entry.identifier, mesh=mesh, depth=arrays["depth"])
