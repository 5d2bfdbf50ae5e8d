"""Nyström MDS: classic MDS from a few rows of geodesic distances by the Nyström approximation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

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
class NystromMDS(CheckedParameters):
    r"""Nyström MDS (NMDS).

    With the squared geodesic distances :math:`F` (p x n) from p farthest-point samples s and those between the samples,
    :math:`W = F_{:, s}`, the matrix of all squared distances is approximately

    .. math:: D \circ D \approx F^\top W_r^+ F,

    where the pseudo-inverse keeps the r eigenvalues of W of largest magnitude: small ones are errors of the distances,
    and W has eigenvalues of both signs. Shamai, Zibulevsky and Kimmel (2018), "Efficient inter-geodesic distance
    computation and fast classical scaling".

    :class:`baselines.accelerated_mds.AcceleratedMDS` computes :math:`P W P^\top` from the same rows with an
    interpolation P that depends on the surface but not on the distances. Here :math:`P = F^\top W_r^+` is learned from
    the distances alone: it needs no Laplacian and works for any metric.

    Parameters
    ----------
    samples
        Number p of farthest-point samples.
    rank
        Maximum number r of eigenvalues to keep; the last one lies at a gap between their magnitudes.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    side
        ``"moment"`` chooses between the form and its mirror image by a moment of the form, an addition to the source;
        ``"off"`` leaves the choice to the signs of the axes, as in the source.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="nystrom-mds",
        title="Nyström MDS",
        cite="shamai2018fast",
        family="extended",
        summary="classic scaling from few rows of geodesic distances, the others by Nyström's formula",
        departs=(
            "The rank ends at a gap between the eigenvalues; signs of axes and the side of the mirror follow a rule of "
            "ours."
        ),
    )

    samples: Annotated[int, Interval(4)] = 50
    rank: Annotated[int, Interval(4)] = 20
    solver: GeodesicSolver = "default"
    side: Side = "moment"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the approximate distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces.
        """
        from baselines._kernels.sampling import farthest_points, squares_between, stress_of_rows
        from baselines._kernels.spectral import clear_length

        require_vertices(shape)
        require_connected(shape)
        samples = farthest_points(shape, self.samples)
        rows = shape.geodesics_from(samples, self.solver)
        values, vectors = np.linalg.eigh(squares_between(samples, rows))
        largest_first = np.argsort(-np.abs(values), kind="stable")
        kept = largest_first[: clear_length(values[largest_first], self.rank)]
        columns = rows.T**2 @ (vectors[:, kept] / values[kept])
        points = low_rank_scaling(shape.mesh, columns, np.diag(values[kept]), self.side)
        return shape.form(
            points,
            samples=len(samples),
            rank=len(kept),
            stress_of_rows=stress_of_rows(points, samples, rows),
            **side_notes(points, vertex_areas(shape.mesh)),
        )
