"""ShapeDNA: the lowest eigenvalues of the Laplacian of a surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.spectrum import spectrum
from benchmark.api.contracts import CheckedParameters, FloatArray, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class ShapeDNA(CheckedParameters):
    r"""First non-zero eigenvalues of the Laplacian, times the surface area.

    With :math:`L \phi_k = \lambda_k M \phi_k`, the descriptor is :math:`(A \lambda_1, \dots, A
    \lambda_k)`. It is invariant under bending, and the area A removes the scale. Shapes are
    compared by Euclidean distance. A control without a canonical form. Reuter, Wolter and Peinecke
    (2006), "Laplace-Beltrami spectra as Shape-DNA of surfaces and solids".

    Parameters
    ----------
    count
        Number of eigenvalues.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="shape-dna",
        title="ShapeDNA",
        cite="reuter2006shapedna",
        family="control",
        summary="Compares the lowest frequencies at which the surface would vibrate.",
        departs="Linear elements with lumped masses; the source uses cubic elements.",
        scale="invariant",
        needs=("connected",),
    )

    count: Annotated[int, Interval(1)] = 12

    def describe(self, shape: Shape) -> FloatArray:
        """Return the eigenvalues times the area, ascending, shape (count,).

        Raises
        ------
        UnsupportedShape
            If the second eigenvalue of the Laplacian is zero, or the shape has too few vertices.
        """
        values = spectrum(shape, self.count)[0] * shape.laplacian().mass.sum()
        return np.asarray(values.round(6))  # further digits depend on the processor

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the Euclidean distances between the descriptors, shape (N, N)."""
        from scipy.spatial.distance import cdist  # lazy

        return np.asarray(cdist(descriptors, descriptors))
