import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh

from benchmark.datasets.animals import CANONICAL_POSE, CLASSES, Animals, animals_mesh
from benchmark.datasets.animals.generate import SPECIES
from benchmark.datasets.animals.people import PEOPLE
from benchmark.datasets.animals.poses import POSES
from benchmark.datasets.animals.skeleton import Skeleton
from benchmark.datasets.base import check_retrievable
from benchmark.datasets.official.tosca import CLASS_SIZES
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.edges import edges_of

pytestmark = pytest.mark.kernels

SOME = [f"{name}{number}" for name in ("cat", "gorilla") for number in range(3)]


def edge_lengths(mesh, edges):
    return np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)


def strain(rest, posed):
    edges = edges_of(rest.faces).ends
    return np.abs(edge_lengths(posed, edges) / edge_lengths(rest, edges) - 1.0)


def signed_volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def assert_sphere_like(mesh):
    """Edge-manifold, closed, consistently oriented outwards, one piece, genus 0, no vertex unused."""
    directed = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there, back = (np.unique(directed @ [mesh.n_vertices, 1][::way]) for way in (1, -1))
    assert len(there) == len(directed)
    assert np.array_equal(there, back)
    graph = csr_matrix((np.ones(len(directed)), directed.T), shape=(mesh.n_vertices,) * 2)
    assert connected_components(graph)[0] == 1
    assert mesh.n_vertices - len(directed) // 2 + mesh.n_faces == 2
    assert signed_volume(mesh) > 0
    assert mesh.face_areas.min() > 0


def shape_dna(mesh, count=12):
    """First eigenvalues times area (Reuter, Wolter and Peinecke, 2006)."""
    import igl

    vertices, faces = np.array(mesh.vertices), mesh.faces.astype(np.int64)
    mass = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_VORONOI).diagonal()
    root = diags(1.0 / np.sqrt(mass))
    values = eigsh(root @ -igl.cotmatrix(vertices, faces) @ root, count + 1, sigma=-1e-6, return_eigenvectors=False)
    return np.sort(values)[1:] * mesh.area


def nearest_neighbour_accuracy(meshes):
    descriptors = np.array([shape_dna(mesh) for mesh in meshes.values()])
    classes = np.array([name.rstrip("0123456789") for name in meshes])
    distances = np.abs(descriptors[:, None] / descriptors[None] - 1.0).sum(axis=2)
    distances = distances + distances.T
    np.fill_diagonal(distances, np.inf)
    return float((classes[distances.argmin(axis=1)] == classes).mean())


@pytest.fixture(scope="module")
def some():
    return {identifier: animals_mesh(identifier) for identifier in SOME}


def test_classes_have_the_sizes_of_tosca():
    assert CLASSES == CLASS_SIZES
    entries = Animals().entries
    assert len(entries) == 80
    assert [entry.identifier for entry in entries] == [f"{n}{k}" for n in sorted(CLASSES) for k in range(CLASSES[n])]
    assert all(entry.pose == CANONICAL_POSE for entry in entries if entry.identifier == f"{entry.subject}0")
    assert len({(entry.subject, entry.pose) for entry in entries}) == 80
    check_retrievable(Animals())


def test_cameras_look_at_the_flank_of_four_legged_animals():
    dataset = Animals()
    assert {e.subject for e in dataset.entries if dataset.camera(e) == SIDE} == {
        "cat",
        "centaur",
        "dog",
        "horse",
        "wolf",
    }
    assert {e.subject for e in dataset.entries if dataset.camera(e) == FRONT} == {"david", "gorilla", *PEOPLE}


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
        assert signed_volume(mesh) == pytest.approx(signed_volume(some[f"{identifier[:-1]}0"]), rel=0.2)


def test_spectra_tell_classes_apart_whatever_the_pose(some):
    assert nearest_neighbour_accuracy(some) == 1.0


# Parts of the generator


def test_every_pose_names_parts_and_bones_that_exist():
    for name, poses in POSES.items():
        chains = Skeleton.of(SPECIES[name]).chains
        for pose in poses.values():
            for part, aims in pose.items():
                matching = [chain for chain in chains if chain == part or chain.startswith(f"{part}.")]
                assert matching, (name, part)
                assert aims is None or len(aims) <= len(chains[matching[0]]), (name, part)


@pytest.mark.exhaustive
def test_all_eighty_shapes():
    pytest.importorskip("anny")
    dataset = Animals()
    meshes = {entry.identifier: dataset.load(entry) for entry in dataset.entries}
    for entry in dataset.entries:
        mesh, rest = meshes[entry.identifier], meshes[f"{entry.subject}0"]
        assert np.array_equal(mesh.faces, rest.faces)
        assert np.ptp(mesh.vertices, axis=0).max() < 2 * 0.95 * dataset.half_width, entry
        if entry.subject in PEOPLE:
            continue
        stretched = strain(rest, mesh)
        assert stretched.mean() < 0.03, entry
        assert np.percentile(stretched, 95) < 0.10, entry
    for name in CLASSES:
        assert_sphere_like(meshes[f"{name}0"])
    animals = {name: mesh for name, mesh in meshes.items() if name.rstrip("0123456789") not in PEOPLE}
    assert nearest_neighbour_accuracy(animals) > 0.9
    assert nearest_neighbour_accuracy(meshes) > 0.7
