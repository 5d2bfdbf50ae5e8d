"""The generated animals: surfaces of a data file, people beside them, and few of both."""

import numpy as np
import pytest
from trimesh import Trimesh

from benchmark.datasets import animals as module
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.official import SETS
from benchmark.geometry.camera import FRONT, SIDE


@pytest.mark.parametrize("name", ["cat2", "centaur0", "dog8", "gorilla3", "horse7", "wolf1", "victoria5"])
def test_a_shape_is_closed_and_stands_on_the_ground_in_the_middle(name):
    dataset = open_dataset("animals")
    mesh = dataset.load(next(entry for entry in dataset.shapes if entry.identifier == name))
    surface = Trimesh(mesh.vertices, mesh.faces, process=False)
    assert surface.is_watertight and surface.is_winding_consistent and surface.body_count == 1
    assert surface.euler_number == 2
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose([*(low + high)[:2], low[2]], 0, atol=2e-4)
    assert 50 < (high - low).max() < 2 * dataset.half_width


def test_classes_have_the_sizes_of_tosca_and_share_their_triangles():
    dataset = open_dataset("animals")
    sizes = {subject: sum(e.subject == subject for e in dataset.shapes) for subject in SETS["tosca"].sizes}
    assert sizes == SETS["tosca"].sizes
    first, second = (dataset.load(dataset.shapes[k]) for k in (0, 5))
    np.testing.assert_array_equal(first.faces, second.faces)
    assert {e.subject: dataset.camera(e) for e in dataset.shapes}["cat"] == SIDE
    assert dataset.camera(dataset.shapes[-5]) in (FRONT, SIDE)
    assert len({dataset.key(entry) for entry in dataset.shapes}) == 80


def test_another_file_makes_other_animals_and_the_same_people(tmp_path, monkeypatch):
    dataset = open_dataset("animals")
    before = [dataset.key(entry) for entry in dataset.shapes]
    (tmp_path / "animals.npz").write_bytes(b"")
    monkeypatch.setattr(module, "_FILE", tmp_path / "animals.npz")
    changed = {e.subject for e, key in zip(dataset.shapes, before, strict=True) if dataset.key(e) != key}
    assert changed == {"cat", "centaur", "dog", "gorilla", "horse", "wolf"}
