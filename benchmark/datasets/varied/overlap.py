"""Test for a body that is pushed through itself: how much of it is inside twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.scanning import _count_crossings
from benchmark.datasets.varied.camera import extents
from benchmark.geometry.mesh import Faces, Points

CELL = 0.02
"""Distance of the sampled lines and of the samples along them, as a share of the height of the standing body."""

_MARGIN = 2
"""Empty samples around the body."""


def doubled_share(vertices: Points, faces: Faces, height: float) -> float:
    """Share of a solid that lies inside of it twice: its winding number there is two or more.

    Lines along the vertical axis are followed through the solid on a grid. Small triangles, open seams of a part and
    the creases of a knee move this share by little, an arm in a chest moves it by the volume of the arm.

    Parameters
    ----------
    vertices, faces
        A closed surface.
    height
        Height of the body when it stands, in units of the vertices.

    Returns
    -------
    float
        In [0, 1].
    """
    points = vertices / (CELL * height)
    # An irrational fraction of a step, so that no line runs along an edge of a symmetric body.
    points = points - extents(points)[0] + _MARGIN + np.sqrt([0.02, 0.03, 0.05])
    size = np.ceil(extents(points)[1]).astype(np.int64) + _MARGIN
    crossings: NDArray[np.int8] = np.zeros(tuple(size), dtype=np.int8)
    _count_crossings(points, faces, crossings)
    winding = np.cumsum(crossings, axis=2, dtype=np.int8)
    inside = np.count_nonzero(winding > 0)
    return float(np.count_nonzero(winding > 1) / inside) if inside else 1.0
