"""What is known on a decimated mesh is carried over to the points that it was made from."""

import numpy as np
import pytest

from benchmark.geometry.cleaning import compact
from benchmark.geometry.interpolation import nearest_on_surface, vertex_normals
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from tests.geometry.surfaces import flat_grid, sphere

SHEAR = np.array([[1.0, 0.3, 0.0], [0.0, 2.0, -0.4], [0.1, 0.0, 0.5]])


def carried(mesh, count, function):
    """A function of space, sampled at the vertices of the prepared mesh and carried back; and its true values."""
    prepared = prepare(mesh, count)
    points = (mesh.vertices - prepared.centre) / prepared.scale
    places = nearest_on_surface(prepared.mesh, points, vertex_normals(mesh))
    return places.carry(function(prepared.mesh.vertices)), function(points), places


def test_an_affine_map_is_carried_over_as_exactly_as_the_prepared_mesh_is_met():
    mesh = flat_grid(60)
    values, true, places = carried(mesh, 300, lambda x: x @ SHEAR + 1.0)
    assert len(np.unique(places.corners)) <= 303
    assert places.distances.max() < 1e-5
    errors = np.linalg.norm(values - true, axis=1)
    assert (errors <= np.linalg.norm(SHEAR, 2) * places.distances + 1e-12).all()


def test_a_curved_map_is_met_better_than_by_the_nearest_vertex():
    def bend(x):
        return np.stack([x[:, 0], x[:, 1], x[:, 2] + 2 * x[:, 0] ** 2], axis=1)

    mesh = sphere(5)
    values, true, places = carried(mesh, 500, bend)
    prepared = prepare(mesh, 500)
    points = (mesh.vertices - prepared.centre) / prepared.scale
    nearest = np.linalg.norm(points[:, None] - prepared.mesh.vertices[None], axis=2).argmin(axis=1)
    error = np.abs(values - true).max()
    assert error < 0.01
    assert error < np.abs(bend(prepared.mesh.vertices[nearest]) - true).max() / 3
    assert places.distances.max() < 0.01


@pytest.fixture
def slab():
    """Two sheets that face away from each other, a hundredth apart."""
    lower, upper = flat_grid(12, 1 / 11), flat_grid(12, 1 / 11)
    count = lower.n_vertices
    vertices = np.concatenate([lower.vertices * [1, 1, 0], upper.vertices * [1, 1, 0] + [0, 0, 0.01]])
    up = 1 if vertex_normals(upper)[0, 2] > 0 else -1
    faces = np.concatenate([lower.faces[:, ::-up], upper.faces[:, ::up] + count])
    return compact(vertices, faces)


def test_of_two_parts_that_lie_close_together_the_one_that_looks_the_same_way_is_taken(slab):
    points = np.array([[0.4, 0.6, 0.002], [0.4, 0.6, 0.008], [0.52, 0.31, 0.002]])
    normals = np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, -1.0]])
    places = nearest_on_surface(slab, points, normals)
    np.testing.assert_allclose(places.carry(slab.vertices)[:, 2], [0.01, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(places.carry(slab.vertices)[:, :2], points[:, :2], atol=1e-12)


def test_where_nothing_looks_the_same_way_the_nearest_is_taken():
    triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    places = nearest_on_surface(triangle, [[0.5, 0.5, 0.0]], [[-1.0, -1.0, -1.0]])
    np.testing.assert_allclose(places.weights, [[0.5, 0.5, 0.0]], atol=1e-12)
