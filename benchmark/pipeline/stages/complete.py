"""Mesh input: the complete surface, prepared in the same way for all methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare

#: Number of vertices of the prepared mesh, as usual for canonical forms (Lian et al. 2013, Pickup et al. 2018).
N_VERTICES = 2000


def complete(source: Mesh) -> Mapping[str, NDArray[Any]]:
    """Clean, join, decimate and scale a mesh.

    Parameters
    ----------
    source
        The mesh as the data set gives it.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` of the prepared surface, of unit area; ``source_area`` in squared file units;
        ``note:...`` for each fact that the preparation reports.

    Raises
    ------
    ShapeError
        If the mesh has no usable part.
    """
    prepared = prepare(source, N_VERTICES)
    return {
        "vertices": prepared.mesh.vertices,
        "faces": prepared.mesh.faces,
        "source_area": np.asarray(prepared.source_area),
        **{f"note:{name}": np.asarray(value) for name, value in prepared.report.items()},
    }
