import numpy as np
import pytest

from benchmark.datasets.catalogue import canonical_entry
from benchmark.datasets.official.tosca import CLASS_SIZES, tosca
from benchmark.errors import ConfigurationError, DatasetError, UnreadableMesh
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.mesh import Mesh
from tests.toy import rod, write_off


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


def test_tosca_may_stay_as_its_archive_unpacks(tmp_path):
    for name in ("nonrigid/cats/cat0", "nonrigid/dog0", "david0"):
        write_off(tmp_path / "tosca" / f"{name}.off", rod(0.1, 1.0))
    assert [entry.identifier for entry in tosca(tmp_path).entries] == ["cat0", "david0", "dog0"]
    write_off(tmp_path / "tosca" / "cat0.off", rod(0.1, 1.0))
    with pytest.raises(DatasetError, match="holds one shape as .*cat0.off and .*cats/cat0.off; keep one"):
        tosca(tmp_path)


def test_an_absent_tosca_is_named(tmp_path):
    (tmp_path / "tosca").mkdir()
    with pytest.raises(DatasetError, match="no TOSCA meshes.*expected files such as cat0.off"):
        tosca(tmp_path)


@pytest.mark.data
def test_tosca_has_its_published_classes(data_root):
    counts = {}
    for entry in tosca(data_root).entries:
        counts[entry.subject] = counts.get(entry.subject, 0) + 1
    assert counts == CLASS_SIZES
    assert sum(counts.values()) == 80


def test_tosca_takes_the_null_pose_or_what_its_folder_says(tmp_path):
    for name in ("cat1", "cat0", "gorilla0", "gorilla1", "wolf2", "wolf1"):
        write_off(tmp_path / "tosca" / f"{name}.off", rod(0.1, 1.0))

    def canonical():
        dataset = tosca(tmp_path)
        return [canonical_entry(dataset, subject).identifier for subject in ("cat", "gorilla", "wolf")]

    assert canonical() == ["cat0", "gorilla1", "wolf1"]
    toml = tmp_path / "tosca" / "dataset.toml"
    toml.write_text('[canonical_pose]\ncat = "1"\n[camera]\ncat = "other-side"\n')
    assert canonical() == ["cat1", "gorilla1", "wolf1"]
    dataset = tosca(tmp_path)
    assert {e.subject: dataset.camera(e).direction for e in dataset.entries} == {
        "cat": (-1, 0, 0),
        "gorilla": FRONT.direction,
        "wolf": SIDE.direction,
    }
    toml.write_text('canonical_pose = "0"')
    with pytest.raises(ConfigurationError, match="unknown pose of class 'wolf' .*; choose one of 1, 2"):
        tosca(tmp_path)


def test_one_tosca_shape_under_two_spellings_is_named(tmp_path):
    for name in ("cat0", "Cat0"):
        write_off(tmp_path / "tosca" / f"{name}.off", rod(0.1, 1.0))
    with pytest.raises(DatasetError, match="holds one shape as .*keep one of them"):
        tosca(tmp_path)


def test_a_vert_file_without_its_triangles_is_named(tmp_path):
    (tmp_path / "tosca").mkdir()
    np.savetxt(tmp_path / "tosca" / "dog0.vert", rod(0.1, 1.0).vertices)
    dataset = tosca(tmp_path)
    with pytest.raises(UnreadableMesh, match="dog0.tri: No such file"):
        dataset.load(dataset.entries[0])


def grid(rows, columns):
    """Open sheet of rows x columns vertices."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.sin(x.ravel() / 9.0)])
    return vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def test_meshes_of_full_resolution_are_read_in_every_layout(tmp_path):
    import scipy.io

    vertices, faces = grid(230, 229)  # 52 670 vertices, as the people of the official set
    folder = tmp_path / "tosca"
    folder.mkdir()
    x, y, z = vertices.T
    scipy.io.savemat(folder / "david0.mat", {"surface": {"X": x, "Y": y, "Z": z, "TRIV": (faces + 1).astype(float)}})
    np.savetxt(folder / "david1.vert", vertices)
    np.savetxt(folder / "david1.tri", faces + 1, fmt="%d")
    write_off(folder / "david2.off", Mesh(vertices, faces))
    dataset = tosca(tmp_path)
    for entry in dataset.entries:
        mesh = dataset.load(entry)
        np.testing.assert_array_equal(mesh.faces, faces)
        np.testing.assert_allclose(mesh.vertices, vertices, rtol=1e-15)


def test_a_gorilla_in_many_pieces_with_unused_vertices_is_usable(tmp_path):
    from benchmark.datasets.checking import check

    body = rod(0.2, 1.0)
    hair = rod(0.01, 0.0, 4, 3)
    pieces = [hair.with_vertices(hair.vertices + np.array([0, 0, 2 + k])) for k in range(37)]
    parts, faces, start = [np.full((5, 3), 0.5)], [], 5
    for piece in (body, *pieces):
        parts.append(piece.vertices)
        faces.append(piece.faces + start)
        start += piece.n_vertices
    write_off(tmp_path / "tosca" / "gorilla1.off", Mesh(np.concatenate(parts), np.concatenate(faces)))
    report = check(tosca(tmp_path))
    found = [str(anomaly) for anomaly in report.anomalies if "gorilla1.off" in str(anomaly)]
    assert [line.partition(";")[0] for line in found] == [
        "warning  gorilla1.off  4 duplicate vertices",
        "warning  gorilla1.off  1 vertex without a face",
        "warning  gorilla1.off  38 components",
    ]
