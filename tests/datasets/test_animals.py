import numpy as np
import pytest
import trimesh

from benchmark.datasets.animals import Animals, animals_mesh
from benchmark.datasets.animals.poses import POSES
from benchmark.geometry.mesh import edges_of

pytestmark = pytest.mark.kernels

SOME = [f"{name}{number}" for name in ("cat", "gorilla") for number in range(3)]


def edge_lengths(mesh, edges):
    return np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)


def strain(rest, posed):
    edges = edges_of(rest.faces).ends
    return np.abs(edge_lengths(posed, edges) / edge_lengths(rest, edges) - 1.0)


def assert_sphere_like(mesh):
    """Closed, oriented outwards, one piece, genus 0."""
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight and solid.is_winding_consistent
    assert (solid.body_count, solid.euler_number) == (1, 2)
    assert solid.volume > 0
    assert mesh.face_areas.min() > 0


@pytest.fixture(scope="module")
def some():
    return {identifier: animals_mesh(identifier) for identifier in SOME}


def test_recipes_tell_all_shapes_apart_and_follow_the_data(monkeypatch):
    dataset = Animals()
    recipes = {entry.identifier: dataset.recipe(entry) for entry in dataset.entries}
    assert len(set(recipes.values())) == 80
    monkeypatch.setitem(POSES["cat"], "sitting", {"tail": (90,)})
    changed = {entry.identifier for entry in dataset.entries if dataset.recipe(entry) != recipes[entry.identifier]}
    assert changed == {"cat2"}


def test_meshes_are_closed_and_share_their_triangles(some):
    for identifier, mesh in some.items():
        assert 5000 < mesh.n_vertices < 10000
        if identifier.endswith("0"):
            assert_sphere_like(mesh)
        assert np.array_equal(mesh.faces, some[f"{identifier[:-1]}0"].faces)


def test_poses_are_nearly_isometric(some):
    for identifier, mesh in some.items():
        stretched = strain(some[f"{identifier[:-1]}0"], mesh)
        assert stretched.mean() < 0.03, identifier
        assert np.percentile(stretched, 95) < 0.10, identifier
        assert mesh.area == pytest.approx(some[f"{identifier[:-1]}0"].area, rel=0.04)


# Parts of the generator
