"""Complete surfaces, as methods get them: the prepared shapes of the input ``mesh``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmark.pipeline.stages import NOTE, Arrays

if TYPE_CHECKING:
    from benchmark.geometry.mesh import Mesh

#: Number of vertices of a prepared mesh, as usual for canonical forms (Lian et al. 2013, Pickup et
#: al. 2018).
PREPARED_VERTICES = 2000


def prepare_mesh(source: Mesh) -> Arrays:
    """Prepare a mesh for methods: clean, join, decimate and scale it.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` of the prepared surface, of unit area; ``vertex_map``, the
        nearest vertex of the file at each vertex; ``source_area`` in squared file units;
        ``note:...`` for each note of the preparation.

    Raises
    ------
    ShapeError
        If the mesh has no usable part.
    """
    from benchmark.geometry.preparation import prepare  # it takes a second to import

    prepared = prepare(source, PREPARED_VERTICES)
    notes = {f"{NOTE}{name}": np.asarray(value) for name, value in prepared.report.items()}
    return {
        "vertices": prepared.mesh.vertices,
        "faces": prepared.mesh.faces,
        "vertex_map": prepared.vertex_map(source).astype(np.int32),
        "source_area": np.asarray(prepared.source_area),
        **notes,
    }
