"""Stress majorisation: the Guttman transform, the stress it lowers, and the iteration of both."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from benchmark.contracts import FloatArray


@dataclass(frozen=True, eq=False)
class Scaling:
    """Result of least-squares scaling.

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


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _add_attractions(points, targets, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    n = points.shape[1]
    ratios = np.empty(n)
    for i in range(n - 1):
        # Views of the part above the diagonal, one output per loop: so the compiler can prove that nothing overlaps
        # and vectorises each loop.
        count = n - 1 - i
        x, y, z = points[0, i + 1 :], points[1, i + 1 :], points[2, i + 1 :]
        row = targets[i, i + 1 :]
        for j in range(count):
            dx, dy, dz = points[0, i] - x[j], points[1, i] - y[j], points[2, i] - z[j]
            squared = dx * dx + dy * dy + dz * dz
            ratios[j] = row[j] / np.sqrt(squared) if squared > 0.0 else 0.0
        for axis in range(3):
            coordinate, output = points[axis, i + 1 :], sums[axis, i + 1 :]
            own, total = points[axis, i], 0.0
            for j in range(count):
                pull = (own - coordinate[j]) * ratios[j]
                output[j] -= pull
                total += pull
            sums[axis, i] += total


def attractions(points: FloatArray, targets: FloatArray) -> FloatArray:
    r"""Product :math:`B(X) X` of the Guttman transform.

    Row i is :math:`\sum_j (\delta_{ij} / d_{ij}) (x_i - x_j)`, where coincident points contribute nothing.

    Parameters
    ----------
    points
        Positions X as rows of coordinates, shape (3, n).
    targets
        Distances delta to be met, times the weights if there are any; symmetric, shape (n, n).

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
        Distances delta to be met, symmetric, shape (n, n).
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
    r"""Least-squares scaling by majorisation (de Leeuw 1977; Borg & Groenen 2005, chapter 8).

    Lowers :math:`\sum_{i<j} w_{ij} (d_{ij} - \delta_{ij})^2` by Guttman transforms :math:`X \leftarrow V^+ B(X) X`,
    none of which raises it. Without weights :math:`V^+ = I / n` on centred points.

    Parameters
    ----------
    distances
        Distances delta to be met, symmetric, shape (n, n).
    start
        First positions, shape (n, 3).
    weights
        Weights w of the pairs, symmetric and not negative, shape (n, n); None weighs all pairs alike.
    max_iterations
        Largest number of Guttman transforms.
    rtol
        Stop when one transform lowers the stress by less than this fraction.

    Returns
    -------
    Scaling
        Centred positions and the course of the stress.
    """
    problem = StressProblem(distances, weights)
    points = np.ascontiguousarray((start - start.mean(axis=0)).T)
    sums = attractions(points, problem.targets)
    course = [problem.stress(points, sums)]
    for _ in range(max_iterations):
        points = problem.solve(sums)
        sums = attractions(points, problem.targets)
        course.append(problem.stress(points, sums))
        if course[-2] - course[-1] <= rtol * course[-2]:
            break
    return Scaling(np.ascontiguousarray(points.T), tuple(course))


class StressProblem:
    """What stays the same over the iterations: weighted targets, the matrix V and its factor.

    Parameters
    ----------
    distances
        Distances delta to be met, symmetric, shape (n, n).
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
        """Normalised stress of positions X, shape (3, n), given their :func:`attractions` B(X) X.

        The sum of ``w delta d`` is the trace of X'BX and that of ``w d^2`` the trace of X'VX, so that no second pass
        over the pairs is needed.
        """
        if self.laplacian is None:
            centred = points - points.mean(axis=1, keepdims=True)
            spread = self.n * float(np.vdot(centred, centred))
        else:
            spread = float(np.vdot(points, points @ self.laplacian))
        return max(0.0, self.total - 2 * float(np.vdot(points, sums)) + spread) / self.total
