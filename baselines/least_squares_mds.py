"""Least-squares MDS of distances on a surface by stress majorisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np

from baselines._kernels.checks import require_pairs, require_vertices
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
)

if TYPE_CHECKING:
    from baselines._kernels.smacof import Scaling


@dataclass(frozen=True, kw_only=True)
class LeastSquaresMDS(CheckedParameters):
    r"""Least-squares MDS of the geodesic distances (SMACOF).

    Minimises the stress :math:`\sum_{i<j} (\|x_i - x_j\| - \delta_{ij})^2` of the form with respect to the geodesic
    distances :math:`\delta` by quasi-Newton steps from Guttman transforms :math:`X \leftarrow B(X) X / n`, after a
    coarse start on a few well-spread vertices, see :func:`least_squares_scaling`. Elad and Kimmel (2003), "On
    bending invariant signatures for surfaces"; de Leeuw (1977), "Applications of convex analysis to multidimensional
    scaling"; Borg and Groenen (2005), chapter 8.

    Parameters
    ----------
    start
        ``"mesh"`` starts from the surface itself, so that limbs unfold from their position and the form keeps some of
        the pose and the orientation of the input; ``"classic"`` starts from classic MDS, which ignores the pose.
    max_iterations
        Maximum number of Guttman transforms, each of which is one pass over all pairs.
    rtol
        Stop when a transform lowers the stress by less than this fraction.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="least-squares-mds",
        title="Least Square MDS",
        cite="elad2003bending",
        family="paper",
        summary="stress majorisation of the geodesic distances, from the mesh or from classic MDS",
        departs=(
            "Distances are those of Classic MDS here. A quasi-Newton method over the Guttman transforms "
            "starts from a few spread vertices, where the source takes plain steps of majorisation; it ends at a lower "
            "stress."
        ),
    )

    start: Literal["mesh", "classic"] = "mesh"
    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the least-squares MDS of the distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces, or too many vertices for all pairwise
            distances.
        """
        from baselines._kernels.smacof import normalised_stress

        require_vertices(shape)
        require_pairs(shape)
        distances = shape.geodesics()
        start = start_positions(shape, distances, self.start)
        scaling = least_squares_scaling(
            distances, start, shape.mesh.vertices, max_iterations=self.max_iterations, rtol=self.rtol
        )
        return shape.form(
            scaling.points,
            stress=scaling.stress[-1],
            stress_of_start=normalised_stress(start, distances),
            iterations=scaling.iterations,
        )


def least_squares_scaling(
    distances: FloatArray, start: FloatArray, vertices: FloatArray, *, max_iterations: int = 100, rtol: float = 1e-3
) -> Scaling:
    """Compute the least-squares MDS with equal weights, by quasi-Newton steps from a coarse start.

    Converges to a lower stress than plain majorisation, in a tenth of its passes over all pairs.

    Parameters
    ----------
    distances
        Target distances, symmetric, shape (n, n).
    start
        Initial positions, shape (n, 3).
    vertices
        Positions that break ties between equally far vertices, shape (n, 3).
    max_iterations
        Maximum number of passes over all pairs, and over the pairs of samples.
    rtol
        Stop when a pass lowers the stress by less than this fraction; for the samples, by less than a tenth of it.

    Returns
    -------
    Scaling
        As in :func:`baselines._kernels.smacof.smacof`; the stresses begin with that of the coarse start.
    """
    from baselines._kernels.coarse_start import coarse_start
    from baselines._kernels.quasi_newton import minimise
    from baselines._kernels.smacof import Scaling, StressProblem, attractions, lossless_single

    def scaled(
        distances: FloatArray, start: FloatArray, rtol: float, grain: float | None = None
    ) -> tuple[FloatArray, list[float]]:
        problem, targets = StressProblem(distances, None), lossless_single(distances)

        def evaluate(points: FloatArray) -> tuple[float, FloatArray]:
            sums = attractions(points, targets)
            return problem.stress(points, sums), problem.solve(sums)

        centred = np.ascontiguousarray((start - start.mean(axis=0)).T)
        points, course = minimise(evaluate, centred, max_iterations=max_iterations, rtol=rtol, grain=grain)
        return np.ascontiguousarray(points.T), course

    def scale(
        distances: FloatArray, start: FloatArray, grain: float
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        return scaled(distances, start, rtol / 10, grain)[0], lambda form: form

    points, course = scaled(distances, coarse_start(distances, start, vertices, scale), rtol)
    return Scaling(points, tuple(course))


def start_positions(shape: Shape, distances: FloatArray, start: Literal["mesh", "classic"]) -> FloatArray:
    """Return the initial positions of an iterative MDS, shape (n, 3)."""
    from baselines.classic_mds import oriented_classic_scaling

    return shape.mesh.vertices if start == "mesh" else oriented_classic_scaling(shape.mesh, distances)[0]
