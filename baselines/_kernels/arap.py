"""As-rigid-as-possible energy: rotations of cells, and the linear system between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import igl
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array

from benchmark.api.contracts import FloatArray, Shape

WEIGHT_FLOOR = 1e-2
"""Minimum edge weight, as a share of the mean one. Weights of obtuse pairs of angles are negative
or zero: they would leave the energy without a lower bound, and a vertex between such edges
unconstrained.
"""

AMBIGUOUS = 1e-3
"""Bound below which the closed form of a rotation has not enough digits.

It bounds the product of the sums of two singular values of a covariance each, as a share of the
cube of its norm.
"""

NEWTON_STEPS = 30
"""Most steps of Newton's method towards a sum of singular values."""

LAST_STEP = 1e-15
"""Length of the last of these steps, as a share of the sum."""


@dataclass(frozen=True, eq=False)
class AsRigidAsPossible:
    r"""As-rigid-as-possible deformation of a surface (Sorkine & Alexa 2007, equations 3, 6, 8).

    With rest positions :math:`p`, cotangent weights :math:`w` and one rotation :math:`R_i` per
    vertex, the energy is

    .. math:: E(x) = \frac12 \sum_i \min_{R_i \in SO(3)} \sum_{j \in N(i)}
              w_{ij} \|(x_i - x_j) - R_i (p_i - p_j)\|^2.

    For fixed rotations it is quadratic with the Laplacian of the weights as its matrix, and minimal
    if the product of that matrix and x equals :meth:`load`.

    Parameters
    ----------
    rest
        Rest positions, shape (n, 3).
    weights
        Symmetric sparse matrix of positive edge weights, shape (n, n).
    """

    rest: FloatArray
    weights: csr_array

    @classmethod
    def of(cls, shape: Shape, unit: float = 1.0) -> AsRigidAsPossible:
        """Build the energy of a shape at rest, in the given unit of length."""
        weights = csr_array(shape.laplacian().stiffness, copy=True)
        weights.setdiag(0)
        weights.eliminate_zeros()
        weights.sort_indices()
        weights.data = np.maximum(-weights.data, 0.0)
        weights.data = np.maximum(weights.data, WEIGHT_FLOOR * weights.data.mean())
        return cls(shape.mesh.vertices / unit, weights)

    def rotations(self, positions: FloatArray) -> FloatArray:
        """Return the best proper rotation of each cell, shape (n, 3, 3)."""
        graph = self.weights
        return nearest_rotations(
            _covariances(graph.indptr, graph.indices, graph.data, self.rest, positions)
        )

    def load(self, rotations: FloatArray) -> FloatArray:
        """Return the right-hand side for given rotations, shape (n, 3)."""
        graph = self.weights
        return np.asarray(_loads(graph.indptr, graph.indices, graph.data, self.rest, rotations))

    def energy(self, positions: FloatArray, rotations: FloatArray) -> float:
        """Return the energy of positions under rotations, in squared units of the positions."""
        start = np.repeat(np.arange(len(positions)), np.diff(self.weights.indptr))
        end = self.weights.indices
        turned = np.einsum("eab,eb->ea", rotations[start], self.rest[start] - self.rest[end])
        misses = positions[start] - positions[end] - turned
        return 0.5 * float(self.weights.data @ (misses**2).sum(axis=1))

    def factorise(self, diagonal: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Return a solver of the system with a non-negative diagonal, not all zero, added.

        Shape (n,).
        """
        laplacian = diags_array(self.weights.sum(axis=1) + diagonal) - self.weights
        return factorise_definite(csr_array(laplacian))

    def strains(self, positions: FloatArray) -> dict[str, float]:
        """Return the mean and largest relative change in length of the edges as notes."""
        start = np.repeat(np.arange(len(positions)), np.diff(self.weights.indptr))
        end = self.weights.indices
        before = np.linalg.norm(self.rest[start] - self.rest[end], axis=1)
        after = np.linalg.norm(positions[start] - positions[end], axis=1)
        strains = np.abs(after - before) / np.maximum(before, np.finfo(float).tiny)
        return {
            "mean_edge_strain": float(strains.mean()),
            "largest_edge_strain": float(strains.max()),
        }


def nearest_rotations(covariances: FloatArray) -> FloatArray:
    """Return the proper rotations R that maximise trace(R C), shape (n, 3, 3).

    The matrices C are the covariances of rest and moved points.
    """
    rotations, ambiguous = _closed_form(covariances)
    if ambiguous.any():
        stacked = np.ascontiguousarray(covariances[ambiguous].transpose(1, 0, 2).reshape(-1, 3))
        fitted = np.asarray(igl.fit_rotations(stacked)).reshape(3, -1, 3)
        rotations[ambiguous] = fitted.transpose(1, 0, 2)
    return np.asarray(rotations)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _closed_form(covariances: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the nearest rotations [Markley 1993], and which are too ambiguous for this way.

    In a seventh of the time of singular values. The sum of the (signed) singular values is the
    largest root of a quartic, which Newton's method finds from above; the rotation follows from it.
    """
    count = len(covariances)
    rotations = np.empty_like(covariances)
    ambiguous = np.empty(count, np.bool_)
    squares = np.zeros(count)  # of the norms of the covariances
    areas = np.zeros(count)  # the same of their cofactors
    determinants = np.empty(count)
    for k in range(count):
        matrix = covariances[k]
        cofactors = rotations[k]  # transposed
        for a in range(3):
            for b in range(3):
                c = (a + 1) % 3
                d = (a + 2) % 3
                e = (b + 1) % 3
                f = (b + 2) % 3
                cofactors[b, a] = matrix[c, e] * matrix[d, f] - matrix[c, f] * matrix[d, e]
                squares[k] += matrix[a, b] ** 2
                areas[k] += cofactors[b, a] ** 2
        determinants[k] = (
            matrix[0, 0] * cofactors[0, 0]
            + matrix[0, 1] * cofactors[1, 0]
            + matrix[0, 2] * cofactors[2, 0]
        )
    roots = _largest_roots(squares, areas, determinants)
    gram = np.empty((3, 3))
    for k in range(count):
        matrix = covariances[k]
        rotation = rotations[k]
        square = squares[k]
        root = roots[k]
        for a in range(3):
            for b in range(3):
                gram[a, b] = (
                    matrix[0, a] * matrix[0, b]
                    + matrix[1, a] * matrix[1, b]
                    + matrix[2, a] * matrix[2, b]
                )
        half = 0.5 * (root * root - square)
        # The product of the sums of two singular values each.
        scale = half * root - determinants[k]
        ambiguous[k] = not scale > AMBIGUOUS * square**1.5
        for a in range(3):
            for b in range(3):
                cubic = (
                    gram[a, 0] * matrix[b, 0]
                    + gram[a, 1] * matrix[b, 1]
                    + gram[a, 2] * matrix[b, 2]
                )
                rotation[a, b] = (
                    (half + square) * matrix[b, a] + root * rotation[a, b] - cubic
                ) / scale
    return rotations, ambiguous


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _largest_roots(squares: FloatArray, areas: FloatArray, determinants: FloatArray) -> FloatArray:
    """Return the sums of the signed singular values of matrices, by Newton's method from above.

    Parameters
    ----------
    squares, areas, determinants
        Sum of the squared entries of each matrix, the same of its cofactors, and its determinant.
    """
    roots = np.sqrt(3.0 * squares)
    is_open = np.ones(len(roots), np.bool_)
    # All matrices take a step together, so that the loop over them vectorises.
    for _ in range(NEWTON_STEPS):
        n_open = 0
        for k in range(len(roots)):
            root = roots[k]
            gap = root * root - squares[k]
            step = (gap * gap - 8.0 * determinants[k] * root - 4.0 * areas[k]) / (
                4.0 * root * gap - 8.0 * determinants[k]
            )
            better = root - step
            roots[k] = better if is_open[k] else root
            is_open[k] &= not abs(step) < LAST_STEP * better
            n_open += is_open[k]
        if n_open == 0:
            break
    return roots


def aligned(points: FloatArray, reference: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the points after the proper rigid motion nearest to a reference (Kabsch 1976)."""
    centre = weights @ points / weights.sum()
    goal = weights @ reference / weights.sum()
    covariance = (points - centre).T @ ((reference - goal) * weights[:, None])
    return np.asarray((points - centre) @ nearest_rotations(covariance[None])[0].T + goal)


def factorise_definite(matrix: csr_array) -> Callable[[FloatArray], FloatArray]:
    """Factorise a symmetric positive definite sparse matrix.

    The result solves for any number of columns. The factorisation is Eigen's: it calls no BLAS,
    whose last digits differ between processors.

    Raises
    ------
    RuntimeError
        If the matrix is not positive definite.
    """
    free = np.zeros(0, dtype=np.int64)
    unconstrained = csc_array((0, matrix.shape[0]))
    factors = igl.min_quad_with_fixed_data()
    igl.min_quad_with_fixed_precompute(csc_array(matrix), free, unconstrained, True, factors)

    def solve(right: FloatArray) -> FloatArray:
        fixed = np.zeros((0, right.shape[1]))
        return np.asarray(igl.min_quad_with_fixed_solve(factors, -right, fixed, fixed))

    return solve


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _covariances(
    starts: NDArray[np.int32],
    ends: NDArray[np.int32],
    weights: FloatArray,
    rest: FloatArray,
    positions: FloatArray,
) -> FloatArray:
    """Return the covariances of edges at rest and moved, of each cell, shape (n, 3, 3).

    Parameters
    ----------
    starts, ends, weights
        First edge of each vertex, and end and weight of each edge.
    rest, positions
        Positions of the vertices, shape (n, 3).
    """
    covariances = np.zeros((len(rest), 3, 3))
    for i in range(len(rest)):
        for k in range(starts[i], starts[i + 1]):
            j = ends[k]
            for a in range(3):
                scaled = weights[k] * (rest[i, a] - rest[j, a])
                for b in range(3):
                    covariances[i, a, b] += scaled * (positions[i, b] - positions[j, b])
    return covariances


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _loads(
    starts: NDArray[np.int32],
    ends: NDArray[np.int32],
    weights: FloatArray,
    rest: FloatArray,
    rotations: FloatArray,
) -> FloatArray:
    """Return the right-hand side for rotations of the cells, shape (n, 3).

    The other parameters are those of :func:`_covariances`.
    """
    loads = np.zeros_like(rest)
    for i in range(len(rest)):
        for k in range(starts[i], starts[i + 1]):
            j = ends[k]
            for a in range(3):
                for b in range(3):
                    turn = rotations[i, a, b] + rotations[j, a, b]
                    loads[i, a] += 0.5 * weights[k] * turn * (rest[i, b] - rest[j, b])
    return loads
