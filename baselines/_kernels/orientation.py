"""Signs of the axes of an embedding, and the choice between a form and its mirror image."""

from __future__ import annotations

import numpy as np

from benchmark.api.contracts import FloatArray


def oriented(points: FloatArray, areas: FloatArray) -> FloatArray:
    r"""Choose the signs of the axes of an embedding, shape (n, 3), by moments over the surface.

    The first two axes point to the side of positive third moment :math:`\sum_i a_i x_i^3`. The third makes
    :math:`\sum_i a_i x_i y_i z_i` positive, which chooses between the form and its mirror image. Where a plane across
    an axis is one of symmetry, as for a bent tube, a moment is zero: then rounding decides, and the form may differ by
    a reflection between processors.

    Parameters
    ----------
    points
        Positions along the axes, shape (n, 3).
    areas
        Vertex areas, shape (n,).
    """
    centred = points - areas @ points / areas.sum()
    signs = np.where(areas @ centred**3 < 0, -1.0, 1.0)
    signs[2] = -1.0 if areas @ (centred * [signs[0], signs[1], 1.0]).prod(axis=1) < 0 else 1.0
    return points * signs
