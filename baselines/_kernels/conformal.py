"""Conformal factors of a surface, and the tips of limbs at their maxima."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from baselines._kernels.arap import factorise_definite
from baselines._kernels.orientation import TIE, largest
from baselines._kernels.sampling import edge_graph, within
from benchmark.api.contracts import FloatArray, Mesh, Shape
from benchmark.geometry.laplacian import Laplacian
from benchmark.geometry.mesh import edges_of

HOLD = 1e-9
"""Share of the mass added to make the Laplacian definite, far below its first eigenvalue."""

EVEN = 1e-3
"""Factors below this are those of an evenly curved surface: it would have to shrink by only a thousandth."""


def angle_defects(mesh: Mesh) -> FloatArray:
    """Return the Gaussian curvature of each vertex, shape (n,): 2 pi (pi at a boundary) minus its triangles' angles.

    The sum is 2 pi times the Euler characteristic (Gauss and Bonnet), with or without a boundary.
    """
    corners = mesh.vertices[mesh.faces]
    forth, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    angles = np.arctan2(np.linalg.norm(np.cross(forth, back), axis=2), (forth * back).sum(axis=2))
    edges = edges_of(mesh.faces)
    full = np.full(mesh.n_vertices, 2 * np.pi)
    full[edges.ends[edges.counts == 1].ravel()] = np.pi
    return np.asarray(full - np.bincount(mesh.faces.ravel(), angles.ravel(), mesh.n_vertices))


def conformal_factors(mesh: Mesh, laplacian: Laplacian) -> FloatArray:
    r"""Return the logarithms :math:`\phi` of the scale by which a surface must shrink to become evenly curved.

    Multiplying lengths by :math:`e^{-\phi}` turns the Gaussian curvature K of the vertices into :math:`K - L \phi` with
    the positive semidefinite Laplacian L, so that

    .. math:: L \phi = K - \frac{\sum K}{A} M

    spreads it evenly over the area. Tips of limbs shrink most. Ben-Chen and Gotsman (2008), "Characterizing shape using
    conformal factors".

    Parameters
    ----------
    mesh
        A connected surface.
    laplacian
        Laplacian of the mesh.

    Returns
    -------
    numpy.ndarray
        Shape (n,), with mean 0 over the surface, without unit.
    """
    shares = laplacian.mass / laplacian.mass.sum()
    curvature = angle_defects(mesh)
    definite = csr_array(laplacian.stiffness + diags_array(HOLD * shares))
    factors = factorise_definite(definite)((curvature - curvature.sum() * shares)[:, None])[:, 0]
    return np.asarray(factors - shares @ factors)


def tips(shape: Shape, most: int, spacing: float) -> list[int]:
    """Return the vertices at positive local maxima of the conformal factor, the highest first.

    Parameters
    ----------
    shape
        A connected shape.
    most
        Maximum number of tips.
    spacing
        Minimum distance between two tips along the edges, as a share of the square root of the area; of two closer
        ones, the lower is left out.

    Returns
    -------
    list of int
        Vertex indices; an evenly curved surface has none.
    """
    mesh = shape.mesh
    factors = conformal_factors(mesh, shape.laplacian())
    ends = edges_of(mesh.faces).ends
    highest = factors.copy()
    np.maximum.at(highest, ends[:, 0], factors[ends[:, 1]])
    np.maximum.at(highest, ends[:, 1], factors[ends[:, 0]])
    margin = TIE * float(np.abs(factors).max())
    left = np.where((factors >= highest - margin) & (factors > EVEN), factors, -np.inf)
    graph, radius = edge_graph(shape), spacing * float(np.sqrt(mesh.area))
    chosen: list[int] = []
    while len(chosen) < most and left.max() > 0:
        chosen.append(largest(left, mesh.vertices))
        left[within(graph, chosen[-1], radius)] = -np.inf
    return chosen
