"""Shapes and their stored forms as they are drawn: right, up, towards the viewer."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmark.api.datasets import ShapeSet
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.records import Record, read_form, read_prepared
from benchmark.report.drawing import turned_like


@dataclass(frozen=True)
class StoredForms:
    """Reader of the shapes and forms that a results folder keeps of its own jobs.

    Parameters
    ----------
    folder
        The results folder.
    data_root
        Folder of the official data sets, whose cameras say which side of a shape is up.
    """

    folder: Path
    data_root: Path | None = None
    _sets: dict[str, ShapeSet | None] = field(default_factory=dict, repr=False)

    def shape(self, record: Record, name: str) -> Mesh | None:
        """Return a prepared shape; None if it is not stored."""
        mesh = read_prepared(self.folder, record, name)
        if mesh is None:
            return None
        rotation = self._camera(record, name).rotation if record.input == "mesh" else np.eye(3)
        return mesh.with_vertices(_centred(mesh.vertices @ rotation.T))

    def form(self, record: Record, name: str) -> Mesh | None:
        """Return the form of a shape, turned as the shape; None if one of them is not stored."""
        form, shape = read_form(self.folder, record, name), self.shape(record, name)
        if form is None or shape is None:
            return None
        return form.with_vertices(_centred(turned_like(form.vertices, shape.vertices)))

    def _camera(self, record: Record, name: str) -> Camera:
        source = record.data.source
        if source not in self._sets:
            try:
                self._sets[source] = open_dataset(source, self.data_root)
            except BenchmarkError:
                self._sets[source] = None  # the data are not here; a front view has z up
        shapes = self._sets[source]
        entries = [entry for entry in shapes.shapes if entry.identifier == name] if shapes else []
        return shapes.camera(entries[0]) if shapes and entries else FRONT


def _centred(points: np.ndarray) -> np.ndarray:
    """Centre points on the middle of their extent, and scale its longest side to 2."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.asarray((points - (low + high) / 2) / max(float((high - low).max()) / 2, 1e-12))
