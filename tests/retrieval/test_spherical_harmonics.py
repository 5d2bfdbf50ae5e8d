"""Spherical harmonics on shells: invariant, equal to quadrature by another library, and what hand-work says."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh
from retrieval.spherical_harmonics import SphericalHarmonics, energies
from tests.geometry.surfaces import sphere
from tests.toy import rod

SCORER = SphericalHarmonics()


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
    shells = SCORER.signature(sphere(4))["energies"]
    assert shells[15, 0] == pytest.approx(0.5 / np.sqrt(np.pi), rel=0.02)  # radius 1/2 is the 16th of 32 shells
    shells[15, 0] = 0
    assert shells[:, 0].max() < 0.02 * 0.5 / np.sqrt(np.pi)
    assert shells[:, 1:].max() < 1e-3


@pytest.mark.parametrize(
    "broken",
    [Mesh(np.zeros((3, 3)), [[0, 1, 2]]), Mesh(np.eye(3), np.empty((0, 3), int)), Mesh(np.ones((3, 3)), [[0, 1, 2]])],
)
def test_a_form_without_extent_is_refused(broken):
    with pytest.raises(InvalidMesh):
        SCORER.signature(broken)
