"""Least-squares scaling of distances on the surface by stress majorisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypedDict

import numpy as np

from baselines._kernels.checks import require_pairs, require_vertices
from baselines._kernels.orientation import vertex_areas
from baselines._kernels.spectral import Metric, distances_under
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    GeodesicSolver,
    Interval,
    MethodInfo,
    Shape,
)

if TYPE_CHECKING:
    from baselines._kernels.smacof import Scaling


@dataclass(frozen=True, kw_only=True)
class LeastSquaresMDS(CheckedParameters):
    r"""Least-squares scaling of the geodesic distances (SMACOF).

    Lowers the stress :math:`\sum_{i<j} w_{ij} (\|x_i - x_j\| - \delta_{ij})^2` between the form and the geodesic
    distances :math:`\delta` by Guttman transforms :math:`X \leftarrow V^+ B(X) X`, none of which raises it. With
    uniform weights and unless ``algorithm`` says otherwise, a quasi-Newton method takes its steps from the transforms,
    and a few spread vertices go ahead, see :func:`least_squares_scaling`. Elad and Kimmel (2003), "On bending invariant
    signatures for surfaces"; de Leeuw (1977), "Applications of convex analysis to multidimensional scaling"; Borg and
    Groenen (2005), chapter 8.

    Parameters
    ----------
    start
        ``"mesh"`` starts from the surface itself, so that limbs unfold from where they are and the form keeps some of
        the pose and the position in space of the input; ``"classic"`` starts from classic scaling, which knows
        nothing of the pose.
    weights
        ``"uniform"`` counts every pair of vertices once; ``"area"`` weighs a pair by the product of the two vertex
        areas, so that the stress is an integral over the surface and does not depend on the sampling.
    algorithm
        With uniform weights: ``"quasi-newton"``, or ``"majorization"`` for plain Guttman transforms from the start.
        With area weights the transforms are always plain.
    max_iterations
        Largest number of Guttman transforms, each of which is one pass over all pairs.
    rtol
        Stop when a transform lowers the stress by less than this fraction.
    metric, time, eigenfunctions
        Which distances :math:`\delta` are, see :class:`baselines.classic_mds.ClassicMDS`.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="least-squares-mds",
        title="Least Square MDS",
        cite="elad2003bending",
        family="paper",
        summary="stress majorisation of the geodesic distances, from the mesh or from classic MDS",
        departs=(
            "By default, a quasi-Newton method over the Guttman transforms starts from a few spread vertices, "
            "where the source takes plain steps of majorisation; it ends at a lower stress."
        ),
    )

    start: Literal["mesh", "classic"] = "mesh"
    weights: Literal["uniform", "area"] = "uniform"
    algorithm: Literal["quasi-newton", "majorization"] = "quasi-newton"
    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3
    metric: Metric = "geodesic"
    time: Annotated[float, Interval(0, closed="neither")] = 0.05
    eigenfunctions: Annotated[int, Interval(10)] = 100
    solver: GeodesicSolver = "default"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the least-squares scaling of the distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces, or too many vertices for the
            distances of all pairs.
        """
        from baselines._kernels.smacof import normalised_stress, smacof

        require_vertices(shape)
        require_pairs(shape)
        distances = distances_under(shape, self.metric, self.time, self.eigenfunctions, self.solver)
        start = start_positions(shape, distances, self.start)
        limits: Limits = {"max_iterations": self.max_iterations, "rtol": self.rtol}
        if self.weights == "uniform" and self.algorithm == "quasi-newton":
            scaling = least_squares_scaling(distances, start, shape.mesh.vertices, **limits)
            stress_of_start = normalised_stress(start, distances)
        else:
            weights = _products_of_areas(shape) if self.weights == "area" else None
            scaling = smacof(distances, start, weights=weights, **limits)
            stress_of_start = scaling.stress[0]
        return shape.form(
            scaling.points,
            stress=scaling.stress[-1],
            stress_of_start=stress_of_start,
            iterations=scaling.iterations,
        )


class Limits(TypedDict):
    """Limits of an iteration: the names of the parameters are those of :class:`LeastSquaresMDS`."""

    max_iterations: int
    rtol: float


def least_squares_scaling(
    distances: FloatArray, start: FloatArray, vertices: FloatArray, *, max_iterations: int = 100, rtol: float = 1e-3
) -> Scaling:
    """Least-squares scaling with equal weights, from a coarse start by quasi-Newton steps.

    Comes to rest below the stress of plain majorisation, in a tenth of its passes over all pairs.

    Parameters
    ----------
    distances
        Distances to be met, symmetric, shape (n, n).
    start
        First positions, shape (n, 3).
    vertices
        Positions that tell equally far vertices apart, shape (n, 3).
    max_iterations
        Largest number of passes over all pairs, and over those of the samples.
    rtol
        Stop when a pass lowers the stress by less than this fraction; the samples, by less than a tenth of it.

    Returns
    -------
    Scaling
        As from :func:`baselines._kernels.smacof.smacof`; the course of the stress begins where the samples left off.
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
    """Positions from which an iterative scaling sets out, shape (n, 3)."""
    from baselines.classic_mds import oriented_classic_scaling

    return shape.mesh.vertices if start == "mesh" else oriented_classic_scaling(shape.mesh, distances)[0]


def _products_of_areas(shape: Shape) -> FloatArray:
    areas = vertex_areas(shape.mesh)
    return np.outer(areas, areas)
