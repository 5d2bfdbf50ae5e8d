"""Preservation of edge lengths of a posed skin: as-rigid-as-possible relaxation with springs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from benchmark.geometry.laplacian import cotangent_laplacian
from benchmark.geometry.mesh import Mesh

SPRING = 0.0008
"""Stiffness of the springs to the target positions, relative to the stiffness of an edge."""

TURNS = 4
"""Iterations for the rotation of a vertex, starting from its previous rotation."""


@dataclass(frozen=True)
class Relaxation:
    """As-rigid-as-possible relaxation (Sorkine and Alexa, 2007, equation 3) with springs, factorised once per skin.

    Minimises sum_ij w_ij |(x_i - x_j) - R_i (p_i - p_j)|^2 + sum_i s_i |x_i - y_i|^2 over positions x and rotations R,
    with rest positions p, target positions y, cotangent weights w and spring stiffness s.
    """

    rest: NDArray[np.float64]
    first: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    stiffness: NDArray[np.float64]
    springs: NDArray[np.float64]
    factor: Any

    @classmethod
    def of(cls, mesh: Mesh, weights: NDArray[np.float64]) -> Relaxation:
        """Prepare the relaxation of a skin.

        Parameters
        ----------
        mesh
            The skin in the rest pose.
        weights
            Bone weights, shape (n, bones): springs are strong on vertices dominated by one bone and weak at joints.
        """
        rest = np.array(mesh.vertices)
        edges = sparse.csr_matrix(-cotangent_laplacian(mesh).stiffness)
        edges.setdiag(0.0)
        edges.eliminate_zeros()
        # Negative weights of obtuse triangle pairs would let the skin fold.
        edges.data = np.maximum(edges.data, 1e-3)
        springs = SPRING * weights.max(axis=1) ** 4
        system = sparse.diags(np.asarray(edges.sum(axis=1)).ravel() + springs) - edges
        return cls(rest, edges.indptr, edges.indices, edges.data, springs, splu(system.tocsc()))

    def __call__(
        self, targets: NDArray[np.float64], rotations: NDArray[np.float64], iterations: int
    ) -> NDArray[np.float64]:
        """Relax the skin by alternating local and global steps.

        Parameters
        ----------
        targets
            Target positions of the vertices, shape (n, 3).
        rotations
            Initial rotation of each vertex, shape (n, 3, 3).
        iterations
            Number of pairs of steps.

        Returns
        -------
        numpy.ndarray
            Relaxed positions, shape (n, 3).
        """
        positions, rotations = targets, np.ascontiguousarray(rotations)
        skin = (self.rest, self.first, self.neighbours, self.stiffness)
        for _ in range(iterations):
            rotations = _local_rotations(positions, rotations, *skin)
            positions = self.factor.solve(_forces(rotations, *skin) + self.springs[:, None] * targets)
        return np.asarray(positions)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _local_rotations(
    positions: NDArray[np.float64],
    rotations: NDArray[np.float64],
    rest: NDArray[np.float64],
    first: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    stiffness: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the best rotation of each edge star, by the iteration of Müller, Bender, Chentanez and Macklin (2016)."""
    result = np.empty_like(rotations)
    covariance = np.empty((3, 3))
    for i in range(len(positions)):
        covariance[:] = 0.0
        for e in range(first[i], first[i + 1]):
            j = neighbours[e]
            for a in range(3):
                now = stiffness[e] * (positions[i, a] - positions[j, a])
                for b in range(3):
                    covariance[a, b] += now * (rest[i, b] - rest[j, b])
        r = result[i]
        r[:] = rotations[i]
        for _ in range(TURNS):
            x = y = z = trace = 0.0
            for b in range(3):
                x += r[1, b] * covariance[2, b] - r[2, b] * covariance[1, b]
                y += r[2, b] * covariance[0, b] - r[0, b] * covariance[2, b]
                z += r[0, b] * covariance[1, b] - r[1, b] * covariance[0, b]
                trace += r[0, b] * covariance[0, b] + r[1, b] * covariance[1, b] + r[2, b] * covariance[2, b]
            length = np.sqrt(x * x + y * y + z * z)
            angle = length / (abs(trace) + 1e-9)
            if angle < 1e-7:
                break
            x, y, z = x / length, y / length, z / length
            cosine, sine = np.cos(angle), np.sin(angle)
            for b in range(3):
                u, v, w = r[0, b], r[1, b], r[2, b]
                along = (1.0 - cosine) * (x * u + y * v + z * w)
                r[0, b] = cosine * u + sine * (y * w - z * v) + along * x
                r[1, b] = cosine * v + sine * (z * u - x * w) + along * y
                r[2, b] = cosine * w + sine * (x * v - y * u) + along * z
    return result


@njit(cache=True)  # type: ignore[untyped-decorator]
def _forces(
    rotations: NDArray[np.float64],
    rest: NDArray[np.float64],
    first: NDArray[np.int32],
    neighbours: NDArray[np.int32],
    stiffness: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the right-hand side of the global step, shape (n, 3)."""
    result = np.zeros_like(rest)
    for i in range(len(rest)):
        for e in range(first[i], first[i + 1]):
            j = neighbours[e]
            for a in range(3):
                for b in range(3):
                    turn = 0.5 * stiffness[e] * (rotations[i, a, b] + rotations[j, a, b])
                    result[i, a] += turn * (rest[i, b] - rest[j, b])
    return result
