"""Springs along the edges of a surface, with a few points that push each other apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array

from baselines._kernels.arap import factorise_definite
from baselines._kernels.orientation import vertex_areas
from benchmark.api.contracts import FloatArray, Mesh
from benchmark.geometry.mesh import edges_of

HOLD = 1e-6
"""Weight that holds each vertex at its current position. Springs and pushes are invariant under translation, so the
system needs a hold; one at the current position keeps the descent monotone."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs of equal stiffness along the edges of a surface, at rest in the input.

    Parameters
    ----------
    ends
        The two vertices of each edge, shape (m, 2).
    lengths
        Rest length of each edge, shape (m,).
    masses
        Share of each vertex in the area, shape (n,); defines the centre.
    """

    ends: NDArray[np.int64]
    lengths: FloatArray
    masses: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> Springs:
        """Place springs along the edges of a mesh."""
        ends = np.asarray(edges_of(mesh.faces).ends, dtype=np.int64)
        lengths = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
        areas = vertex_areas(mesh)
        return cls(ends, lengths, areas / areas.sum())

    @cached_property
    def incidence(self) -> csr_array:
        """Matrix from positions to differences along the edges, shape (m, n)."""
        m = len(self.ends)
        signs = np.concatenate([np.ones(m), -np.ones(m)])
        where = (np.tile(np.arange(m), 2), self.ends.T.ravel())
        return csr_array(coo_array((signs, where), shape=(m, len(self.masses))))

    @cached_property
    def solve(self) -> Callable[[FloatArray], FloatArray]:
        """Solver of the graph Laplacian with the hold."""
        n = len(self.masses)
        return factorise_definite(csr_array(self.incidence.T @ self.incidence + diags_array(np.full(n, HOLD))))

    def strains(self, positions: FloatArray) -> FloatArray:
        """Return the relative change in length of each edge, shape (m,)."""
        lengths = np.linalg.norm(self.incidence @ positions, axis=1)
        return np.asarray(np.abs(lengths - self.lengths) / np.maximum(self.lengths, np.finfo(float).tiny))

    def energy(self, positions: FloatArray, points: Sequence[int], push: float) -> float:
        """Return half the squared extension of all springs, minus the push times the distances between all points."""
        extension = np.linalg.norm(self.incidence @ positions, axis=1) - self.lengths
        pairs = len(points) * (len(points) - 1) / 2
        return float(extension @ extension) / 2 - push * pairs * self.spread(positions, points)

    def spread(self, positions: FloatArray, points: Sequence[int]) -> float:
        """Return the mean distance between two of the points."""
        chosen = positions[points]
        away = np.linalg.norm(chosen[:, None] - chosen, axis=2)
        return float(away.sum() / (len(points) * (len(points) - 1)))

    def relax(self, positions: FloatArray, points: Sequence[int], push: float, steps: int) -> FloatArray:
        """Take majorisation steps, which never raise :meth:`energy`.

        Parameters
        ----------
        positions
            Initial positions, shape (n, 3).
        points
            Vertices that push each other apart.
        push
            Strength of the push between each pair, in units of length.
        steps
            Number of steps.
        """
        chosen = list(points)
        for _ in range(steps):
            differences = self.incidence @ positions
            load = self.incidence.T @ (differences * _over(self.lengths, np.linalg.norm(differences, axis=1))[:, None])
            offsets = positions[chosen][:, None] - positions[chosen]
            load[chosen] += push * (offsets * _over(1.0, np.linalg.norm(offsets, axis=2))[..., None]).sum(axis=1)
            positions = self.solve(load + HOLD * positions)
        return positions


def _over(numerator: FloatArray | float, denominator: FloatArray) -> FloatArray:
    """Return the quotient, or 0 if the denominator is 0: coincident points neither pull nor push."""
    return np.divide(numerator, denominator, out=np.zeros_like(denominator), where=denominator > 0)
