"""Global point signature: embedding of a surface by its Laplacian eigenfunctions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from baselines._kernels.orientation import oriented, side_notes
from benchmark.api.contracts import CanonicalForm, CheckedParameters, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class GPS(CheckedParameters):
    r"""Global point signature of the first three non-constant eigenfunctions.

    With :math:`L \phi_k = \lambda_k M \phi_k` for the cotangent Laplacian L and the mass matrix M, vertex x moves to

    .. math:: \left( \phi_1(x) / \sqrt{\lambda_1},\; \phi_2(x) / \sqrt{\lambda_2},\; \phi_3(x) / \sqrt{\lambda_3}
              \right).

    The eigenfunctions have unit norm on the surface, so the form depends on neither the position nor the size of the
    shape. Their signs are arbitrary: the first two axes point to the side of positive area-weighted third moment, and
    the third chooses between the form and its mirror image, see :mod:`baselines._kernels.orientation`. Eigenfunctions
    of nearly equal eigenvalues may swap between poses; the notes give the relative gaps. Rustamov (2007),
    "Laplace-Beltrami eigenfunctions for deformation invariant shape representation".

    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="gps",
        title="GPS",
        cite="rustamov2007gps",
        family="paper",
        summary="first three Laplacian eigenfunctions over the square roots of their eigenvalues",
        departs=(
            "The first three of Rustamov's infinitely many coordinates, drawn as a surface; his descriptor is "
            "histograms of distances in the whole embedding. Signs of axes and the side of the mirror follow a rule of "
            "ours."
        ),
        scale="invariant",
    )

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the global point signatures of the vertices.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than five vertices, no face, or several pieces.
        """
        from benchmark.geometry.laplacian import eigenpairs

        require_vertices(shape, 5)
        require_connected(shape)
        laplacian = shape.laplacian()
        values, functions = eigenpairs(laplacian, 5)
        # The constant function comes first; the fourth non-constant one only gives the gap to the next axis.
        values, functions = values[1:], functions[:, 1:4]
        points = functions / np.sqrt(values[:3])
        points = oriented(shape.mesh, points, values[:3], areas=laplacian.mass)
        gaps = np.diff(values) / values[:-1]
        return shape.form(
            points,
            eigenvalue_1=float(values[0] * laplacian.mass.sum()),
            eigenvalue_gap_12=float(gaps[0]),
            eigenvalue_gap_23=float(gaps[1]),
            eigenvalue_gap_34=float(gaps[2]),
            **side_notes(points, laplacian.mass),
        )
