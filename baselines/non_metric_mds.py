"""Non-metric scaling: only the order of the geodesic distances counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_vertices
from benchmark.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    GeodesicSolver,
    Interval,
    MethodInfo,
    Shape,
)


@dataclass(frozen=True, kw_only=True)
class NonMetricMDS(CheckedParameters):
    r"""Non-metric scaling of the geodesic distances.

    Alternates two steps, neither of which raises the stress :math:`\sum_{i<j} (\hat d_{ij} - d_{ij})^2`: the
    disparities :math:`\hat d` become the isotonic regression of the distances d of the form in the order of the
    geodesic distances :math:`\delta`, rescaled to :math:`\sum \hat d^2 = \sum \delta^2` so that the form cannot
    shrink to a point, and the form moves by one Guttman transform towards the disparities. Equal geodesic distances
    keep equal disparities. The start is classic scaling. Kruskal (1964), "Nonmetric multidimensional scaling: a
    numerical method"; Borg and Groenen (2005), chapter 9.

    Parameters
    ----------
    max_iterations
        Largest number of Guttman transforms.
    rtol
        Stop when an iteration lowers the stress by less than this fraction.
    solver
        Geodesic solver, see :meth:`benchmark.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="non-metric-mds",
        title="Non-metric MDS",
        cite="kruskal1964nonmetric",
        family="paper",
        summary="scaling of the rank order of the geodesic distances",
    )

    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3
    solver: GeodesicSolver = "default"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the non-metric scaling of the geodesic distances.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces.
        """
        from baselines._kernels.smacof import normalised_stress
        from baselines.classic_mds import oriented_classic_scaling

        require_vertices(shape)
        distances = shape.geodesics(self.solver)
        start, _ = oriented_classic_scaling(shape.mesh, distances)
        points, course = non_metric_scaling(distances, start, max_iterations=self.max_iterations, rtol=self.rtol)
        return shape.form(
            points,
            stress=normalised_stress(points, distances),
            stress_1=course[-1],
            iterations=len(course) - 1,
        )


def non_metric_scaling(
    dissimilarities: FloatArray, start: FloatArray, *, max_iterations: int = 100, rtol: float = 1e-3
) -> tuple[FloatArray, list[float]]:
    r"""Find positions whose distances come in the order of the dissimilarities.

    Parameters
    ----------
    dissimilarities
        Symmetric, shape (n, n); only their order and their sum of squares matter.
    start
        First positions, shape (n, 3).
    max_iterations
        Largest number of Guttman transforms.
    rtol
        Stop when an iteration lowers the raw stress by less than this fraction.

    Returns
    -------
    points : numpy.ndarray
        Centred positions, shape (n, 3).
    course : list of float
        Root of the stress over :math:`\sum \hat d^2`, before the first and after every iteration; never rises. At
        convergence it equals Kruskal's stress-1 up to terms of its own cube.
    """
    from baselines._kernels.isotonic import RankedPairs, isotonic_regression

    pairs = RankedPairs.of(dissimilarities)
    norm = np.linalg.norm(dissimilarities) / np.sqrt(2)
    points = start - start.mean(axis=0)
    course: list[float] = []
    while True:
        distances = pairs.distances(points)
        disparities = isotonic_regression(distances, pairs.tie_ends)
        disparities *= norm / np.linalg.norm(disparities)
        course.append(float(np.linalg.norm(disparities - distances) / norm))
        iterations = len(course) - 1
        converged = iterations > 0 and course[-2] ** 2 - course[-1] ** 2 <= rtol * course[-2] ** 2
        if converged or iterations == max_iterations:
            return points, course
        points = pairs.attractions(points, distances, disparities) / len(points)
