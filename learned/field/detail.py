"""Forms that keep the detail of the input: only positions and rotations of parts are predicted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from benchmark.api.contracts import FloatArray
from benchmark.geometry.laplacian import Laplacian
from benchmark.geometry.mesh import Points

WEIGHT_FLOOR = 1e-2
"""Smallest edge weight, as a share of the mean weight: cotangents of obtuse pairs are negative or zero."""

INERTIA = 1e-3
"""Weight of the previous rotation of a cell, as a share of the weight of its edges: a cell whose edges do not determine
its rotation keeps the previous one."""


@dataclass(frozen=True, eq=False)
class Rest:
    """The input surface, undeformed.

    Parameters
    ----------
    positions
        Vertices, shape (n, 3).
    weights
        Positive weights of the edges, symmetric, shape (n, n).
    mass
        Share of the area of each vertex, shape (n,).
    """

    positions: Points
    weights: csr_array
    mass: FloatArray

    @classmethod
    def of(cls, positions: Points, laplacian: Laplacian) -> Rest:
        """Build the surface of unit area at these positions; its Laplacian may be of any size and position."""
        weights = csr_array(-laplacian.stiffness)
        weights.setdiag(0)
        weights.eliminate_zeros()
        weights.sort_indices()
        weights.data = np.maximum(weights.data, 0.0)
        weights.data = np.maximum(weights.data, WEIGHT_FLOOR * weights.data.mean())
        return cls(positions, weights, laplacian.mass / laplacian.mass.sum())


def with_detail(rest: Rest, positions: Points, rotations: FloatArray, reach: float, rounds: int) -> Points:
    r"""Return positions near the predicted ones, with the edges of the input, rotated.

    Minimise

    .. math:: \frac12 \sum_{ij} w_{ij} \|(x_i - x_j) - R_i (p_i - p_j)\|^2 + \rho^{-2} \sum_i m_i \|x_i - y_i\|^2

    over the positions :math:`x` for the predicted rotations :math:`R`, and then alternately over rotations and
    positions: as-rigid-as-possible deformation [Sorkine & Alexa 2007, equations 3 and 8] with a term that attracts it
    to the predicted positions :math:`y`. Details smaller than :math:`\rho` come from the input :math:`p`, the positions
    of larger parts from the prediction.

    Parameters
    ----------
    rest
        The input, of unit area, n vertices.
    positions
        Predicted positions, shape (n, 3).
    rotations
        Predicted rotations, shape (n, 3, 3).
    reach
        Length :math:`\rho`, in units of sqrt(area); 0 returns the predicted positions.
    rounds
        Rounds of fitting rotations, and then positions, after the first positions.

    Returns
    -------
    numpy.ndarray
        Shape (n, 3).
    """
    if reach == 0:
        return positions
    screen = rest.mass / reach**2
    degrees = rest.weights.sum(axis=1)
    matrix = csc_array(diags_array(degrees + screen) - rest.weights)
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    cells = _Cells.of(rest)
    held = screen[:, None] * positions
    refined = factors.solve(cells.load(rotations) + held)
    for _ in range(rounds):
        rotations = cells.rotations(refined, rotations)
        refined = factors.solve(cells.load(rotations) + held)
    return np.asarray(refined)


@dataclass(frozen=True, eq=False)
class _Cells:
    """Edges around each vertex.

    Parameters
    ----------
    starts, ends
        Vertices of each directed edge, shape (e,).
    weights
        Shape (e,).
    edges
        Vectors from end to start, shape (e, 3).
    sums
        Matrix that sums values of edges over their starts, shape (n, e).
    """

    starts: FloatArray
    ends: FloatArray
    weights: FloatArray
    edges: Points
    sums: csr_array

    @classmethod
    def of(cls, rest: Rest) -> _Cells:
        graph = rest.weights
        starts = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr))
        edges = rest.positions[starts] - rest.positions[graph.indices]
        sums = csr_array(
            (np.ones(len(starts)), np.arange(len(starts)), graph.indptr), shape=(graph.shape[0], len(starts))
        )
        return cls(starts, graph.indices, graph.data, edges, sums)

    def load(self, rotations: FloatArray) -> FloatArray:
        """Return the right-hand side for rotations, shape (n, 3)."""
        between = 0.5 * (rotations[self.starts] + rotations[self.ends])
        turned = np.einsum("eij,ej->ei", between, self.edges)
        return np.asarray(self.sums @ (self.weights[:, None] * turned))

    def rotations(self, positions: Points, before: FloatArray) -> FloatArray:
        """Return the best-fitting rotations of the cells, shape (n, 3, 3); see :data:`INERTIA`."""
        now = positions[self.starts] - positions[self.ends]
        products = (self.weights[:, None, None] * now[:, :, None] * self.edges[:, None, :]).reshape(-1, 9)
        size = self.sums @ (self.weights * (self.edges**2).sum(axis=1))
        size = np.maximum(size, np.finfo(float).tiny)
        covariances = (self.sums @ products).reshape(-1, 3, 3) / size[:, None, None] + INERTIA * before
        left, _, right = np.linalg.svd(covariances)
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        return np.asarray(left @ right)
