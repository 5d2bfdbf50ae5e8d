"""Fast classical scaling: classic MDS from a few rows of distances, extended over the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.api.contracts import CanonicalForm, CheckedParameters, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class FastClassicalScaling(CheckedParameters):
    r"""Fast classical scaling (FMDS).

    The squared geodesic distances :math:`F` (p x n) from p farthest-point samples s are extended
    over the surface by the matrix P (n x p) whose column j minimises

    .. math:: \| A^{-1} L x \|^2 + \mu \| x_s - e_j \|^2,

    with the cotangent matrix L and the vertex areas A. The average of both extensions,

    .. math:: D \circ D \approx \tfrac12 (P F + F^\top P^\top),

    has the form :math:`Z M Z^\top` with 2p columns in Z, see
    :func:`baselines._kernels.few_rows.low_rank_scaling`. Shamai, Aflalo, Zibulevsky and Kimmel
    (2015), "Classical scaling revisited", and Shamai, Zibulevsky and Kimmel (2018), "Efficient
    inter-geodesic distance computation and fast classical scaling"; equations and defaults are
    those of the authors' released code.

    Parameters
    ----------
    samples
        Number p of farthest-point samples.
    fidelity
        Weight :math:`\mu` of the fit relative to the smoothness, on a surface of mean vertex area
        1.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="fast-classical-scaling",
        title="Fast classical scaling",
        cite="shamai2018fast",
        family="extended",
        summary=(
            "Does what Classic MDS does with the distances of a few points, which it continues "
            "smoothly (FMDS)."
        ),
        departs=(
            "Uses the geodesic distances of Classic MDS; samples are spread by lengths of paths "
            "along edges. The weight of smoothness assumes a mean vertex area of 1; in the "
            "released code it depends on the unit of the file. Signs of the axes, and with them "
            "the mirror image, follow our rule."
        ),
        needs=("connected",),
    )

    samples: Annotated[int, Interval(4)] = 20
    fidelity: Annotated[float, Interval(0, closed="neither")] = 50.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of extended distances, centred at the origin.

        Geodesic distances are computed from a few samples to all vertices. Their squares are
        extended smoothly to all pairs of vertices, which gives a matrix of low rank.

        Returns
        -------
        CanonicalForm
            Its notes are the number of samples, and the stress of the distances from the samples.

        Raises
        ------
        UnsupportedShape
            If the second eigenvalue of the Laplacian is zero.
        """
        from baselines._kernels.few_rows import (
            farthest_points,
            low_rank_scaling,
            smooth_interpolation,
            stress_of_rows,
        )

        samples = farthest_points(shape, self.samples)
        mass = shape.laplacian().mass
        extension = smooth_interpolation(
            shape, samples, weights=(mass / mass.mean()) ** 2, fidelity=self.fidelity
        )
        rows = shape.geodesics_from(samples)
        # With the extension M and the squared distances S of the samples to all vertices, all
        # squared distances are (M S + S^T M^T) / 2.
        halves = np.array([[0.0, 0.5], [0.5, 0.0]])
        coupling = np.asarray(np.kron(halves, np.eye(len(samples))), dtype=np.float64)
        points = low_rank_scaling(shape, np.hstack([extension, rows.T**2]), coupling)
        return shape.form(
            points, samples=len(samples), stress_of_rows=stress_of_rows(points, samples, rows)
        )
