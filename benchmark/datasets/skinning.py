"""Linear blend skinning: each vertex moves by the weighted mean of the transforms of its bones."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def linear_blend_skinning(vertices: Floats, bones: NDArray[np.int64], weights: Floats, transforms: Floats) -> Floats:
    """Return the posed vertices of bodies.

    Parameters
    ----------
    vertices
        The bodies at rest, shape (bodies, n, 3).
    bones
        Bones of each vertex, shape (n, k); indices are not checked.
    weights
        Weights of these bones, shape (n, k); rows sum to 1, unused entries are 0.
    transforms
        Affine transform of each bone from rest to pose, shape (bodies, number of bones, 4, 4).

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
