"""Choices by geometry, axes that a solver leaves open, a frame and a solver that do not hang on the last bits."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from baselines._kernels.arap import factorise_definite
from baselines._kernels.frame import GRID, on_grid, principal_frame
from baselines._kernels.orientation import settled_axes
from baselines._kernels.refinement import refined_solution
from baselines._kernels.ties import TIE, largest
from benchmark.plugins.conformance.shapes import figure
from tests.baselines.deformable import tube

CORNERS = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0, 0]])


@pytest.mark.parametrize("noise", [0.0, 1e-12, -1e-12])
def test_of_equal_values_the_first_by_coordinates_counts(noise):
    values = np.array([3.0, 3.0 + noise, 3.0, 1.0])
    for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
        assert order[largest(values[order], CORNERS[order] + noise)] == 2
    assert largest(values * [1, 1 + 3 * TIE, 1, 1], CORNERS) == 1


def test_what_cannot_be_reached_is_farthest():
    assert largest(np.array([1.0, np.inf, np.inf, 2.0]), CORNERS) == 2
    assert largest(-np.array([1.0, 5.0, 5.0, 2.0]), CORNERS) == 0


def test_axes_of_equal_eigenvalues_do_not_depend_on_the_basis():
    ring = tube(0.0).vertices[:, 1:]
    turned = ring @ Rotation.from_euler("z", 1.234).as_matrix()[:2, :2] * [1, -1]
    expected, found = (settled_axes(each, np.array([2.0, 2.0 + 1e-9]), tube(0.0).vertices) for each in (ring, turned))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.linalg.norm(ring, axis=1), atol=1e-12)
    np.testing.assert_array_equal(settled_axes(turned, np.array([2.0, 1.9]), tube(0.0).vertices), turned)


def test_the_frame_turns_with_the_surface_and_gives_it_back():
    mesh = figure()
    turned = mesh.with_vertices(3 * mesh.vertices @ Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix().T + 5)
    frame, other = principal_frame(mesh), principal_frame(turned)
    np.testing.assert_array_equal(on_grid(turned, other).vertices, on_grid(mesh, frame).vertices)
    np.testing.assert_allclose(frame.points(frame.coordinates(mesh.vertices)), mesh.vertices, atol=1e-14)
    assert np.abs(on_grid(mesh, frame).vertices - frame.coordinates(mesh.vertices)).max() <= GRID / 2


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
