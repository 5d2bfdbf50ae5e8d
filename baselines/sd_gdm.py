"""SD-GDM: the singular values of the geodesic distance matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.api.contracts import (
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
    UnsupportedShape,
)


@dataclass(frozen=True, kw_only=True)
class SDGDM(CheckedParameters):
    r"""Largest singular values of the geodesic distance matrix.

    The values :math:`s_1 \ge s_2 \ge \dots` do not depend on the order of the vertices, and hardly
    on the pose. Divided by their sum, they do not depend on the size, and hardly on the number of
    vertices. Shapes are compared by the mean-normalised Manhattan distance :math:`\sum_k 2 |s_k -
    t_k| / (s_k + t_k)`. A control: it uses the same matrix as the MDS rows, but without a canonical
    form. Smeets, Hermans, Vandermeulen and Suetens (2012), "Isometric deformation invariant 3D
    shape recognition".

    Parameters
    ----------
    count
        Number of singular values.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="sd-gdm",
        title="SD-GDM",
        cite="smeets2012sdgdm",
        family="control",
        summary=(
            "Compares the largest singular values of the matrix of all distances along the surface."
        ),
        departs=(
            "Uses the geodesic distances of Classic MDS, of all vertices, not weighted by their "
            "areas. The number of singular values, and the division by their sum, are ours."
        ),
        scale="invariant",
        needs=("pairs",),
    )

    count: Annotated[int, Interval(1)] = 20

    def describe(self, shape: Shape) -> FloatArray:
        """Return the largest singular values of the matrix of geodesic distances.

        Returns
        -------
        numpy.ndarray
            The singular values divided by their sum, largest first, shape (count,).

        Raises
        ------
        UnsupportedShape
            If the shape has no more vertices than singular values are asked for.
        """
        from scipy.linalg.blas import dsymv
        from scipy.sparse.linalg import LinearOperator, eigsh

        distances = shape.geodesics()
        if self.count >= len(distances):
            raise UnsupportedShape(
                f"{shape.identifier}: {len(distances)} vertices",
                f"more than {self.count} are needed",
            )

        def multiply(vector: FloatArray) -> FloatArray:
            """Return the product of the symmetric distances and a vector."""
            # BLAS reads one half of the matrix. Transposed, it is in the order of BLAS (columns
            # first) and is not copied.
            return np.asarray(dsymv(1.0, distances.T, vector))

        # The singular values of a symmetric matrix are the absolute values of its eigenvalues. The
        # iteration begins at random: from a constant vector, it would miss the eigenvectors of a
        # symmetric shape that change their sign from left to right.
        start = np.random.default_rng(0).standard_normal(len(distances))
        operator = LinearOperator(distances.shape, multiply, dtype=np.float64)
        values = eigsh(operator, k=self.count, which="LM", v0=start, return_eigenvectors=False)
        singular_values = np.sort(np.abs(values))[::-1]
        shares = singular_values / singular_values.sum()
        return np.asarray(shares.round(9))  # further digits depend on the processor

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the mean-normalised Manhattan distances between the descriptors, shape (N, N)."""
        first = np.stack(descriptors)[:, None]
        second = np.stack(descriptors)[None]
        return np.asarray((2 * np.abs(first - second) / (first + second)).sum(axis=2))
