"""Accelerated MDS: classic MDS from a few rows of geodesic distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from benchmark.api.contracts import CanonicalForm, CheckedParameters, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class AcceleratedMDS(CheckedParameters):
    r"""Classic MDS without all pairwise distances.

    The matrix P (n x p) of biharmonic (Laplace-Beltrami) interpolation extends the squared
    distances W (p x p) between p farthest-point samples over the surface: :math:`D \circ D \approx
    P W P^\top`. Shamai, Zibulevsky and Kimmel (2015), "Accelerating the computation of canonical
    forms for 3D nonrigid objects using multidimensional scaling".

    Parameters
    ----------
    samples
        Number p of farthest-point samples.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="accelerated-mds",
        title="Accelerated MDS",
        cite="shamai2015accelerated",
        family="extended",
        summary=(
            "Does what Classic MDS does with the distances of a few points, between which it "
            "interpolates."
        ),
        departs=(
            "Uses the geodesic distances of Classic MDS; samples are spread by lengths of paths "
            "along edges. Signs of the axes, and with them the mirror image, follow our rule."
        ),
        needs=("connected",),
    )

    samples: Annotated[int, Interval(4)] = 25

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of interpolated distances, centred at the origin.

        Geodesic distances are computed between a few samples. Their squares are interpolated
        smoothly to all pairs of vertices, which gives a matrix of low rank.

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
        interpolation = smooth_interpolation(shape, samples)
        rows = shape.geodesics_from(samples)
        squares = rows[:, samples] ** 2
        # Rounding may differ between both directions of a pair: the mean of both is symmetric.
        points = low_rank_scaling(shape, interpolation, (squares + squares.T) / 2)
        return shape.form(
            points, samples=len(samples), stress_of_rows=stress_of_rows(points, samples, rows)
        )
