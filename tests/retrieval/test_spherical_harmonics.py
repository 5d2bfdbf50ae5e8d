"""Spherical harmonics on shells: invariant, equal to quadrature by another library, and what hand-work says."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y
from trimesh.creation import box, icosphere

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh
from retrieval.spherical_harmonics import SphericalHarmonics, energies, sample_surface
from tests.toy import rod

SCORER = SphericalHarmonics()


def mesh_of(found):
    return Mesh(np.asarray(found.vertices), np.asarray(found.faces))


def distance(first, second):
    return SCORER.compare([SCORER.signature(first), SCORER.signature(second)], 0)[0, 1]


def half(mesh):
    """An open surface: the triangles on one side of the middle."""
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    return Mesh(mesh.vertices, mesh.faces[centres[:, 0] > np.median(centres[:, 0])])


@pytest.mark.parametrize("shape", [rod(0.1, 1.0), half(rod(0.1, 1.0))], ids=["closed", "open"])
def test_rotation_translation_scaling_and_reflection_change_nothing(shape):
    random = np.random.default_rng(0)
    plain = SCORER.signature(shape)["energies"]
    for turn in Rotation.random(5, rng=random):
        moved = shape.with_vertices(
            shape.vertices @ turn.as_matrix().T * random.uniform(0.01, 100) + random.normal(size=3)
        )
        np.testing.assert_allclose(SCORER.signature(moved)["energies"], plain, atol=1e-12)
        assert distance(shape, moved) == 0  # rounding makes them tie
    mirrored = shape.with_vertices(shape.vertices * [-1, 1, 1])
    np.testing.assert_allclose(SCORER.signature(mirrored)["energies"], plain, atol=1e-12)


def test_another_build_is_farther_away_than_another_triangulation():
    thin, finer, thick = rod(0.06, 0.5), rod(0.06, 0.5, rings=60, sides=20), rod(0.18, 0.5)
    assert distance(thin, finer) < 0.2 * distance(thin, thick)


def test_energies_are_those_of_the_harmonics_of_scipy():
    random = np.random.default_rng(1)
    directions = random.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    weights = random.uniform(size=(3, 40))
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    expected = np.zeros((3, 16))
    for degree in range(16):
        for order in range(-degree, degree + 1):
            coefficients = weights @ sph_harm_y(degree, order, polar, azimuth)
            expected[:, degree] += np.abs(coefficients) ** 2
    np.testing.assert_allclose(energies(directions, csr_array(weights), 16), np.sqrt(expected), atol=1e-12)


def test_a_sphere_has_all_its_energy_in_degree_0_of_one_shell():
    found = SCORER.signature(mesh_of(icosphere(subdivisions=4, radius=3)))["energies"]
    assert found[15, 0] == pytest.approx(0.5 / np.sqrt(np.pi), rel=0.02)  # radius 1/2 is the 16th of 32 shells
    found[15, 0] = 0
    assert found[:, 0].max() < 0.02 * 0.5 / np.sqrt(np.pi)
    assert found[:, 1:].max() < 1e-3


def test_two_far_points_have_even_degrees_alone_each_with_the_energy_of_the_addition_theorem():
    poles = np.array([[0, 0, 1.0], [0, 0, -1.0]])
    found = energies(poles, csr_array([[0.5, 0.5]]), 6)[0]
    degrees = np.arange(6)
    np.testing.assert_allclose(found, np.where(degrees % 2, 0, np.sqrt((2 * degrees + 1) / (4 * np.pi))), atol=1e-15)


def test_a_cube_has_no_odd_degrees_and_none_of_degree_2():
    found = SCORER.signature(mesh_of(box((2, 2, 2))))["energies"]
    # But for the diagonals of its faces, which lead the samples astray a little.
    assert found[:, [1, 2, 3, 5]].max() < 1e-4 < 1e-2 < found[:, 4].max()


def test_samples_have_the_moments_of_the_triangle():
    triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    points, weights = sample_surface(triangle)
    x, y, _ = points.T
    assert weights.sum() == pytest.approx(1)
    # Means over the triangle: i! j! 2 / (i + j + 2)!
    assert weights @ x == pytest.approx(1 / 3)
    assert weights @ (x * y) == pytest.approx(1 / 12)
    assert weights @ (x**2 * y**2) == pytest.approx(8 / 720)


@pytest.mark.parametrize(
    "broken",
    [Mesh(np.zeros((3, 3)), [[0, 1, 2]]), Mesh(np.eye(3), np.empty((0, 3), int)), Mesh(np.ones((3, 3)), [[0, 1, 2]])],
)
def test_a_form_without_extent_is_refused(broken):
    with pytest.raises(InvalidMesh):
        SCORER.signature(broken)


def test_what_lies_beyond_the_last_shell_counts_to_it():
    spike = mesh_of(icosphere(subdivisions=2))
    vertices = spike.vertices.copy()
    vertices[0] *= 20
    found = SCORER.signature(spike.with_vertices(vertices))["energies"]
    assert found[:, 0].sum() == pytest.approx(0.5 / np.sqrt(np.pi))
