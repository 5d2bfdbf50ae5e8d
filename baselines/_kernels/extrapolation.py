"""Stress majorisation sped up by reduced-rank extrapolation."""

from __future__ import annotations

import numpy as np

from baselines._kernels.smacof import Scaling, StressProblem, attractions, lossless_single
from benchmark.api.contracts import FloatArray


def extrapolated_smacof(
    distances: FloatArray, start: FloatArray, *, cycle: int = 6, max_iterations: int = 100, rtol: float = 1e-3
) -> Scaling:
    r"""Least-squares scaling by cycles of Guttman transforms and one extrapolation.

    After ``cycle`` transforms :math:`x_0, \dots, x_K` the weights :math:`\gamma` with :math:`\sum_j \gamma_j = 1` that
    minimise :math:`\|\sum_j \gamma_j (x_{j+1} - x_j)\|` give the candidate :math:`\sum_j \gamma_j x_j`, which replaces
    the last positions if its stress is lower. Rosman, Bronstein, Bronstein, Sidi and Kimmel (2008), "Fast
    multidimensional scaling using vector extrapolation".

    Parameters
    ----------
    distances
        Distances to be met, symmetric, shape (n, n).
    start
        First positions, shape (n, 3).
    cycle
        Guttman transforms between two extrapolations, at least 2.
    max_iterations
        Largest number of passes over all pairs; trying a candidate costs one, like a transform.
    rtol
        Stop when a transform lowers the stress by less than this fraction.

    Returns
    -------
    Scaling
        As from :func:`baselines._kernels.smacof.smacof`; the stress never rises.
    """
    problem = StressProblem(distances, None)
    points = np.ascontiguousarray((start - start.mean(axis=0)).T)
    targets = lossless_single(distances)
    sums = attractions(points, targets)
    course = [problem.stress(points, sums)]
    steps = [points]
    while len(course) <= max_iterations:
        if len(steps) <= cycle:
            points = problem.solve(sums)
            sums = attractions(points, targets)
            course.append(problem.stress(points, sums))
            steps.append(points)
            if course[-2] - course[-1] <= rtol * course[-2]:
                break
        else:
            candidate = _extrapolate(steps)
            candidate_sums = attractions(candidate, targets)
            stress = problem.stress(candidate, candidate_sums)
            if stress < course[-1]:
                points, sums = candidate, candidate_sums
            course.append(min(stress, course[-1]))
            steps = [points]
    return Scaling(np.ascontiguousarray(points.T), tuple(course))


def _extrapolate(steps: list[FloatArray]) -> FloatArray:
    positions = np.stack(steps[:-1])
    differences = (np.stack(steps[1:]) - positions).reshape(len(positions), -1)
    gram = differences @ differences.T
    # A small ridge, because late differences are nearly parallel; it draws the weights towards their mean.
    weights = np.linalg.solve(gram + 1e-12 * gram.trace() * np.eye(len(gram)), np.ones(len(gram)))
    return np.ascontiguousarray(np.tensordot(weights / weights.sum(), positions, axes=1))
