"""Accelerated MDS: classic MDS from a few rows of geodesic distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

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
class AcceleratedMDS(CheckedParameters):
    r"""Classic MDS without all pairwise distances.

    The matrix P (n x p) of biharmonic (Laplace-Beltrami) interpolation extends the squared distances :math:`F` (p x n)
    from p farthest-point samples over the surface. With :math:`W = F_{:, s}` between the samples, Shamai, Zibulevsky
    and Kimmel (2015), "Accelerating the computation of canonical forms for 3D nonrigid objects using multidimensional
    scaling", approximate

    .. math:: D \circ D \approx P W P^\top,

    see :func:`baselines._kernels.orientation.low_rank_scaling`.
    :class:`baselines.fast_classical_scaling.FastClassicalScaling` averages both extensions.

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
        summary="classic scaling from interpolated geodesic distances of a few samples",
        departs="Signs of axes and the side of the mirror follow a rule of ours.",
    )

    samples: Annotated[int, Interval(4)] = 25

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the interpolated distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces.
        """
        from baselines._kernels.interpolation import smooth_interpolation
        from baselines._kernels.sampling import farthest_points, squares_between, stress_of_rows

        require_vertices(shape)
        require_connected(shape)
        samples = farthest_points(shape, self.samples)
        rows = shape.geodesics_from(samples)
        interpolation = smooth_interpolation(shape.laplacian(), samples)
        between = squares_between(samples, rows)
        points = low_rank_scaling(shape.mesh, interpolation, between)
        return shape.form(
            points,
            samples=len(samples),
            stress_of_rows=stress_of_rows(points, samples, rows),
            **side_notes(points, vertex_areas(shape.mesh)),
        )
