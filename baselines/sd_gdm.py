"""SD-GDM: the singular values of the geodesic distance matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_pairs, require_vertices
from benchmark.api.contracts import CheckedParameters, FloatArray, GeodesicSolver, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class SDGDM(CheckedParameters):
    r"""The largest singular values of the geodesic distance matrix.

    The values :math:`s_1 \ge s_2 \ge \dots` do not depend on how the vertices are numbered, and hardly on the pose;
    divided by their sum, neither on size nor on the number of vertices. Two shapes differ by the mean-normalised
    Manhattan distance :math:`\sum_k 2 |s_k - t_k| / (s_k + t_k)`. A control: it reads the very matrix that the MDS rows
    read, and makes no canonical form of it. Smeets, Hermans, Vandermeulen and Suetens (2012), "Isometric deformation
    invariant 3D shape recognition".

    Parameters
    ----------
    count
        Number of singular values.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="sd-gdm",
        title="SD-GDM",
        cite="smeets2012sdgdm",
        family="control",
        summary="largest singular values of the geodesic distance matrix",
        scale="invariant",
    )

    count: Annotated[int, Interval(1)] = 20
    solver: GeodesicSolver = "default"

    def describe(self, shape: Shape) -> FloatArray:
        """Return the singular values over their sum, largest first, shape (count,).

        Raises
        ------
        UnsupportedShape
            If the shape has too few vertices for that many singular values, no face, or several pieces, or too many
            vertices for the distances of all pairs.
        """
        from scipy.sparse.linalg import eigsh

        require_vertices(shape, self.count + 1)
        require_pairs(shape)
        distances = shape.geodesics(self.solver)
        # The matrix is symmetric, so its singular values are the sizes of its eigenvalues.
        # Fixed, and without the symmetries that a shape may have: those of a constant never leave the iteration again
        # but for rounding errors, and with them half of the eigenvalues would.
        start = np.random.default_rng(0).standard_normal(len(distances))
        values = eigsh(distances, k=self.count, which="LM", v0=start, return_eigenvectors=False)
        sizes = np.sort(np.abs(values))[::-1]
        return np.asarray(sizes / sizes.sum())

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the mean-normalised Manhattan distances of the descriptors, shape (N, N)."""
        stacked = np.stack(descriptors)
        first, second = stacked[:, None], stacked[None]
        return np.asarray((2 * np.abs(first - second) / (first + second)).sum(axis=2))
