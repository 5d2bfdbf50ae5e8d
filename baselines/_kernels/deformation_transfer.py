"""Deformation of a surface by prescribed rotations of its triangles."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from baselines._kernels.arap import factorise_definite
from baselines._kernels.orientation import vertex_areas
from benchmark.api.contracts import FloatArray
from benchmark.geometry.mesh import Mesh

SLIVER = 1e-6
"""Areas below this share of the mean are raised to it, so that cotangents stay finite."""


def follow_rotations(mesh: Mesh, rotations: FloatArray) -> FloatArray:
    r"""Return the positions whose triangles best follow the prescribed rotations.

    A fourth vertex off its plane turns each triangle into a simplex (Sumner & Popović 2004; Yan et al. 2008), and the
    positions minimise :math:`\sum_f A_f \|F_f - R_f\|_F^2` over the deformation gradients :math:`F_f`. The fourth
    vertex belongs to one simplex only, where it matches the prescribed normal exactly; eliminating it leaves the
    tangential part of the gradient, and with it the Poisson system of the cotangent Laplacian

    .. math:: L x = b, \qquad b_i = \tfrac12 \sum_{f \ni i} \sum_{j \in f} \cot\alpha_{ij}^f \, R_f (p_i - p_j).

    Parameters
    ----------
    mesh
        Connected surface, positions p.
    rotations
        One rotation per triangle, shape (m, 3, 3).

    Returns
    -------
    numpy.ndarray
        Shape (n, 3); the centroid, weighted by vertex areas, does not change.
    """
    vertices, faces, n = mesh.vertices, mesh.faces, mesh.n_vertices
    double_areas = 2 * np.maximum(mesh.face_areas, SLIVER * mesh.face_areas.mean())
    rows, columns, entries = [], [], []
    load = np.zeros((n, 3))
    for corner in range(3):
        start, end = faces[:, (corner + 1) % 3], faces[:, (corner + 2) % 3]
        apex = vertices[faces[:, corner]]
        cotangents = np.einsum("fi,fi->f", vertices[start] - apex, vertices[end] - apex) / double_areas
        turned = np.einsum("fij,fj->fi", rotations, vertices[start] - vertices[end])
        flow = 0.5 * cotangents[:, None] * turned
        for axis in range(3):
            load[:, axis] += np.bincount(start, weights=flow[:, axis], minlength=n)
            load[:, axis] -= np.bincount(end, weights=flow[:, axis], minlength=n)
        rows += [start, end]
        columns += [end, start]
        entries += [-0.5 * cotangents] * 2
    off_diagonal = coo_array((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n))
    diagonal = -off_diagonal.sum(axis=1)
    # The load sums to zero, so a spring at one vertex fixes the translation without any other effect.
    diagonal[0] += diagonal.mean()
    system = csr_array(diags_array(diagonal) + off_diagonal)
    areas = vertex_areas(mesh)
    positions = factorise_definite(system)(load)
    return np.asarray(positions + areas @ (vertices - positions) / areas.sum())
