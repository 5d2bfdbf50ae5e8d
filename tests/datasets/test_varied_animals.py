"""Animals of random proportions: whole, of one piece in every pose, and what the numbers say when chance is silent."""

import igl
import numpy as np
import pytest

from benchmark.datasets.animals.generate import SPECIES
from benchmark.datasets.varied_animals import SPECIES_IN_TURN, AnimalSampler, sampler
from benchmark.errors import DatasetError, InvalidMesh

pytestmark = pytest.mark.kernels


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Make bodies of fewer triangles, in less time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampler, "N_VERTICES", 1500)
        yield


@pytest.fixture(scope="module")
def animals():
    """One animal of each species in two poses beside the rest pose."""
    return [AnimalSampler(7, 2)(number) for number in range(len(SPECIES_IN_TURN))]


def test_every_species_has_its_turn(animals):
    assert [name for name, _ in animals] == list(SPECIES_IN_TURN) == list(SPECIES)


def test_an_animal_is_closed_and_of_one_piece_and_has_one_set_of_triangles(animals):
    for _, meshes in animals:
        assert len(meshes) == 3
        mesh = meshes[0]
        edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
        assert igl.connected_components(igl.adjacency_matrix(mesh.faces.astype(np.int64)))[0] == 1
        for other in meshes:
            assert np.array_equal(other.faces, mesh.faces)
            assert np.isfinite(other.vertices).all()


def test_a_pose_bends_and_hardly_stretches(animals):
    for name, (rest, *moved) in animals:
        a, b, _ = rest.faces.T
        length = np.linalg.norm(rest.vertices[a] - rest.vertices[b], axis=1)
        for mesh in moved:
            now = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
            assert np.median(np.abs(now / length - 1.0)) < 0.05, name
            assert np.abs(mesh.area / rest.area - 1.0) < 0.1, name
            assert np.abs(mesh.vertices - rest.vertices).max() > 5.0, name


def test_an_animal_is_a_function_of_its_number_and_of_how_often_it_was_drawn():
    made = AnimalSampler(7, 1)
    (_, first), (_, same), (_, again), (_, next_cat) = made(0), made(0), made(0, 1), made(6)
    assert np.array_equal(first[1].vertices, same[1].vertices)
    sizes = {tuple(np.ptp(meshes[0].vertices, axis=0).round(3)) for meshes in (first, again, next_cat)}
    assert len(sizes) == 3, "three animals"


def test_a_body_with_a_hole_is_drawn_again_and_one_without_end_is_an_error(monkeypatch):
    calls = []
    whole = sampler.surface

    def broken_first(*arguments):
        calls.append(arguments)
        if len(calls) == 1:
            raise InvalidMesh("a handle", "correct it")
        return whole(*arguments)

    monkeypatch.setattr(sampler, "surface", broken_first)
    name, meshes = AnimalSampler(7, 0)(2)
    assert (name, len(meshes), len(calls)) == ("dog", 1, 2)

    def never(*_):
        raise InvalidMesh("a handle", "correct it")

    monkeypatch.setattr(sampler, "surface", never)
    with pytest.raises(DatasetError, match="animal 2 of sample 7 has no closed body"):
        AnimalSampler(7, 0)(2)
