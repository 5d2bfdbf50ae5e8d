"""The order of vertices and triangles follows from positions alone."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.api.contracts import Shape
from benchmark.geometry.cleaning import make_manifold
from benchmark.geometry.mesh import Mesh, in_spatial_order
from benchmark.geometry.preparation import prepare
from tests.geometry.surfaces import flat_grid, joined, limbed_body, relabelled, sphere


def renumbered(mesh: Mesh, seed: int) -> Mesh:
    """The same surface with vertices, triangles and the first corner of each triangle in a random order."""
    random = np.random.default_rng(seed)
    mixed, _ = relabelled(mesh, seed)
    faces = mixed.faces[random.permutation(mesh.n_faces)]
    turned = (random.integers(3, size=(mesh.n_faces, 1)) + np.arange(3)) % 3
    return Mesh(mixed.vertices, np.take_along_axis(faces, turned, axis=1))


def touching_cones() -> Mesh:
    """Two pyramids with their tips at one position, which belongs to two vertices once the mesh is a manifold."""
    base = np.array([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
    faces = [[0, k, k % 4 + 1] for k in range(1, 5)]
    other = [[0, k + 4, (k % 4) + 5] for k in range(1, 5)]
    return make_manifold(Mesh(np.vstack([[[0, 0, 0]], base, -base]), np.array(faces + other)))


@pytest.mark.parametrize("mesh", [limbed_body(3), flat_grid(12), sphere(3), touching_cones()])
def test_numbering_of_a_file_leaves_nothing(mesh):
    ordered = in_spatial_order(mesh)
    for seed in range(3):
        again = in_spatial_order(renumbered(mesh, seed))
        np.testing.assert_array_equal(again.vertices, ordered.vertices)
        np.testing.assert_array_equal(again.faces, ordered.faces)


@pytest.mark.parametrize("mesh", [limbed_body(3), flat_grid(12), joined(sphere(1), flat_grid(4))])
def test_last_bits_of_coordinates_decide_nothing(mesh):
    """Mirrored and regular shapes have many coordinates that are equal but for rounding."""
    noise = 1e-13 * np.random.default_rng(0).standard_normal(mesh.vertices.shape)
    moved = in_spatial_order(mesh.with_vertices(mesh.vertices + noise))
    np.testing.assert_array_equal(moved.faces, in_spatial_order(mesh).faces)


def test_prepared_meshes_do_not_depend_on_the_numbering():
    mesh = limbed_body(3)
    prepared, again = prepare(mesh).mesh, prepare(renumbered(mesh, 1)).mesh
    np.testing.assert_array_equal(again.faces, prepared.faces)
    np.testing.assert_allclose(again.vertices, prepared.vertices, atol=1e-12)


def test_draws_follow_from_seed_purpose_and_measurements_alone():
    mesh = limbed_body(3)

    def drawn(mesh, name="one", seed=0, purpose=""):
        return Shape(identifier=name, mesh=mesh, seed=seed).random(purpose).random()

    moved = mesh.with_vertices(2 * renumbered(mesh, 0).vertices[:, [1, 2, 0]] + 5.0)
    assert drawn(moved) == drawn(mesh) == drawn(mesh, name="other")
    others = [drawn(sphere(3)), drawn(mesh, seed=1), drawn(mesh, purpose="x"), drawn(limbed_body(2))]
    stretched = mesh.with_vertices(mesh.vertices * [1, 1, 1.001])
    assert len({drawn(mesh), drawn(stretched), *others}) == 6
