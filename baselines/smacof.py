"""Least-squares and non-metric MDS: distances as near as possible to the geodesic ones (SMACOF)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, ClassVar, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.classic_mds import classic_scaling
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
)
from benchmark.geometry.embedding import oriented
from benchmark.geometry.mesh import IntArray

Transform = Callable[[FloatArray], tuple[FloatArray, float]]
"""Returns the transform of positions, shape (n, 3), and the stress of the given ones."""

N_LEVELS = 2**16
"""Number of levels of the distances in non-metric MDS.

A level is 1.5e-5 of the largest distance, finer than any solver is accurate.
"""

COINCIDENT = np.float32(1e-18)
"""Distance below which points neither pull nor push."""

STRIP = 32
"""Number of rows of pairs that are summed in the precision of a pair; sums of strips are double."""

TOGETHER = 4
"""Number of rows of a strip that are summed in one pass over the points."""


@dataclass(frozen=True, kw_only=True)
class LeastSquaresMDS(CheckedParameters):
    r"""Least-squares MDS of the geodesic distances.

    Minimises the stress :math:`\sum_{i<j} (\|x_i - x_j\| - \delta_{ij})^2` of the form with respect
    to the geodesic distances :math:`\delta`. A Guttman transform :math:`G(X) = B(X) X / n` never
    raises it, nor does a relaxed step :math:`X \leftarrow 2 G(X) - X` at the best scale, which
    halves the number of steps or better. The result is a plain transform, whose scale is right.
    Elad and Kimmel (2003), "On bending invariant signatures for surfaces"; de Leeuw (1977),
    "Applications of convex analysis to multidimensional scaling"; de Leeuw and Heiser (1980),
    "Multidimensional scaling with restrictions on the configuration"; Borg and Groenen (2005),
    chapter 8.

    Parameters
    ----------
    start
        ``"mesh"`` starts from the surface itself, so that limbs unfold from their position and the
        form keeps some of the pose and the orientation of the input; ``"classic"`` starts from
        classic MDS, which ignores the pose.
    max_iterations
        Maximum number of relaxed steps, each of which is one pass over all pairs.
    rtol
        Stop when a step lowers the stress by at most this fraction.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="least-squares-mds",
        title="Least Square MDS",
        cite="elad2003bending",
        family="paper",
        summary=(
            "Moves all points step by step until straight distances fit those along the surface "
            "best."
        ),
        departs=(
            "Uses the geodesic distances of Classic MDS. No source states when to stop on a "
            "surface: this row ends in a local minimum, where a step lowers the stress by at most "
            "1e-6 of itself. Pickup et al. (2016) stop at 1e-3 or after 100 steps, for the joints "
            "of a skeleton."
        ),
        needs=("pairs",),
    )

    start: Literal["mesh", "classic"] = "mesh"
    max_iterations: Annotated[int, Interval(1)] = 5000
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-6

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the least-squares MDS, centred at the origin, with its normalised stress."""
        distances = shape.geodesics()  # outside: not charged to those who use the form
        form: CanonicalForm = shape.compute_once(self, lambda: self._fit(shape, distances))
        return form

    def _fit(self, shape: Shape, distances: FloatArray) -> CanonicalForm:
        """Return the form whose distances fit the geodesic ones best, near the start.

        Parameters
        ----------
        shape
            The surface.
        distances
            Geodesic distances of all pairs of vertices, shape (n, n).

        Returns
        -------
        CanonicalForm
            Its notes are the stress, divided by the sum of the squared distances, and the number of
            steps.
        """
        # In an order of the points that does not depend on how the vertices are numbered.
        order, targets = _in_own_order(shape, distances)
        if self.start == "classic":
            start = _classic_start(shape, order, targets)
            axes = np.eye(3)
        else:
            start, axes = _input_start(shape.mesh.vertices[order])
        transform = partial(guttman_transform, targets=targets)
        points, stresses = majorise(
            transform, start, relaxed=True, max_iterations=self.max_iterations, rtol=self.rtol
        )
        in_given_axes = points @ axes.T
        sum_of_squares = float(np.square(targets, dtype=np.float64).sum()) / 2
        return shape.form(
            in_given_axes[np.argsort(order)],
            stress=stresses[-1] / sum_of_squares,
            iterations=len(stresses) - 1,
        )


@dataclass(frozen=True, kw_only=True)
class NonMetricMDS(CheckedParameters):
    r"""Non-metric MDS of the geodesic distances: only their order counts.

    Minimises the stress :math:`\sum_{i<j} (\hat d_{ij} - d_{ij})^2` between the distances d of the
    form and their disparities :math:`\hat d`: the isotonic regression of d in the order of the
    geodesic distances :math:`\delta`, rescaled to :math:`\sum \hat d^2 = \sum \delta^2` so that the
    form cannot shrink to a point. Regressions and Guttman transforms take turns, from classic MDS.
    Kruskal (1964), "Nonmetric multidimensional scaling: a numerical method"; Borg and Groenen
    (2005), chapter 9.

    Parameters
    ----------
    max_iterations
        Maximum number of regressions with a Guttman transform, each of which is one pass over all
        pairs.
    rtol
        Stop when an iteration lowers the stress by at most this fraction.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="non-metric-mds",
        title="Non-metric MDS",
        cite="kruskal1964nonmetric",
        family="paper",
        summary=(
            "Places all points so that pairs farther apart along the surface are farther apart "
            "straight, too."
        ),
        departs=(
            "Minimises the stress by majorisation, from Classic MDS; the source follows the "
            "gradient of stress-1. Distances are rounded to 65 536 levels, whose ties follow "
            "Kruskal's secondary approach. Stops where a step lowers the stress by at most 1e-3 of "
            "itself; on ten TOSCA shapes, stress-1 is then .2 to 3.1 % above that at 1e-5."
        ),
        needs=("pairs",),
    )

    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the non-metric MDS of the distances, centred at the origin.

        The note is the root of the stress.
        """
        order, distances = _in_own_order(shape, shape.geodesics())
        transform, norm = non_metric_transform(distances.astype(np.float64))
        start = _classic_start(shape, order, distances)
        points, stresses = majorise(
            transform, start, max_iterations=self.max_iterations, rtol=self.rtol
        )
        notes = {"stress_1": stresses[-1] ** 0.5 / norm, "iterations": len(stresses) - 1}
        return shape.form(points[np.argsort(order)], **notes)


def _in_own_order(shape: Shape, distances: FloatArray) -> tuple[IntArray, NDArray[np.float32]]:
    """Return the vertices by the sum of their distances, and the distances in this order.

    Ties are broken by position. In this order, sums are rounded alike however the vertices are
    numbered; those of single-precision distances are exact. Single precision moves a form by less
    than the tolerance, in a third of the time.
    """
    order = np.lexsort((*shape.mesh.vertices.T, distances.sum(axis=1)))
    return order, distances.astype(np.float32)[order].take(order, axis=1)


def _classic_start(shape: Shape, order: IntArray, distances: NDArray[np.float32]) -> FloatArray:
    """Return classic MDS in a given order of the vertices, rounded."""
    points, _ = classic_scaling(distances.astype(np.float64))
    return _rounded(oriented(points, shape.mesh.vertex_areas[order]))


def _input_start(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the vertices of a surface in the frame of its principal axes, rounded, and the axes.

    In this frame, they are rounded alike however the shape was turned. The axes are the columns of
    a matrix, shape (3, 3).
    """
    centred = vertices - vertices.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov(centred, rowvar=False))
    return _rounded(centred @ axes), axes


def _rounded(points: FloatArray) -> FloatArray:
    """Return positions without the digits in which processors differ."""
    unit = 2.0 ** np.floor(np.log2(np.abs(points).max()))
    return np.asarray((points / unit).round(6) * unit)


def majorise(
    transform: Transform,
    start: FloatArray,
    *,
    relaxed: bool = False,
    max_iterations: int = 100,
    rtol: float = 1e-3,
) -> tuple[FloatArray, list[float]]:
    """Minimise the stress of points by a transform that never raises it [de Leeuw 1977].

    Parameters
    ----------
    transform
        Takes positions of shape (n, 3); returns new positions, and the stress of the given ones.
    start
        First positions, shape (n, 3).
    relaxed
        Whether to go twice as far as the transform [de Leeuw and Heiser 1980]. Positions are scaled
        to their best size before, so that the size does not oscillate. The last step is plain.
    max_iterations
        Maximum number of steps.
    rtol
        Stop when a step lowers the stress by at most this fraction.

    Returns
    -------
    points : numpy.ndarray
        Centred positions, shape (n, 3).
    stresses : list of float
        Stress of the start, and after each step. If ``relaxed``, that of the plain last step is
        missing.
    """
    points = np.ascontiguousarray(start - start.mean(axis=0))
    stresses: list[float] = []
    while True:
        moved, stress = transform(points)
        if relaxed:
            # The scale at which the points have the least stress, and their stress at that scale.
            squares = (points**2).sum()
            scale = (points * moved).sum() / squares
            stress -= len(points) * (1 - scale) ** 2 * squares
        stresses.append(float(stress))
        has_settled = len(stresses) > 1 and stresses[-2] - stress <= rtol * stresses[-2]
        if has_settled or len(stresses) > max_iterations:
            break
        points = 2 * moved - scale * points if relaxed else moved
    if relaxed:
        points = moved
    return points, stresses


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def guttman_transform(
    points: FloatArray, targets: NDArray[np.floating]
) -> tuple[FloatArray, float]:
    """Return the Guttman transform of the points [Borg & Groenen 2005, 8.6], and their stress.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    targets
        Distances that they should have, symmetric, shape (n, n), in the precision of a pair;
        coincident points neither pull nor push.

    Returns
    -------
    moved : numpy.ndarray
        Positions, shape (n, 3).
    stress : float
        Sum of squared misses of all pairs.
    """
    places = np.ascontiguousarray(points.T).astype(targets.dtype)
    sums = np.zeros((4, len(points)))
    for first in range(0, len(points), STRIP):
        _add_strip(sums, places, first, targets[first : first + STRIP])
    return sums[:3].T / len(points), sums[3].sum() / 2


@njit(cache=True, nogil=True, error_model="numpy")
def _add_strip(sums, places, first, targets):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Add the pulls of some points on each point, and the squared misses of their targets."""
    of_strip = np.zeros((4, places.shape[1]), places.dtype)
    ungrouped = len(targets) % TOGETHER
    for row in range(0, len(targets) - ungrouped, TOGETHER):
        _add_rows(of_strip, places, first, targets, row, TOGETHER)
    for row in range(len(targets) - ungrouped, len(targets)):
        _add_rows(of_strip, places, first, targets, row, 1)
    sums += of_strip


@njit(inline="always")
def _add_rows(sums, places, first, targets, row, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Add what some points contribute to the Guttman transform and to the stress of all points.

    The miss of a pair is its distance less its target. Each pair is computed in single precision.

    Parameters
    ----------
    sums
        For each point, the sums of the pulls along x, y and z, and of the squared misses, shape
        (4, n); updated.
    places
        Coordinates of the points, shape (3, n).
    first
        Index of the first point of a strip of neighbouring points.
    targets
        Distances that the points of the strip should have from all points, shape (strip, n).
    row
        Place in the strip of the first point that is added.
    count
        Number of points that are added.
    """
    x, y, z = places[0], places[1], places[2]
    sums_x, sums_y, sums_z, sums_of_misses = sums[0], sums[1], sums[2], sums[3]
    # Each point j has sums of its own: the loop vectorises, and the order of each sum is fixed.
    for j in range(len(x)):
        pull_x = pull_y = pull_z = misses = np.float32(0)
        for k in range(row, row + count):
            i = first + k
            target = targets[k, j]
            dx = x[j] - x[i]
            dy = y[j] - y[i]
            dz = z[j] - z[i]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            ratio = target / max(distance, COINCIDENT)
            miss = distance - target
            pull_x = pull_x + ratio * dx
            pull_y = pull_y + ratio * dy
            pull_z = pull_z + ratio * dz
            misses += miss * miss
        sums_x[j] += pull_x
        sums_y[j] += pull_y
        sums_z[j] += pull_z
        sums_of_misses[j] += misses


def non_metric_transform(dissimilarities: FloatArray) -> tuple[Transform, float]:
    """Return the transform of non-metric MDS, for :func:`majorise`.

    A step fits disparities to the points: distances that rise with the dissimilarities, and are
    nearest to the distances of the points. Then it is the Guttman transform towards them.
    Dissimilarities are rounded to :data:`N_LEVELS` levels, and pairs of the same level get the same
    disparity (Kruskal's secondary approach), which makes the regression small.

    Parameters
    ----------
    dissimilarities
        Symmetric, shape (n, n); only their order and the sum of their squares matter.

    Returns
    -------
    transform : callable
        Takes positions of shape (n, 3); returns new positions, and the stress of the given ones.
    norm : float
        Root of the sum of the squared dissimilarities; disparities have the same one in each step.
    """
    from scipy.optimize import isotonic_regression  # lazy

    levels, n_pairs = _used_levels(dissimilarities, (N_LEVELS - 1) / dissimilarities.max())
    norm = float(np.sqrt((dissimilarities**2).sum() / 2))
    sums = np.empty(len(n_pairs))

    def transform(points: FloatArray) -> tuple[FloatArray, float]:
        """Fit disparities to the distances of points, and move the points towards them."""
        sum_distances(points, levels, sums)
        mean_distances = sums / n_pairs
        disparities = isotonic_regression(mean_distances, weights=n_pairs).x
        # They are scaled to a fixed size: else, points and disparities would shrink to 0 together.
        disparities *= norm / np.sqrt((n_pairs * disparities**2).sum())
        moved, stress = level_transform(points, levels, disparities.astype(np.float32))
        return moved, stress

    return transform, norm


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _used_levels(
    dissimilarities: FloatArray, scale: float
) -> tuple[NDArray[np.uint16], FloatArray]:
    """Round dissimilarities to levels, and number the levels that have pairs.

    Parameters
    ----------
    dissimilarities
        Symmetric, shape (n, n).
    scale
        Levels per unit of dissimilarity.

    Returns
    -------
    levels : numpy.ndarray
        Level of each pair, from 0, shape (n, n).
    n_pairs : numpy.ndarray
        Number of pairs of each level, shape (levels,).
    """
    levels = np.empty(dissimilarities.shape, np.uint16)
    counts = np.zeros(N_LEVELS, np.int64)
    for i in range(len(levels)):
        for j in range(len(levels)):
            levels[i, j] = np.uint16(np.rint(dissimilarities[i, j] * scale))
        for j in range(len(levels)):
            counts[levels[i, j]] += i != j
    # Levels without pairs are left out, the others numbered again.
    numbers = np.cumsum(counts > 0) - 1
    for i in range(len(levels)):
        for j in range(len(levels)):
            levels[i, j] = numbers[levels[i, j]]
        levels[i, i] = 0  # the diagonal is no pair, and its level is not read
    return levels, counts[counts > 0] / 2


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def sum_distances(points: FloatArray, levels: NDArray[np.uint16], sums: FloatArray) -> None:
    """Sum up the distances of the pairs of points of each level.

    Distances are computed in single precision, and summed up in double precision.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    levels
        Level of the dissimilarity of each pair, from 0, shape (n, n).
    sums
        Overwritten: the sum of the distances of each level, shape (levels,).
    """
    x = points[:, 0].astype(np.float32)
    y = points[:, 1].astype(np.float32)
    z = points[:, 2].astype(np.float32)
    distances = np.empty(len(points), np.float32)
    sums[:] = 0.0
    for i in range(len(points)):
        for j in range(i):
            dx = x[i] - x[j]
            dy = y[i] - y[j]
            dz = z[i] - z[j]
            distances[j] = np.sqrt(dx * dx + dy * dy + dz * dz)
        for j in range(i):
            sums[levels[i, j]] += distances[j]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def level_transform(
    points: FloatArray, levels: NDArray[np.uint16], disparities: NDArray[np.float32]
) -> tuple[FloatArray, float]:
    """Return the Guttman transform of points towards disparities, and their raw stress.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    levels
        Level of each pair, shape (n, n).
    disparities
        Distance that the pairs of each level should have, shape (levels,).

    Returns
    -------
    moved : numpy.ndarray
        Positions, shape (n, 3).
    stress : float
        Sum of the squared differences of all pairs.
    """
    n = len(points)
    places = np.ascontiguousarray(points.T).astype(np.float32)
    sums = np.zeros((4, n))
    targets = np.empty((STRIP, n), np.float32)
    for first in range(0, n, STRIP):
        rows = min(STRIP, n - first)
        for row in range(rows):
            for j in range(n):
                targets[row, j] = disparities[levels[first + row, j]]
            targets[row, first + row] = 0.0
        _add_strip(sums, places, first, targets[:rows])
    return sums[:3].T / n, sums[3].sum() / 2
