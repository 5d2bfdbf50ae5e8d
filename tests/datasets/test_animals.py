"""The generated animals: surfaces of a data file, people beside them, and few of both."""

import numpy as np

from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.official import SETS
from benchmark.geometry.camera import FRONT, SIDE


def test_classes_have_the_sizes_of_tosca_and_share_their_triangles():
    dataset = open_dataset("animals")
    sizes = {
        subject: sum(e.subject == subject for e in dataset.shapes)
        for subject in SETS["tosca"].sizes
    }
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
    monkeypatch.setattr("benchmark.datasets.animals._FILE", tmp_path / "animals.npz")
    changed = {
        e.subject for e, key in zip(dataset.shapes, before, strict=True) if dataset.key(e) != key
    }
    assert changed == {"cat", "centaur", "dog", "gorilla", "horse", "wolf"}
