"""Linear blend skinning: each vertex follows the bones that it is tied to, by the mean of where they take it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def linear_blend_skinning(vertices: Floats, bones: NDArray[np.int64], weights: Floats, transforms: Floats) -> Floats:
    """Vertices of bodies in their poses.

    Parameters
    ----------
    vertices
        The bodies at rest, shape (bodies, n, 3).
    bones
        The bones that each vertex is tied to, shape (n, k); indices are not checked.
    weights
        Share of each of them, shape (n, k); rows add up to 1, places that are not needed hold 0.
    transforms
        Where each bone of each body takes what is at rest, shape (bodies, number of bones, 4, 4), affine.

    Returns
    -------
    numpy.ndarray
        Shape (bodies, n, 3).

    References
    ----------
    Magnenat-Thalmann, Laperriere, Thalmann, "Joint-dependent local deformations for hand animation and object
    grasping", 1988.
    """
    posed = np.zeros(vertices.shape)
    for body in range(vertices.shape[0]):
        for vertex in range(vertices.shape[1]):
            x, y, z = vertices[body, vertex]
            for place in range(bones.shape[1]):
                weight = weights[vertex, place]
                if weight == 0:
                    continue
                transform = transforms[body, bones[vertex, place]]
                for axis in range(3):
                    posed[body, vertex, axis] += weight * (
                        transform[axis, 0] * x + transform[axis, 1] * y + transform[axis, 2] * z + transform[axis, 3]
                    )
    return posed
