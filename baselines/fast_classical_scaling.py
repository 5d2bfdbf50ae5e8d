"""Fast classical scaling: classic MDS from a few rows of geodesic distances, extended smoothly over the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from baselines._kernels.orientation import low_rank_scaling, side_notes, vertex_areas
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    Interval,
    MethodInfo,
    Shape,
)


@dataclass(frozen=True, kw_only=True)
class FastClassicalScaling(CheckedParameters):
    r"""Fast classical scaling (FMDS).

    The squared geodesic distances :math:`F` (p x n) from p farthest-point samples s are extended over the surface by
    the matrix P (n x p) whose column j minimises

    .. math:: \| A^{-1} L x \|^2 + \mu \| x_s - e_j \|^2,

    with the cotangent matrix L and the vertex areas A. The average of both extensions,

    .. math:: D \circ D \approx \tfrac12 (P F + F^\top P^\top),

    has the form :math:`Z M Z^\top` with 2p columns in Z, see :func:`baselines._kernels.orientation.low_rank_scaling`.
    Shamai, Aflalo, Zibulevsky and Kimmel (2015), "Classical scaling revisited", and Shamai, Zibulevsky and Kimmel
    (2018), "Efficient inter-geodesic distance computation and fast classical scaling"; equations and defaults are those
    of the authors' released code.

    Parameters
    ----------
    samples
        Number p of farthest-point samples.
    fidelity
        Weight :math:`\mu` of the fit relative to the smoothness, on a surface of mean vertex area 1.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="fast-classical-scaling",
        title="Fast classical scaling",
        cite="shamai2018fast",
        family="extended",
        summary="classic scaling from few rows of geodesic distances, continued smoothly both ways (FMDS)",
        departs=(
            "The weight of the fit holds for a mean vertex area of 1, in the released code for the units of the file. "
            "Signs of axes and the side of the mirror follow a rule of ours."
        ),
    )

    samples: Annotated[int, Interval(4)] = 20
    fidelity: Annotated[float, Interval(0, closed="neither")] = 50.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the extended distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces.
        """
        from baselines._kernels.interpolation import smooth_interpolation
        from baselines._kernels.sampling import farthest_points, stress_of_rows

        require_vertices(shape)
        require_connected(shape)
        samples = farthest_points(shape, self.samples)
        rows = shape.geodesics_from(samples)
        laplacian = shape.laplacian()
        areas = laplacian.mass / laplacian.mass.mean()
        interpolation = smooth_interpolation(laplacian, samples, weights=areas**2, fidelity=self.fidelity)
        half, zero = np.eye(len(samples)) / 2, np.zeros((len(samples), len(samples)))
        points = low_rank_scaling(
            shape.mesh, np.hstack([interpolation, rows.T**2]), np.block([[zero, half], [half, zero]])
        )
        return shape.form(
            points,
            samples=len(samples),
            stress_of_rows=stress_of_rows(points, samples, rows),
            **side_notes(points, vertex_areas(shape.mesh)),
        )
