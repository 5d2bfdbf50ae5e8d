"""Signs of embeddings."""

from __future__ import annotations

import numpy as np

from benchmark.geometry.mesh import Points


def oriented(points: Points, areas: Points) -> Points:
    r"""Choose the signs of the axes of an embedding, shape (n, 3), by moments over the surface.

    The first two axes point to the side of positive third moment :math:`\sum_i a_i x_i^3`. The
    third makes :math:`\sum_i a_i x_i y_i z_i` positive, which chooses between the form and its
    mirror image. Where a plane across an axis is one of symmetry, as for a bent tube, a moment is
    zero: then rounding decides, and the form may differ by a reflection between processors.

    Parameters
    ----------
    points
        Positions along the axes, such as eigenvectors, whose signs are arbitrary, shape (n, 3).
    areas
        Vertex areas, shape (n,): ``shape.mesh.vertex_areas``.
    """
    centred = points - areas @ points / areas.sum()
    signs = np.where(areas @ centred**3 < 0, -1.0, 1.0)
    mixed_moment = areas @ (centred * [signs[0], signs[1], 1.0]).prod(axis=1)
    signs[2] = -1.0 if mixed_moment < 0 else 1.0
    return points * signs
