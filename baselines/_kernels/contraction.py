"""Contraction of a closed surface towards its medial curve."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from baselines._kernels.orientation import vertex_areas
from baselines._kernels.refinement import refined_solution
from benchmark.api.contracts import FloatArray
from benchmark.geometry.laplacian import cotangent_laplacian
from benchmark.geometry.mesh import Mesh

RADIUS = 100.0
"""Radius of the surface during the contraction; the schedule of the weights assumes this unit of length."""

FIRST_CONTRACTION = 1e-3
"""Initial contraction weight over the square root of the mean face area."""

CONTRACTION_GROWTH = 3.0
LARGEST_CONTRACTION = 2048.0
LARGEST_ATTRACTION = 10_000.0
MAX_ITERATIONS = 20

STEP = RADIUS * 2.0**-27
"""Multiple to which coordinates are rounded after each iteration. Thin triangles amplify a rounding error about tenfold
in every further iteration, so none may remain."""

AREA_RATIO = 0.01
"""Share of the area at which the contraction ends."""


class ContractionFailed(Exception):
    """Failure of a contraction: the surface became non-finite or degenerate before it was thin."""


def contract(mesh: Mesh) -> FloatArray:
    r"""Contract a closed surface to (almost) zero volume by constrained smoothing (Au et al. 2008, equation 1).

    Each iteration solves, in the least-squares sense,

    .. math:: \begin{bmatrix} W_L L \\ W_H \end{bmatrix} V' = \begin{bmatrix} 0 \\ W_H V \end{bmatrix}

    with the cotangent Laplacian :math:`L` of the current surface. The contraction weight :math:`W_L` triples; the
    attraction weight :math:`W_H` of a vertex grows with the square root of the ratio by which its area has shrunk, so
    that parts that are already thin stay in place. Weights, caps and stopping criterion are those of Pickup et al.
    (2016).

    Parameters
    ----------
    mesh
        Closed, connected surface.

    Returns
    -------
    numpy.ndarray
        Contracted vertices, shape (n, 3), in units of the mesh.

    Raises
    ------
    ContractionFailed
        If the surface degenerates while more than a tenth of its area is left.
    """
    centre = mesh.vertices.mean(axis=0)
    unit = np.linalg.norm(mesh.vertices - centre, axis=1).max() / RADIUS
    current = mesh.with_vertices((mesh.vertices - centre) / unit)
    first_areas = vertex_areas(current)
    contraction = FIRST_CONTRACTION * np.sqrt(current.face_areas.mean())
    attraction = np.ones(current.n_vertices)
    for _ in range(MAX_ITERATIONS):
        if current.area <= AREA_RATIO * first_areas.sum():
            break
        positions = _contraction_step(current, contraction, attraction)
        if not np.isfinite(positions).all() or np.abs(positions).max() > 10 * RADIUS:
            break
        candidate = current.with_vertices(positions)
        areas = vertex_areas(candidate)
        # A vertex whose ring has no area left cannot be smoothed further: the previous surface was the last valid one.
        if areas.min() <= 0.0 or candidate.area > current.area:
            break
        current = candidate
        contraction = min(CONTRACTION_GROWTH * contraction, LARGEST_CONTRACTION)
        attraction = np.minimum(np.sqrt(first_areas / areas), LARGEST_ATTRACTION)
    left = current.area / first_areas.sum()
    if left > 10 * AREA_RATIO:
        raise ContractionFailed(f"{left:.0%} of the area is left")
    return np.asarray(current.vertices * unit + centre)


def _contraction_step(mesh: Mesh, contraction: float, attraction: FloatArray) -> FloatArray:
    laplacian = cotangent_laplacian(mesh).stiffness
    squared: FloatArray = attraction**2
    normal_matrix = csr_array(contraction**2 * (laplacian @ laplacian) + diags_array(squared))
    positions = refined_solution(normal_matrix, squared[:, None] * mesh.vertices)
    return np.asarray(np.round(positions / STEP) * STEP + 0.0)
