"""One rule for the signs that an eigen-decomposition leaves open."""

from __future__ import annotations

import numpy as np

from baselines._kernels.sampling import largest
from benchmark.api.contracts import FloatArray
from benchmark.geometry.mesh import Mesh

EQUAL = 1e-6
"""Eigenvalues that differ by less than this share of the larger are equal: their axes may be turned into each other."""


NEGLIGIBLE = 1e-6
"""A third moment below this share of its largest possible value is that of an axis of symmetry. Geodesic distances in
single precision give one of some 1e-8 to an axis that should have none."""


def vertex_areas(mesh: Mesh) -> FloatArray:
    """Return the barycentric area of each vertex, a third of its triangles, shape (n,), in squared mesh units."""
    shares = np.repeat(mesh.face_areas / 3, 3)
    return np.asarray(np.bincount(mesh.faces.ravel(), shares, mesh.n_vertices), dtype=np.float64)


def settled_axes(coordinates: FloatArray, eigenvalues: FloatArray, positions: FloatArray) -> FloatArray:
    """Turn the axes of equal eigenvalues, which a solver leaves open, to where the surface reaches farthest.

    Of the axes that are free to turn, the first points to the vertex that lies farthest out in their space, the next to
    the one farthest out in what is left. Only surfaces with symmetries have such axes.

    Parameters
    ----------
    coordinates
        One column per axis, shape (n, k).
    eigenvalues
        One per axis, in order, shape (k,).
    positions
        Vertices of the surface, shape (n, 3): of several vertices equally far out they tell the first.

    Returns
    -------
    numpy.ndarray
        The coordinates along the turned axes, shape (n, k).
    """
    apart = np.abs(np.diff(eigenvalues)) > EQUAL * np.maximum(np.abs(eigenvalues[1:]), np.abs(eigenvalues[:-1]))
    settled = coordinates.copy()
    for columns in np.split(np.arange(len(eigenvalues)), np.flatnonzero(apart) + 1):
        if len(columns) == 1:
            continue
        rest, axes = coordinates[:, columns], []
        for _ in columns:
            farthest = rest[largest((rest**2).sum(axis=1), positions)]
            axes.append(farthest / max(np.linalg.norm(farthest), np.finfo(float).tiny))
            rest = rest - np.outer(rest @ axes[-1], axes[-1])
        settled[:, columns] = coordinates[:, columns] @ np.array(axes).T
    return settled


def canonical_signs(coordinates: FloatArray, weights: FloatArray, positions: FloatArray) -> FloatArray:
    """Choose the sign of each axis so that its weighted third central moment is positive.

    The moment is a sum over the surface, so the choice follows any relabelling of the vertices and hardly depends on
    the sampling. An axis of symmetry has no third moment: there the vertex farthest from the centre decides, of several
    equally far ones the first by its position on the surface. Along an axis that is nearly one a jitter may decide;
    so which of a form and its mirror image it is, is settled by :mod:`baselines._kernels.handedness`, and two signs
    that change together are half a turn, which the scorer tries.

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
    negligible = np.abs(moments) <= NEGLIGIBLE * (weights @ np.abs(centred) ** 3)
    return np.where(np.where(negligible, extremes, moments) < 0, -1.0, 1.0)
