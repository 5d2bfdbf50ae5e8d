"""As-rigid-as-possible energy of a surface: rotations of its cells, and the linear system between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from benchmark.api.contracts import FloatArray, Shape
from benchmark.geometry.laplacian import Laplacian

WEIGHT_FLOOR = 1e-2
"""Minimum edge weight, as a share of the mean one. Weights of obtuse pairs of angles are negative or zero: they would
leave the energy without a lower bound, and a vertex between such edges unconstrained."""

AMBIGUOUS = 1e-3
"""Below this value of (s1 + s2)(s2 + s3)(s3 + s1) / (s1^2 + s2^2 + s3^2)^(3/2), with the signed singular values s of a
covariance, its best rotation is nearly ambiguous."""


@dataclass(frozen=True, eq=False)
class AsRigidAsPossible:
    r"""As-rigid-as-possible deformation of one surface (Sorkine & Alexa 2007, equations 3, 6 and 8).

    With rest positions :math:`p`, cotangent weights :math:`w` and one rotation :math:`R_i` per vertex, the energy is

    .. math:: E(x) = \frac12 \sum_i \min_{R_i \in SO(3)} \sum_{j \in N(i)} w_{ij} \|(x_i - x_j) - R_i (p_i - p_j)\|^2.

    For fixed rotations it is quadratic with the matrix :attr:`stiffness`, the Laplacian of the weights, and minimal if
    ``stiffness @ x`` equals :meth:`load`.

    Parameters
    ----------
    rest
        Rest positions, shape (n, 3).
    weights
        Symmetric sparse matrix of positive edge weights, shape (n, n); see :func:`edge_weights`.
    """

    rest: FloatArray
    weights: csr_array

    @classmethod
    def of(cls, shape: Shape, unit: float = 1.0) -> AsRigidAsPossible:
        """Build the energy of a shape at rest, in the given unit of length."""
        return cls(rest=shape.mesh.vertices / unit, weights=edge_weights(shape.laplacian()))

    @property
    def stiffness(self) -> csr_array:
        """Laplacian of the edge weights, shape (n, n): positive semidefinite, rows sum to zero."""
        return csr_array(diags_array(self.weights.sum(axis=1)) - self.weights)

    def rotations(self, positions: FloatArray) -> FloatArray:
        """Return the best proper rotation of each cell, shape (n, 3, 3)."""
        graph = self.weights
        return np.asarray(_cell_rotations(graph.indptr, graph.indices, graph.data, self.rest, positions))

    def load(self, rotations: FloatArray) -> FloatArray:
        """Return the right-hand side for given rotations, shape (n, 3)."""
        graph = self.weights
        return np.asarray(_cell_loads(graph.indptr, graph.indices, graph.data, self.rest, rotations))

    def energy(self, positions: FloatArray, rotations: FloatArray) -> float:
        """Return the energy of positions under given rotations, in squared units of the positions."""
        graph = self.weights
        return float(_energy(graph.indptr, graph.indices, graph.data, self.rest, positions, rotations))

    def factorise(self, diagonal: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Return a solver of ``(stiffness + diag(diagonal)) x = b``.

        Parameters
        ----------
        diagonal
            Non-negative, not all zero, shape (n,); makes the system definite.
        """
        return factorise_definite(csr_array(self.stiffness + diags_array(diagonal)))

    def edge_strains(self, positions: FloatArray) -> FloatArray:
        """Return the relative change in length of each edge, shape (edges,); 0 if the edge kept its length."""
        start, end = _edges(self.weights)
        before = np.linalg.norm(self.rest[start] - self.rest[end], axis=1)
        after = np.linalg.norm(positions[start] - positions[end], axis=1)
        return np.asarray(np.abs(after - before) / np.maximum(before, np.finfo(float).tiny))


def edge_weights(laplacian: Laplacian) -> csr_array:
    """Return the edge weights of a cotangent Laplacian, at least ``WEIGHT_FLOOR`` times their mean, shape (n, n)."""
    weights = csr_array(laplacian.stiffness, copy=True)
    weights.setdiag(0)
    weights.eliminate_zeros()
    weights.sort_indices()
    weights.data = np.maximum(-weights.data, 0.0)
    weights.data = np.maximum(weights.data, WEIGHT_FLOOR * weights.data.mean())
    return weights


def factorise_definite(matrix: csr_array) -> Callable[[FloatArray], FloatArray]:
    """Factorise a symmetric positive definite sparse matrix; the result solves for any number of columns."""
    factors = splu(
        csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )

    def solve(right: FloatArray) -> FloatArray:
        return np.ascontiguousarray(factors.solve(np.asfortranarray(right)))

    return solve


def _edges(weights: csr_array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    rows = np.repeat(np.arange(weights.shape[0]), np.diff(weights.indptr))
    upper = rows < weights.indices
    return rows[upper], weights.indices[upper]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def nearest_rotation(covariance: FloatArray, rotation: FloatArray) -> None:
    r"""Write into ``rotation`` the proper rotation R that maximises trace(R covariance).

    With :math:`B` the transposed covariance, the maximum :math:`\lambda` is the largest root of

    .. math:: (\lambda^2 - \|B\|^2)^2 - 8 \lambda \det B - 4 \|\mathrm{adj} B\|^2 = 0,

    found by Newton's method from above, and :math:`R` follows in closed form (Markley 1993, "Attitude determination
    using vector observations: a fast optimal matrix algorithm"). Reflections cannot occur, and a flat cell, whose
    covariance is singular, is no special case. If the best rotation is nearly ambiguous, the closed form loses digits,
    and an eigenvector replaces it.

    Parameters
    ----------
    covariance
        Sum over points of the outer product of rest vector and deformed vector, shape (3, 3).
    rotation
        Output, shape (3, 3).
    """
    square = 0.0
    for a in range(3):
        for b in range(3):
            square += covariance[a, b] ** 2
    adjugate_square, determinant = 0.0, 0.0
    for a in range(3):
        for b in range(3):
            cofactor = _cofactor(covariance, a, b)
            # The output serves as scratch for the adjugate of the covariance.
            rotation[b, a] = cofactor
            adjugate_square += cofactor**2
            determinant += covariance[a, b] * cofactor / 3.0
    root = np.sqrt(3.0 * square)
    for _ in range(30):
        gap = root * root - square
        value = gap * gap - 8.0 * determinant * root - 4.0 * adjugate_square
        slope = 4.0 * root * gap - 8.0 * determinant
        if slope <= 0.0 or value <= 1e-16 * slope * root:
            break
        root -= value / slope
    kappa = 0.5 * (root * root - square)
    scale = kappa * root - determinant
    if scale <= AMBIGUOUS * square * np.sqrt(square):
        _rotation_by_eigenvector(covariance, rotation)
        return
    product = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            product[a, b] = 0.0
            for c in range(3):
                product[a, b] += covariance[c, a] * covariance[c, b]
    for a in range(3):
        for b in range(3):
            cubic = 0.0
            for c in range(3):
                cubic += product[a, c] * covariance[b, c]
            rotation[a, b] = ((kappa + square) * covariance[b, a] + root * rotation[a, b] - cubic) / scale


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _cofactor(matrix: FloatArray, a: int, b: int) -> float:
    a1, a2, b1, b2 = (a + 1) % 3, (a + 2) % 3, (b + 1) % 3, (b + 2) % 3
    return float(matrix[a1, b1] * matrix[a2, b2] - matrix[a1, b2] * matrix[a2, b1])


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _rotation_by_eigenvector(covariance: FloatArray, rotation: FloatArray) -> None:
    """Find the rotation whose quaternion is the leading eigenvector of Horn's matrix (1987), by cyclic Jacobi steps."""
    matrix = np.empty((4, 4))
    vectors = np.eye(4)
    matrix[0, 0] = covariance[0, 0] + covariance[1, 1] + covariance[2, 2]
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        matrix[a + 1, a + 1] = covariance[a, a] - covariance[b, b] - covariance[c, c]
        matrix[0, a + 1] = matrix[a + 1, 0] = covariance[b, c] - covariance[c, b]
        matrix[b + 1, c + 1] = matrix[c + 1, b + 1] = covariance[b, c] + covariance[c, b]
    size = 0.0
    for i in range(4):
        for j in range(4):
            size += matrix[i, j] ** 2
    for _ in range(12):
        off = 0.0
        for i in range(3):
            for j in range(i + 1, 4):
                off += matrix[i, j] ** 2
        if off <= 1e-28 * size:
            break
        for i in range(3):
            for j in range(i + 1, 4):
                if matrix[i, j] == 0.0:
                    continue
                theta = (matrix[j, j] - matrix[i, i]) / (2.0 * matrix[i, j])
                tangent = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    tangent = -tangent
                cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
                sine = tangent * cosine
                for k in range(4):
                    x, y = matrix[k, i], matrix[k, j]
                    matrix[k, i], matrix[k, j] = cosine * x - sine * y, sine * x + cosine * y
                for k in range(4):
                    x, y = matrix[i, k], matrix[j, k]
                    matrix[i, k], matrix[j, k] = cosine * x - sine * y, sine * x + cosine * y
                    x, y = vectors[k, i], vectors[k, j]
                    vectors[k, i], vectors[k, j] = cosine * x - sine * y, sine * x + cosine * y
    best = 0
    for i in range(1, 4):
        if matrix[i, i] > matrix[best, best]:
            best = i
    w, x, y, z = vectors[0, best], vectors[1, best], vectors[2, best], vectors[3, best]
    rotation[0, 0] = w * w + x * x - y * y - z * z
    rotation[1, 1] = w * w - x * x + y * y - z * z
    rotation[2, 2] = w * w - x * x - y * y + z * z
    rotation[0, 1], rotation[1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    rotation[0, 2], rotation[2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    rotation[1, 2], rotation[2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _cell_rotations(
    starts: NDArray[np.int32], ends: NDArray[np.int32], weights: FloatArray, rest: FloatArray, positions: FloatArray
) -> FloatArray:
    rotations = np.empty((len(rest), 3, 3))
    covariance = np.empty((3, 3))
    for i in range(len(rest)):
        covariance[:] = 0.0
        for k in range(starts[i], starts[i + 1]):
            j = ends[k]
            for a in range(3):
                scaled = weights[k] * (rest[i, a] - rest[j, a])
                for b in range(3):
                    covariance[a, b] += scaled * (positions[i, b] - positions[j, b])
        nearest_rotation(covariance, rotations[i])
    return rotations


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _cell_loads(
    starts: NDArray[np.int32], ends: NDArray[np.int32], weights: FloatArray, rest: FloatArray, rotations: FloatArray
) -> FloatArray:
    loads = np.zeros_like(rest)
    for i in range(len(rest)):
        for k in range(starts[i], starts[i + 1]):
            j = ends[k]
            for a in range(3):
                turned = 0.0
                for b in range(3):
                    turned += (rotations[i, a, b] + rotations[j, a, b]) * (rest[i, b] - rest[j, b])
                loads[i, a] += 0.5 * weights[k] * turned
    return loads


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _energy(
    starts: NDArray[np.int32],
    ends: NDArray[np.int32],
    weights: FloatArray,
    rest: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
) -> float:
    total = 0.0
    for i in range(len(rest)):
        for k in range(starts[i], starts[i + 1]):
            j = ends[k]
            for a in range(3):
                residual = positions[i, a] - positions[j, a]
                for b in range(3):
                    residual -= rotations[i, a, b] * (rest[i, b] - rest[j, b])
                total += 0.5 * weights[k] * residual * residual
    return total
