"""Least-squares MDS of distances on a surface by scikit-learn, for comparison with our own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from baselines._kernels.checks import require_connected, require_pairs, require_vertices
from baselines.least_squares_mds import start_positions
from benchmark.api.contracts import CanonicalForm, CheckedParameters, GeodesicSolver, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class ScikitLearnSMACOF(CheckedParameters):
    """Least-squares MDS of the geodesic distances by ``sklearn.manifold.smacof``.

    A cross-check of :class:`baselines.least_squares_mds.LeastSquaresMDS`: the distances and the start are the same,
    each step is a plain Guttman transform of scikit-learn. Pedregosa et al. (2011), "Scikit-learn: Machine learning in
    Python".

    Parameters
    ----------
    start
        As in :class:`baselines.least_squares_mds.LeastSquaresMDS`.
    max_iterations
        Maximum number of Guttman transforms; the default is that of scikit-learn.
    rtol
        Stop when a transform lowers the stress by less than this fraction of the sum of the squared distances of the
        form; the default is that of scikit-learn.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="scikit-learn-smacof",
        title="SMACOF (scikit-learn)",
        cite="pedregosa2011scikit",
        family="extended",
        summary="stress majorisation of the geodesic distances by scikit-learn, a witness of least-squares-mds",
    )

    start: Literal["mesh", "classic"] = "mesh"
    max_iterations: Annotated[int, Interval(1)] = 300
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-6
    solver: GeodesicSolver = "default"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the least-squares MDS of the distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces, or too many vertices for all pairwise
            distances.
        """
        from sklearn.manifold import smacof

        from baselines._kernels.smacof import normalised_stress

        require_vertices(shape)
        require_connected(shape)
        require_pairs(shape)
        distances = shape.geodesics(self.solver)
        points, _, iterations = smacof(
            distances,
            n_components=3,
            init=start_positions(shape, distances, self.start),
            n_init=1,
            max_iter=self.max_iterations,
            eps=self.rtol,
            normalized_stress=False,
            return_n_iter=True,
        )
        return shape.form(points, stress=normalised_stress(points, distances), iterations=iterations)
