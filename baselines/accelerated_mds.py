"""Accelerated MDS: classic MDS from a few rows of geodesic distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from baselines._kernels.orientation import Side, low_rank_scaling, side_notes, vertex_areas
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    GeodesicSolver,
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

    .. math:: D \circ D \approx P W P^\top \qquad \text{("samples")},

    and an option of ours also uses the rows away from the samples,

    .. math:: D \circ D \approx P F + F^\top P^\top - P W P^\top \qquad \text{("interpolated")},

    which is exact in the rows and columns of the samples (the Boolean sum of the two interpolations, Gordon 1971) and
    needs the same distances. Both matrices have the form :math:`Z M Z^\top` with few columns in Z, see
    :func:`baselines._kernels.orientation.low_rank_scaling`.
    :class:`baselines.fast_classical_scaling.FastClassicalScaling` averages the two extensions, and
    :class:`baselines.nystrom_mds.NystromMDS` uses the distances alone.

    Parameters
    ----------
    variant
        ``"samples"``, as published, or ``"interpolated"``, our Boolean sum.
    samples
        Number p of farthest-point samples.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    side
        ``"moment"`` chooses between the form and its mirror image by a moment of the form, an addition to the source;
        ``"off"`` leaves the choice to the signs of the axes, as in the source.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="accelerated-mds",
        title="Accelerated MDS",
        cite="shamai2015accelerated",
        family="extended",
        summary="classic scaling from interpolated geodesic distances of a few samples",
        departs="Signs of axes, the side of the mirror and the variant `interpolated` follow rules of ours.",
    )

    variant: Literal["samples", "interpolated"] = "samples"
    samples: Annotated[int, Interval(4)] = 25
    solver: GeodesicSolver = "default"
    side: Side = "moment"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the form of the chosen variant, centred at the origin.

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
        rows = shape.geodesics_from(samples, self.solver)
        interpolation = smooth_interpolation(shape.laplacian(), samples)
        between = squares_between(samples, rows)
        if self.variant == "samples":
            points = low_rank_scaling(shape.mesh, interpolation, between, self.side)
        else:
            identity = np.eye(len(samples))
            coupling = np.block([[-between, identity], [identity, np.zeros_like(identity)]])
            points = low_rank_scaling(shape.mesh, np.hstack([interpolation, rows.T**2]), coupling, self.side)
        return shape.form(
            points,
            samples=len(samples),
            stress_of_rows=stress_of_rows(points, samples, rows),
            **side_notes(points, vertex_areas(shape.mesh)),
        )
