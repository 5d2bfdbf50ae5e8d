"""Non-metric MDS: only the order of the geodesic distances counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

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
    from baselines._kernels.isotonic import RankedPairs

_KNOTS = 256
"""Number of dissimilarities between which disparities are interpolated."""


@dataclass(frozen=True, kw_only=True)
class NonMetricMDS(CheckedParameters):
    r"""Non-metric MDS of the geodesic distances.

    Minimises the stress :math:`\sum_{i<j} (\hat d_{ij} - d_{ij})^2` between the distances d of the form and their
    disparities :math:`\hat d`: the isotonic regression of d in the order of the geodesic distances :math:`\delta`,
    rescaled to :math:`\sum \hat d^2 = \sum \delta^2` so that the form cannot shrink to a point. Equal geodesic
    distances keep equal disparities. At the optimal disparities, the Guttman transform towards them gives the gradient
    of the stress, from which a quasi-Newton method takes its steps. They begin at classic MDS, after a coarse start on
    a few well-spread vertices. Kruskal (1964), "Nonmetric multidimensional scaling: a numerical method"; Borg and
    Groenen (2005), chapter 9.

    Parameters
    ----------
    max_iterations
        Maximum number of regressions with a Guttman transform, each of which is one pass over all pairs.
    rtol
        Stop when an iteration lowers the stress by less than this fraction.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="non-metric-mds",
        title="Non-metric MDS",
        cite="kruskal1964nonmetric",
        family="paper",
        summary="scaling of the rank order of the geodesic distances",
        departs=(
            "Quasi-Newton steps on the stress with rescaled disparities, from classic MDS and a few spread vertices, "
            "where the source descends along the gradient of its stress-1."
        ),
    )

    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the non-metric MDS of the geodesic distances.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces, or too many vertices for all pairwise
            distances.
        """
        from baselines._kernels.coarse_start import coarse_start
        from baselines._kernels.smacof import normalised_stress
        from baselines.classic_mds import oriented_classic_scaling

        require_vertices(shape)
        require_pairs(shape)
        distances = shape.geodesics()
        start, _ = oriented_classic_scaling(shape.mesh, distances)

        def scale(
            distances: FloatArray, start: FloatArray, grain: float
        ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
            points, _ = non_metric_scaling(
                distances, start, max_iterations=self.max_iterations, rtol=self.rtol / 10, grain=grain
            )
            return points, disparities_like(distances, points)

        start = coarse_start(distances, start, shape.mesh.vertices, scale)
        points, course = non_metric_scaling(distances, start, max_iterations=self.max_iterations, rtol=self.rtol)
        return shape.form(
            points,
            stress=normalised_stress(points, distances),
            stress_1=course[-1],
            iterations=len(course) - 1,
        )


def non_metric_scaling(
    dissimilarities: FloatArray,
    start: FloatArray,
    *,
    max_iterations: int = 100,
    rtol: float = 1e-3,
    grain: float | None = None,
) -> tuple[FloatArray, list[float]]:
    r"""Find positions whose distances follow the order of the dissimilarities.

    Parameters
    ----------
    dissimilarities
        Symmetric, shape (n, n); only their order and their sum of squares matter.
    start
        Initial positions, shape (n, 3).
    max_iterations
        Maximum number of regressions with a Guttman transform, each of which is one pass over all pairs.
    rtol
        Stop when an iteration lowers the raw stress by less than this fraction.
    grain
        As in :func:`baselines._kernels.quasi_newton.minimise`.

    Returns
    -------
    points : numpy.ndarray
        Centred positions, shape (n, 3).
    course : list of float
        Square root of the stress over :math:`\sum \hat d^2`, before the first and after every iteration; never rises.
        At convergence it equals Kruskal's stress-1 up to terms of its own cube.
    """
    from baselines._kernels.isotonic import RankedPairs
    from baselines._kernels.quasi_newton import minimise

    pairs = RankedPairs.of(dissimilarities)
    norm = float(np.linalg.norm(dissimilarities) / np.sqrt(2))

    def evaluate(rows: FloatArray) -> tuple[float, FloatArray]:
        points = np.ascontiguousarray(rows.T)
        distances = pairs.distances(points)
        disparities = _disparities(distances, pairs, norm)
        transform = pairs.attractions(points, distances, disparities) / len(points)
        return float(np.linalg.norm(disparities - distances) / norm) ** 2, np.ascontiguousarray(transform.T)

    centred = np.ascontiguousarray((start - start.mean(axis=0)).T)
    points, course = minimise(evaluate, centred, max_iterations=max_iterations, rtol=rtol, grain=grain)
    return np.ascontiguousarray(points.T), np.sqrt(course).tolist()


def disparities_like(dissimilarities: FloatArray, points: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return a function that maps any dissimilarities to disparities, fitted to the MDS of a sample.

    Parameters
    ----------
    dissimilarities
        Dissimilarities of the sample, symmetric, shape (p, p).
    points
        Positions of the sample, shape (p, 3).

    Returns
    -------
    callable
        Linear between a few hundred of the dissimilarities, evenly spaced by rank; maps 0 to 0.
    """
    from baselines._kernels.isotonic import RankedPairs

    pairs = RankedPairs.of(dissimilarities)
    norm = float(np.linalg.norm(dissimilarities) / np.sqrt(2))
    disparities = _disparities(pairs.distances(points), pairs, norm)
    knots = np.linspace(0, len(disparities) - 1, _KNOTS).round().astype(np.int64)
    from_values = np.append(0.0, dissimilarities[pairs.first[knots], pairs.second[knots]])
    to_values = np.append(0.0, disparities[knots])
    return lambda values: np.interp(values, from_values, to_values)


def _disparities(distances: FloatArray, pairs: RankedPairs, norm: float) -> FloatArray:
    from baselines._kernels.isotonic import isotonic_regression

    disparities = isotonic_regression(distances, pairs.tie_ends)
    disparities *= norm / np.linalg.norm(disparities)
    return disparities
