"""Minimisation of stress by limited-memory quasi-Newton steps, with the Guttman transform as the plain step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmark.api.contracts import FloatArray

#: Number of past steps that define the curvature.
MEMORY = 6
#: A step defines a curvature only if that is larger than this share of the largest possible.
FLAT = 1e-10
#: Below this, a stress consists of rounding errors: the start matches the distances to single precision.
ROUNDING = 1e-14


def minimise(
    evaluate: Callable[[FloatArray], tuple[float, FloatArray]],
    start: FloatArray,
    *,
    max_iterations: int,
    rtol: float,
    grain: float | None = None,
) -> tuple[FloatArray, list[float]]:
    r"""Minimise a stress by L-BFGS [Liu and Nocedal 1989].

    With equal weights, the gradient of the stress at X is a multiple of X - G(X), where G is the Guttman transform [de
    Leeuw 1977]. The transform itself is a steepest-descent step of fixed length; with the curvature of the last few
    steps, far fewer steps suffice. If a step does not lower the stress, the transform, which never raises it, replaces
    the step, and the curvature is reset.

    Parameters
    ----------
    evaluate
        Takes positions; returns their stress and their Guttman transform.
    start
        Initial positions, rows of coordinates, shape (3, n).
    max_iterations
        Maximum number of evaluations after the first.
    rtol
        Stop when a step lowers the stress by less than this fraction, or after the first step if the stress of the
        start is below :data:`ROUNDING`.
    grain
        Round positions to multiples of this after each step. Dozens of steps can amplify a rounding error a billion
        times; a grain far above rounding errors and far below relevant differences removes them where they arise.

    Returns
    -------
    points : numpy.ndarray
        Shape (3, n).
    course : list of float
        Stress of the start and after every evaluation; never rises.
    """
    points = start
    stress, transform = evaluate(points)
    course = [stress]
    residual = points - transform
    moves: list[tuple[FloatArray, FloatArray]] = []
    while len(course) <= max_iterations:
        candidate = points - _newton_direction(residual, moves)
        if grain is not None:
            candidate = np.round(candidate / grain) * grain
        lower, transformed = evaluate(candidate)
        if moves and not lower < course[-1]:
            moves = []
            course.append(course[-1])
            continue
        course.append(min(lower, course[-1]))
        if lower <= course[-2]:
            change = candidate - points, candidate - transformed - residual
            points, residual = candidate, candidate - transformed
            if np.vdot(*change) > FLAT * np.linalg.norm(change[0]) * np.linalg.norm(change[1]):
                moves = [*moves[1 - MEMORY :], change]
        if course[-2] - course[-1] <= rtol * course[-2] or course[0] < ROUNDING:
            break
    return points, course


def _newton_direction(residual: FloatArray, moves: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Apply the inverse curvature by the two-loop recursion [Nocedal 1980]; without moves, the identity."""
    direction = residual.copy()
    shares = []
    for step, change in reversed(moves):
        shares.append(np.vdot(step, direction) / np.vdot(step, change))
        direction -= shares[-1] * change
    if moves:
        step, change = moves[-1]
        direction *= np.vdot(step, change) / np.vdot(change, change)
    for (step, change), share in zip(moves, reversed(shares), strict=True):
        direction += (share - np.vdot(change, direction) / np.vdot(step, change)) * step
    return direction
