"""Mutual repulsion of all vertices, and its balance with the as-rigid-as-possible energy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from baselines._kernels.arap import AsRigidAsPossible
from benchmark.api.contracts import FloatArray

PROXIMITY = 1e-4
"""Diagonal of the global step, as a share of the stiffness. Both energies are invariant under translation, so the
system needs a hold; a weak hold of every vertex at its current position keeps the descent monotone."""


def relax(
    surface: AsRigidAsPossible,
    solve: Callable[[FloatArray], FloatArray],
    masses: FloatArray,
    positions: FloatArray,
    stiffness: float,
    steps: int,
) -> FloatArray:
    r"""Let the vertices of a surface repel each other against its elastic energy.

    The energy is :math:`-\sum_{i<j} a_i a_j \|x_i - x_j\| + \beta E_\mathrm{ARAP}(x)`. Each step replaces the concave
    first term by its tangent and the rotations by the best ones, both upper bounds that touch the energy at the current
    positions, and minimises their sum exactly by one sparse solve: the energy never rises (majorisation; Hunter &
    Lange 2004). It is bounded below, since the repulsion grows linearly and the elastic energy quadratically.

    Parameters
    ----------
    surface
        Elastic energy and rest positions.
    solve
        Solves the system of the surface with ``PROXIMITY * masses`` added, which does not depend on the stiffness.
    masses
        Weight of each vertex in the repulsion, shape (n,), sum 1.
    positions
        Initial positions, shape (n, 3).
    stiffness
        Factor :math:`\beta` of the elastic energy, in the inverse unit of the positions.
    steps
        Number of steps.

    Returns
    -------
    numpy.ndarray
        Positions after the last step, shape (n, 3); the centroid under ``masses`` does not change.
    """
    centroid = masses @ positions
    for _ in range(steps):
        load = surface.load(surface.rotations(positions)) + repulsion(positions, masses) / (2 * stiffness)
        positions = solve(load + PROXIMITY * masses[:, None] * positions)
        positions += centroid - masses @ positions
    return positions


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"}, error_model="numpy")  # type: ignore[untyped-decorator]
def repulsion(positions: FloatArray, masses: FloatArray) -> FloatArray:
    r"""Return the gradient of the spread :math:`\sum_{i<j} a_i a_j \|x_i - x_j\|`, shape (n, 3)."""
    # Every pair is visited twice: without writes, the inner loop vectorises.
    x, y, z = positions[:, 0].copy(), positions[:, 1].copy(), positions[:, 2].copy()
    forces = np.empty_like(positions)
    for i in range(len(masses)):
        sx, sy, sz = 0.0, 0.0, 0.0
        for j in range(len(masses)):
            dx, dy, dz = x[i] - x[j], y[i] - y[j], z[i] - z[j]
            squared = dx * dx + dy * dy + dz * dz
            # A root in single precision and one step of Newton's method: all digits in two thirds of the time.
            guess = np.float64(np.float32(1.0) / np.sqrt(np.float32(squared))) if squared > 1e-30 else 0.0
            push = masses[j] * guess * (1.5 - 0.5 * squared * guess * guess)
            sx, sy, sz = sx + push * dx, sy + push * dy, sz + push * dz
        forces[i, 0], forces[i, 1], forces[i, 2] = masses[i] * sx, masses[i] * sy, masses[i] * sz
    return forces
