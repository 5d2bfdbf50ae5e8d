"""Stress majorisation: the Guttman transform, the stress, and their iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import FloatArray


@dataclass(frozen=True, eq=False)
class Scaling:
    """Result of least-squares MDS.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    stress
        Normalised stress before the first and after every iteration; the last entry belongs to ``points``.
    """

    points: FloatArray
    stress: tuple[float, ...]

    @property
    def iterations(self) -> int:
        """Number of Guttman transforms."""
        return len(self.stress) - 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_pairs_among(points, targets, sums, first, last):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(first, last):
        for j in range(i + 1, last):
            dx, dy, dz = points[0, i] - points[0, j], points[1, i] - points[1, j], points[2, i] - points[2, j]
            squared = dx * dx + dy * dy + dz * dz
            ratio = targets[i, j] / np.sqrt(squared) if squared > 0.0 else 0.0
            for axis in range(3):
                pull = (points[axis, i] - points[axis, j]) * ratio
                sums[axis, i] += pull
                sums[axis, j] -= pull


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _add_attractions(points, targets, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    n = points.shape[1]
    ratios = np.empty((4, n))  # of four rows to the columns after them, fewer than n
    blocks_end = n - n % 4
    for first in range(0, blocks_end, 4):
        # Above the diagonal, four rows at a time, so that each loaded value is used four times. Views and one output
        # per loop let the compiler rule out overlap and vectorise.
        _add_pairs_among(points, targets, sums, first, first + 4)
        rest = first + 4
        count = n - rest
        x, y, z = points[0, rest:], points[1, rest:], points[2, rest:]
        for k in range(4):
            row, ratio = targets[first + k, rest:], ratios[k]
            own_x, own_y, own_z = points[0, first + k], points[1, first + k], points[2, first + k]
            for j in range(count):
                dx, dy, dz = own_x - x[j], own_y - y[j], own_z - z[j]
                squared = dx * dx + dy * dy + dz * dz
                ratio[j] = row[j] / np.sqrt(squared) if squared > 0.0 else 0.0
        ratio_a, ratio_b, ratio_c, ratio_d = ratios[0], ratios[1], ratios[2], ratios[3]
        for axis in range(3):
            coordinates, output = points[axis, rest:], sums[axis, rest:]
            a, b = points[axis, first], points[axis, first + 1]
            c, d = points[axis, first + 2], points[axis, first + 3]
            sum_a = sum_b = sum_c = sum_d = 0.0
            for j in range(count):
                pull_a = (a - coordinates[j]) * ratio_a[j]
                pull_b = (b - coordinates[j]) * ratio_b[j]
                pull_c = (c - coordinates[j]) * ratio_c[j]
                pull_d = (d - coordinates[j]) * ratio_d[j]
                output[j] -= pull_a + pull_b + pull_c + pull_d
                sum_a += pull_a
                sum_b += pull_b
                sum_c += pull_c
                sum_d += pull_d
            sums[axis, first] += sum_a
            sums[axis, first + 1] += sum_b
            sums[axis, first + 2] += sum_c
            sums[axis, first + 3] += sum_d
    _add_pairs_among(points, targets, sums, blocks_end, n)


def lossless_single(targets: FloatArray) -> NDArray[np.floating]:
    """Return the targets in single precision if the conversion is exact, else unchanged.

    Geodesic distances are stored in single precision, so most targets convert. With half the memory to read, a
    transform takes two thirds of the time and gives the same digits.
    """
    narrow = targets.astype(np.float32)
    return narrow if np.array_equal(narrow, targets) else targets


def attractions(points: FloatArray, targets: NDArray[np.floating]) -> FloatArray:
    r"""Compute the product :math:`B(X) X` of the Guttman transform.

    Row i is :math:`\sum_j (\delta_{ij} / d_{ij}) (x_i - x_j)`; coincident points contribute nothing.

    Parameters
    ----------
    points
        Positions X as rows of coordinates, shape (3, n).
    targets
        Target distances delta, times the weights if there are any; symmetric, shape (n, n).

    Returns
    -------
    numpy.ndarray
        Shape (3, n).
    """
    sums = np.zeros_like(points)
    _add_attractions(points, targets, sums)
    return sums


def normalised_stress(points: FloatArray, distances: FloatArray) -> float:
    r"""Return :math:`\sum_{i<j} (d_{ij} - \delta_{ij})^2 / \sum_{i<j} \delta_{ij}^2`.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    distances
        Target distances delta, symmetric, shape (n, n).
    """
    rows = np.ascontiguousarray(points.T)
    return StressProblem(distances, None).stress(rows, attractions(rows, distances))


def smacof(
    distances: FloatArray,
    start: FloatArray,
    *,
    weights: FloatArray | None = None,
    max_iterations: int = 100,
    rtol: float = 1e-3,
) -> Scaling:
    r"""Compute the least-squares MDS by majorisation (de Leeuw 1977; Borg & Groenen 2005, chapter 8).

    Minimises :math:`\sum_{i<j} w_{ij} (d_{ij} - \delta_{ij})^2` by Guttman transforms :math:`X \leftarrow V^+ B(X) X`,
    which never raise it. Without weights, :math:`V^+ = I / n` on centred points.

    Parameters
    ----------
    distances
        Target distances delta, symmetric, shape (n, n).
    start
        Initial positions, shape (n, 3).
    weights
        Weights w of the pairs, symmetric and non-negative, shape (n, n); None for equal weights.
    max_iterations
        Maximum number of Guttman transforms.
    rtol
        Stop when a transform lowers the stress by less than this fraction.

    Returns
    -------
    Scaling
        Centred positions and the stress of each iteration.
    """
    problem = StressProblem(distances, weights)
    points = np.ascontiguousarray((start - start.mean(axis=0)).T)
    targets = lossless_single(problem.targets)
    sums = attractions(points, targets)
    course = [problem.stress(points, sums)]
    for _ in range(max_iterations):
        points = problem.solve(sums)
        sums = attractions(points, targets)
        course.append(problem.stress(points, sums))
        if course[-2] - course[-1] <= rtol * course[-2]:
            break
    return Scaling(np.ascontiguousarray(points.T), tuple(course))


class StressProblem:
    """Constants of the iteration: weighted targets, the matrix V and its factorisation.

    Parameters
    ----------
    distances
        Target distances delta, symmetric, shape (n, n).
    weights
        Weights of the pairs, shape (n, n), or None for equal ones.
    """

    def __init__(self, distances: FloatArray, weights: FloatArray | None) -> None:
        self.n = len(distances)
        self.targets = distances if weights is None else weights * distances
        # Half the sum over the full symmetric matrix is the sum over pairs.
        self.total = float(np.vdot(self.targets, distances)) / 2
        self.laplacian: FloatArray | None = None
        if weights is not None:
            from scipy.linalg import cho_factor

            self.laplacian = np.diag(weights.sum(axis=1)) - weights
            # Adding a multiple of the all-ones matrix fills the null space and leaves centred solutions alone.
            self.factor = cho_factor(self.laplacian + self.laplacian.trace() / self.n**2)

    def solve(self, sums: FloatArray) -> FloatArray:
        """Apply the pseudo-inverse of V to rows of coordinates, shape (3, n): the second half of a transform."""
        if self.laplacian is None:
            return sums / self.n
        from scipy.linalg import cho_solve

        return np.ascontiguousarray(cho_solve(self.factor, sums.T).T)

    def stress(self, points: FloatArray, sums: FloatArray) -> float:
        """Return the normalised stress of positions X, shape (3, n), given their :func:`attractions` B(X) X.

        The sum of ``w delta d`` is the trace of X'BX and that of ``w d^2`` the trace of X'VX, so no second pass over
        the pairs is needed.
        """
        if self.laplacian is None:
            centred = points - points.mean(axis=1, keepdims=True)
            spread = self.n * float(np.vdot(centred, centred))
        else:
            spread = float(np.vdot(points, points @ self.laplacian))
        return max(0.0, self.total - 2 * float(np.vdot(points, sums)) + spread) / self.total
