import numpy as np
import pytest

from benchmark.datasets.shrec14 import shrec14
from benchmark.datasets.tosca import tosca
from benchmark.errors import DatasetError
from benchmark.geometry.depth import FRONT, SIDE
from tests.toy import rod, write_off


def test_shrec14_labels_follow_the_file_numbers(tmp_path):
    for number in range(300):
        (tmp_path / "shrec14" / "synthetic").mkdir(parents=True, exist_ok=True)
        (tmp_path / "shrec14" / "synthetic" / f"{number}.obj").write_text("")
    dataset = shrec14(tmp_path, "synthetic")
    entry = dataset.entries[219]
    assert (entry.identifier, entry.subject, entry.pose) == ("219", "10", "19")
    (tmp_path / "shrec14" / "synthetic" / "7.obj").unlink()
    with pytest.raises(DatasetError, match="holds 299 numbered meshes, not 0 to 299, number 7 is missing"):
        shrec14(tmp_path, "synthetic")


def test_tosca_reads_its_three_layouts(tmp_path):
    import scipy.io

    mesh = rod(0.1, 1.0)
    write_off(tmp_path / "tosca" / "cat0.off", mesh)
    x, y, z = (mesh.vertices[:, [k]] for k in range(3))
    scipy.io.savemat(tmp_path / "tosca" / "cat1.mat", {"surface": {"X": x, "Y": y, "Z": z, "TRIV": mesh.faces + 1}})
    np.savetxt(tmp_path / "tosca" / "dog0.vert", mesh.vertices)
    np.savetxt(tmp_path / "tosca" / "dog0.tri", mesh.faces + 1, fmt="%d")
    write_off(tmp_path / "tosca" / "david12.off", mesh)
    (tmp_path / "tosca" / "readme.txt").write_text("")
    dataset = tosca(tmp_path)
    assert [(e.identifier, e.subject) for e in dataset.entries] == [
        ("cat0", "cat"),
        ("cat1", "cat"),
        ("david12", "david"),
        ("dog0", "dog"),
    ]
    for entry in dataset.entries:
        read = dataset.load(entry)
        np.testing.assert_allclose(read.vertices, mesh.vertices, rtol=1e-12)
        np.testing.assert_array_equal(read.faces, mesh.faces)
    assert [dataset.camera(e) for e in dataset.entries] == [SIDE, SIDE, FRONT, SIDE]


def test_an_absent_tosca_is_named(tmp_path):
    (tmp_path / "tosca").mkdir()
    with pytest.raises(DatasetError, match="no TOSCA meshes.*expected files such as cat0.off"):
        tosca(tmp_path)


@pytest.mark.data
def test_tosca_has_its_published_classes(data_root):
    counts = {}
    for entry in tosca(data_root).entries:
        counts[entry.subject] = counts.get(entry.subject, 0) + 1
    assert counts == {
        "cat": 11,
        "centaur": 6,
        "david": 7,
        "dog": 9,
        "gorilla": 4,
        "horse": 8,
        "michael": 20,
        "victoria": 12,
        "wolf": 3,
    }
