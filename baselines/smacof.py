"""Least-squares and non-metric MDS: forms whose distances are nearest to the geodesic ones (SMACOF)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.classic_mds import ClassicMDS
from benchmark.api.contracts import CanonicalForm, CheckedParameters, FloatArray, Interval, MethodInfo, Shape

Indices = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class LeastSquaresMDS(CheckedParameters):
    r"""Least-squares MDS of the geodesic distances.

    Minimises the stress :math:`\sum_{i<j} (\|x_i - x_j\| - \delta_{ij})^2` of the form with respect to the geodesic
    distances :math:`\delta` by Guttman transforms :math:`X \leftarrow B(X) X / n`, which never raise it. Elad and
    Kimmel (2003), "On bending invariant signatures for surfaces"; de Leeuw (1977), "Applications of convex analysis to
    multidimensional scaling"; Borg and Groenen (2005), chapter 8. The stopping rule is that of the released code of
    Pickup et al. (2016).

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
            "Uses the geodesic distances of Classic MDS. No source states when to stop on a surface: this row ends in "
            "a local minimum, where a step lowers the stress by at most 1e-6 of itself. Earlier versions stopped at "
            "1e-3 or after 100 steps, the rule of Pickup et al. (2016) for the joints of a skeleton."
        ),
        needs=("pairs",),
    )

    start: Literal["mesh", "classic"] = "mesh"
    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the least-squares MDS of the distances, centred at the origin, with its normalised stress."""
        distances = shape.geodesics()
        start = shape.mesh.vertices if self.start == "mesh" else ClassicMDS().canonicalise(shape).vertices
        targets = np.asarray(distances, dtype=np.float32)  # half the memory to read
        points, course = majorise(
            lambda points: guttman_transform(points, targets), start, max_iterations=self.max_iterations, rtol=self.rtol
        )
        total = float(np.vdot(distances, distances)) / 2
        return shape.form(points, stress=course[-1] / total, iterations=len(course) - 1)


@dataclass(frozen=True, kw_only=True)
class NonMetricMDS(CheckedParameters):
    r"""Non-metric MDS of the geodesic distances: only their order counts.

    Minimises the stress :math:`\sum_{i<j} (\hat d_{ij} - d_{ij})^2` between the distances d of the form and their
    disparities :math:`\hat d`: the isotonic regression of d in the order of the geodesic distances :math:`\delta`,
    rescaled to :math:`\sum \hat d^2 = \sum \delta^2` so that the form cannot shrink to a point. Regressions and Guttman
    transforms take turns, from classic MDS. Kruskal (1964), "Nonmetric multidimensional scaling: a numerical method";
    Borg and Groenen (2005), chapter 9.

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
            "Minimises the stress by majorisation, from Classic MDS; the source follows the gradient of stress-1. "
            "Distances are rounded to 65 536 levels, whose ties follow Kruskal's secondary approach. Stops where a "
            "step lowers the stress by at most 1e-3 of itself; on ten TOSCA shapes, stress-1 is then .2 to 3.1 % above "
            "that at 1e-5."
        ),
        needs=("pairs",),
    )

    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the non-metric MDS of the distances, centred at the origin; the note is the root of the stress."""
        distances = shape.geodesics()
        transform, norm = non_metric_transform(distances)
        start = ClassicMDS().canonicalise(shape).vertices
        points, course = majorise(transform, start, max_iterations=self.max_iterations, rtol=self.rtol)
        return shape.form(points, stress_1=course[-1] ** 0.5 / norm, iterations=len(course) - 1)


def majorise(
    transform: Callable[[FloatArray], tuple[FloatArray, float]],
    start: FloatArray,
    *,
    max_iterations: int = 100,
    rtol: float = 1e-3,
) -> tuple[FloatArray, list[float]]:
    """Repeat a transform that never raises the stress [de Leeuw 1977].

    Parameters
    ----------
    transform
        Returns the transform of positions, shape (n, 3), and the raw stress of the given ones.
    start
        First positions, shape (n, 3).
    max_iterations
        Maximum number of transforms.
    rtol
        Stop when a transform lowers the stress by less than this fraction.

    Returns
    -------
    points : numpy.ndarray
        Centred positions, shape (n, 3).
    course : list of float
        Raw stress of the start and after each transform; the last entry is that of ``points``.
    """
    points = np.ascontiguousarray(start - start.mean(axis=0))
    moved, stress = transform(points)
    course = [stress]
    while len(course) <= max_iterations:
        points = moved
        moved, stress = transform(points)
        course.append(stress)
        if course[-2] - course[-1] <= rtol * course[-2]:
            break
    return points, course


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")  # type: ignore[untyped-decorator]
def guttman_transform(points: FloatArray, targets: FloatArray) -> tuple[FloatArray, float]:
    """Return the Guttman transform of the points [Borg & Groenen 2005, 8.6], and their raw stress.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    targets
        Distances that they should have, symmetric, shape (n, n); coincident points neither pull nor push.
    """
    x, y, z = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    n, moved, stress = len(points), np.empty_like(points), 0.0
    for i in range(n):
        target, sum_x, sum_y, sum_z, row = targets[i], 0.0, 0.0, 0.0, 0.0
        for j in range(n):  # each pair twice: without writes, this loop vectorises
            dx, dy, dz = x[i] - x[j], y[i] - y[j], z[i] - z[j]
            squared = dx * dx + dy * dy + dz * dz
            # A root in single precision and one step of Newton's method: all digits in less time.
            guess = np.float64(np.float32(1.0) / np.sqrt(np.float32(squared))) if squared > 1e-30 else 0.0
            inverse = guess * (1.5 - 0.5 * squared * guess * guess)
            ratio = target[j] * inverse
            sum_x, sum_y, sum_z = sum_x + ratio * dx, sum_y + ratio * dy, sum_z + ratio * dz
            row += (squared * inverse - target[j]) ** 2
        moved[i, 0], moved[i, 1], moved[i, 2] = sum_x / n, sum_y / n, sum_z / n
        stress += row
    return moved, 0.5 * stress


def non_metric_transform(
    dissimilarities: FloatArray,
) -> tuple[Callable[[FloatArray], tuple[FloatArray, float]], float]:
    """Return the Guttman transform towards disparities, and the root of the sum of their squares.

    Parameters
    ----------
    dissimilarities
        Symmetric, shape (n, n); only their order and the sum of their squares matter.
    """
    first, second = (ends.astype(np.int32) for ends in np.triu_indices(len(dissimilarities), 1))
    given = dissimilarities[first, second]
    # The bits of non-negative floats rise with them: a stable sort by both halves takes a sixth of the time.
    halves = given.astype("<f4").view("<u2").reshape(-1, 2)
    order = np.lexsort((halves[:, 0], halves[:, 1]))
    first, second, norm = first[order], second[order], float(np.linalg.norm(given))

    distances = np.empty(len(first))  # reused by every transform

    def transform(points: FloatArray) -> tuple[FloatArray, float]:
        pair_distances(points, first, second, distances)
        disparities = isotonic_regression(distances)
        scale = norm / float(np.linalg.norm(disparities))
        moved, stress = pair_transform(points, first, second, distances, disparities, scale)
        return moved, stress

    return transform, norm


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def isotonic_regression(values: FloatArray) -> FloatArray:
    """Return the non-decreasing sequence nearest to the values: pool adjacent violators [Kruskal 1964].

    Its blocks end where the cumulative sum touches its greatest convex minorant, which lies nowhere above that of every
    64th place alone. Most places lie above the latter, and none of them can end a block: with these left out, a
    regression takes a sixth of the time of scipy's.
    """
    starts = range(0, len(values), 64)
    sums, sizes, blocks = np.empty(len(starts)), np.empty(len(starts)), 0
    for start in starts:
        chunk = values[start : start + 64]
        blocks = _append_block(sums, sizes, blocks, chunk.sum(), float(len(chunk)))
    fine_sums, fine_sizes, fine_blocks, end = np.empty_like(values), np.empty_like(values), 0, 0
    for mean, count in zip(sums[:blocks] / sizes[:blocks], sizes[:blocks]):  # noqa: B905 (numba knows no strict)
        excess, total, size, begin, end = 0.0, 0.0, 0.0, end, end + int(count)
        for place in range(begin, end):
            total, size, excess = total + values[place], size + 1.0, excess + values[place] - mean
            if excess <= 0.0 or place == end - 1:
                fine_blocks = _append_block(fine_sums, fine_sizes, fine_blocks, total, size)
                total, size = 0.0, 0.0
    fitted, end = np.empty_like(values), 0
    for block in range(fine_blocks):
        begin, end = end, end + int(fine_sizes[block])
        fitted[begin:end] = fine_sums[block] / fine_sizes[block]
    return fitted


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _append_block(sums: FloatArray, sizes: FloatArray, blocks: int, total: float, size: float) -> int:
    """Append a block, pooled with those before it whose mean is not lower, and return the number of blocks."""
    while blocks > 0 and sums[blocks - 1] * size >= total * sizes[blocks - 1]:
        blocks -= 1
        total, size = total + sums[blocks], size + sizes[blocks]
    sums[blocks], sizes[blocks] = total, size
    return blocks + 1


@njit(cache=True, nogil=True, fastmath=True)  # type: ignore[untyped-decorator]
def pair_distances(points: FloatArray, first: Indices, second: Indices, distances: FloatArray) -> None:
    """Write the distance of each pair of points."""
    for pair in range(len(first)):
        i, j = first[pair], second[pair]
        dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
        distances[pair] = np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")  # type: ignore[untyped-decorator]
def pair_transform(
    points: FloatArray, first: Indices, second: Indices, distances: FloatArray, targets: FloatArray, scale: float
) -> tuple[FloatArray, float]:
    """Return the Guttman transform towards scaled targets of the pairs, and the raw stress of the points."""
    moved, stress = np.zeros_like(points), 0.0
    for pair in range(len(first)):
        i, j, distance, target = first[pair], second[pair], distances[pair], scale * targets[pair]
        ratio = target / distance if distance > 0.0 else 0.0
        stress += (target - distance) ** 2
        for axis in range(3):
            pull = ratio * (points[i, axis] - points[j, axis])
            moved[i, axis] += pull
            moved[j, axis] -= pull
    return moved / len(points), stress
