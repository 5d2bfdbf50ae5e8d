"""Solution of sparse definite systems to the last digits on any processor."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import csr_array

from baselines._kernels.arap import factorise_definite
from benchmark.api.contracts import FloatArray

STEPS = 4
"""Maximum number of corrections. Each multiplies the error by the condition number times the unit roundoff."""

SPLITTER = 2.0**27 + 1.0


def refined_solution(matrix: csr_array, right: FloatArray) -> FloatArray:
    """Solve a symmetric positive definite sparse system with corrections from residuals in doubled precision.

    A factorisation loses as many digits as the condition number has, and the wrong digits depend on the BLAS. Residuals
    in twice the precision recover them (Wilkinson 1963; Higham 2002, chapter 12): as long as the factors have any
    correct digit, the result is the exact solution, rounded.

    Parameters
    ----------
    matrix
        Shape (n, n).
    right
        Shape (n, 3).

    Returns
    -------
    numpy.ndarray
        Shape (n, 3).
    """
    solve = factorise_definite(matrix)
    solution = solve(right)
    size = np.inf
    for _ in range(STEPS):
        correction = solve(_residual(matrix.indptr, matrix.indices, matrix.data, solution, right))
        previous, size = size, float(np.abs(correction).max())
        # Corrections that do not shrink come from factors without a correct digit.
        if not size < previous:
            break
        solution = solution + correction
    return solution


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _residual(
    starts: NDArray[np.int32], ends: NDArray[np.int32], data: FloatArray, solution: FloatArray, right: FloatArray
) -> FloatArray:
    """Right-hand side minus matrix times solution, summed in doubled precision (Dekker 1971, Knuth 1969)."""
    residual = np.empty_like(right)
    for i in range(len(right)):
        for axis in range(right.shape[1]):
            high, low = right[i, axis], 0.0
            for k in range(starts[i], starts[i + 1]):
                a, b = -data[k], solution[ends[k], axis]
                scaled = SPLITTER * a
                a_high = scaled - (scaled - a)
                a_low = a - a_high
                scaled = SPLITTER * b
                b_high = scaled - (scaled - b)
                b_low = b - b_high
                product = a * b
                error = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
                total = high + product
                part = total - high
                low += (high - (total - part)) + (product - part) + error
                high = total
            residual[i, axis] = high + low
    return residual
