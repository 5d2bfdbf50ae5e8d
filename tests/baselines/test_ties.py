"""Choices by geometry, axes that a solver leaves open, a frame and a solver that do not hang on the last bits."""

from fractions import Fraction

import numpy as np
from scipy.sparse import csr_array

from baselines._kernels.arap import factorise_definite
from baselines._kernels.refinement import refined_solution


def test_refinement_gives_the_exact_solution_rounded():
    """Hilbert's matrix of order 6 has a condition number of 1e7; fractions give its exact solution."""
    n = 6
    # Multiplied by the common denominator, the entries are whole numbers and exact in double precision.
    matrix = np.array([[27720 / (i + j + 1) for j in range(n)] for i in range(n)])
    right = np.array([3.0, -1.0, 4.0, 1.0, -5.0, 9.0])
    expected = _solve_exactly(matrix, right)
    columns = np.repeat(right[:, None], 3, axis=1)
    plain = factorise_definite(csr_array(matrix))(columns)
    refined = refined_solution(csr_array(matrix), columns)
    assert np.abs(plain[:, 0] / expected - 1).max() > 1e-13
    np.testing.assert_allclose(refined, np.repeat(expected[:, None], 3, axis=1), rtol=2.3e-16)


def _solve_exactly(matrix, right):
    n = len(right)
    rows = [[Fraction(entry) for entry in row] + [Fraction(value)] for row, value in zip(matrix, right, strict=True)]
    for k in range(n):
        for i in range(n):
            if i != k:
                share = rows[i][k] / rows[k][k]
                rows[i] = [a - share * b for a, b in zip(rows[i], rows[k], strict=True)]
    return np.array([float(rows[k][n] / rows[k][k]) for k in range(n)])
