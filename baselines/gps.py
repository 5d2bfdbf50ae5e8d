"""Global point signature: the lowest eigenfunctions of the Laplacian as coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baselines._kernels.spectrum import spectrum
from benchmark.api.contracts import CanonicalForm, CheckedParameters, MethodInfo, Shape
from benchmark.geometry.embedding import oriented


@dataclass(frozen=True, kw_only=True)
class GPS(CheckedParameters):
    r"""Global point signature of the first three non-constant eigenfunctions.

    With :math:`L \phi_k = \lambda_k M \phi_k` for the cotangent Laplacian L and the mass matrix M,
    vertex x moves to

    .. math:: \left( \phi_1(x) / \sqrt{\lambda_1},\; \phi_2(x) / \sqrt{\lambda_2},\;
              \phi_3(x) / \sqrt{\lambda_3} \right).

    The eigenfunctions have unit norm on the surface, so the form depends on neither the position
    nor the size of the shape. Signs and the side of the mirror follow
    :func:`benchmark.api.oriented`. Eigenfunctions of nearly equal eigenvalues may swap between
    poses; the notes give the relative gaps. Rustamov (2007), "Laplace-Beltrami eigenfunctions for
    deformation invariant shape representation".
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="gps",
        title="GPS",
        cite="rustamov2007gps",
        family="paper",
        summary=(
            "Takes the three slowest vibrations of the surface as coordinates: bending hardly "
            "changes them."
        ),
        departs=(
            "Uses the first three of Rustamov's infinitely many coordinates as a surface; his "
            "descriptor is histograms of distances in the whole embedding. Signs of the axes, and "
            "with them the mirror image, follow our rule."
        ),
        scale="invariant",
        needs=("connected",),
    )

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the global point signatures of the vertices.

        Raises
        ------
        UnsupportedShape
            If the second eigenvalue of the Laplacian is zero, or the shape has fewer than five
            vertices.
        """
        values, functions = spectrum(shape, 4)  # the fourth only gives the gap to the next axis
        mass = shape.laplacian().mass
        points = oriented(functions[:, :3] / np.sqrt(values[:3]), mass)
        gaps = (np.diff(values) / values[:-1]).tolist()
        notes = {f"eigenvalue_gap_{k + 1}{k + 2}": gap for k, gap in enumerate(gaps)}
        return shape.form(points, eigenvalue_1=float(values[0] * mass.sum()), **notes)
