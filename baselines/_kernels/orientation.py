"""One rule for the signs that an eigen-decomposition leaves open."""

from __future__ import annotations

import numpy as np

from baselines._kernels.ties import largest
from benchmark.contracts import FloatArray
from benchmark.geometry.mesh import Mesh


def vertex_areas(mesh: Mesh) -> FloatArray:
    """Return the barycentric area of each vertex, a third of its triangles, shape (n,), in squared mesh units."""
    shares = np.repeat(mesh.face_areas / 3, 3)
    return np.asarray(np.bincount(mesh.faces.ravel(), shares, mesh.n_vertices), dtype=np.float64)


def canonical_signs(coordinates: FloatArray, weights: FloatArray, positions: FloatArray) -> FloatArray:
    """Choose the sign of each axis so that its weighted third central moment is positive.

    The moment is a sum over the surface, so the choice follows any relabelling of the vertices and hardly depends on
    the sampling. It undoes mirrorings too. An axis of symmetry has no third moment: there the vertex farthest from
    the centre decides, of several equally far ones the first by its position on the surface, and both signs give nearly
    the same form.

    Parameters
    ----------
    coordinates
        One column per axis, shape (n, k).
    weights
        Weight of each vertex, usually its area, shape (n,).
    positions
        Vertices of the surface, shape (n, 3).

    Returns
    -------
    numpy.ndarray
        Either 1.0 or -1.0 per axis, shape (k,).
    """
    centred = coordinates - np.average(coordinates, axis=0, weights=weights)
    moments = weights @ centred**3
    extremes = np.array([column[largest(np.abs(column), positions)] for column in centred.T])
    negligible = np.abs(moments) <= 1e-9 * (weights @ np.abs(centred) ** 3)
    return np.where(np.where(negligible, extremes, moments) < 0, -1.0, 1.0)
