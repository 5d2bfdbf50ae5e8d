"""Choices among vertices that do not hang on the last bits of what is compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import FloatArray

TIE = 1e-6
"""Values nearer to the extreme one than this fraction of it are equal. Distances are stored in single precision, whose
last bit is a seventeenth of that; symmetric surfaces have many such ties."""

STEP = 2.0**-24
"""Coordinates are compared in multiples of this share of the largest one: far coarser than rounding errors."""


def largest(values: FloatArray, vertices: FloatArray) -> int:
    """Return the vertex of the largest value; of equal ones, the first by its coordinates.

    Parameters
    ----------
    values
        One number per vertex, shape (n,).
    vertices
        Positions, shape (n, 3).
    """
    highest = values.max()
    # What cannot be reached is infinitely far, and as far as what else cannot.
    bound = highest - TIE * np.abs(highest) if np.isfinite(highest) else highest
    tied = np.flatnonzero(values >= bound)
    if len(tied) == 1:
        return int(tied[0])
    return int(tied[order_by_coordinates(vertices[tied], float(np.abs(vertices).max()))[0]])


def order_by_coordinates(vertices: FloatArray, extent: float) -> NDArray[np.int64]:
    """Return the order of points by their coordinates x, y, z in multiples of ``STEP * extent``, shape (n,)."""
    cells = np.round(vertices / (STEP * max(extent, np.finfo(float).tiny)))
    return np.asarray(np.lexsort(cells.T[::-1]), dtype=np.int64)
