import numpy as np
import pytest

from benchmark.datasets.canonical import canonical_entry
from benchmark.datasets.shrec14 import SIZES, shrec14
from benchmark.datasets.tosca import CLASS_SIZES, tosca
from benchmark.errors import ConfigurationError, DatasetError, UnreadableMesh
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.mesh import Mesh
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
    assert counts == CLASS_SIZES
    assert sum(counts.values()) == 80


def empty_shrec14(tmp_path, part, numbers=None, suffix=".obj"):
    folder = tmp_path / "shrec14" / part
    folder.mkdir(parents=True)
    for number in range(SIZES[part][1]) if numbers is None else numbers:
        (folder / f"{number}{suffix}").write_text("")
    return folder


def classification(part, first=0, names=str):
    poses, count = SIZES[part]
    blocks = [
        f"\n{names(subject)} 0 {poses}\n" + "".join(f"{first + poses * subject + pose}\n" for pose in range(poses))
        for subject in range(count // poses)
    ]
    return f"PSB 1\n{count // poses} {count}\n" + "".join(blocks)


@pytest.mark.parametrize(("part", "n_subjects"), [("synthetic", 15), ("real", 40)])
@pytest.mark.parametrize("suffix", [".obj", ".off"])
def test_shrec14_agrees_with_its_cla_file(tmp_path, part, n_subjects, suffix):
    folder = empty_shrec14(tmp_path, part, suffix=suffix)
    alone = shrec14(tmp_path, part)
    (folder / "test.cla").write_text(classification(part, names=lambda subject: f"person{subject}"))
    dataset = shrec14(tmp_path, part)
    assert dataset.entries == alone.entries
    assert len({entry.subject for entry in dataset.entries}) == n_subjects
    assert [entry.path.name for entry in dataset.entries[9:11]] == [f"9{suffix}", f"10{suffix}"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: classification("synthetic", first=1), "numbers the models from 1 to 300; subtract 1"),
        (lambda text: text.replace("\n299\n", "\n300\n"), "does not list models 0 to 299; fetch the official"),
        (
            lambda text: text.replace("\n19\n", "\nX\n").replace("\n20\n", "\n19\n").replace("\nX\n", "\n20\n"),
            "puts model 19 into class '1', which begins with model 19, but models 0 to 19 are one subject",
        ),
        (lambda text: text.replace("PSB 1", "PSB"), "does not start with 'PSB 1'"),
        (lambda text: text.replace("15 300", "14 300"), "announces 14 classes and 300 models but lists 15 and 300"),
    ],
)
def test_a_cla_file_that_contradicts_the_numbers_is_named(tmp_path, change, message):
    folder = empty_shrec14(tmp_path, "synthetic")
    (folder / "test.cla").write_text(change(classification("synthetic")))
    with pytest.raises(DatasetError, match=f"test.cla .*{message}"):
        shrec14(tmp_path, "synthetic")


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        (range(1, 301), "number 0 is missing; the files are numbered from 1: subtract 1 from each"),
        (range(301), "holds 301 numbered meshes, not 0 to 299, number 300 is one too many; unpack"),
        ([*range(300), "007"], "holds number 7 as (7|007).obj and (7|007).obj; keep one"),
        ([*range(299), "x299"], "holds 299 numbered meshes, not 0 to 299, number 299 is missing"),
    ],
)
def test_wrongly_numbered_meshes_are_named(tmp_path, numbers, message):
    empty_shrec14(tmp_path, "synthetic", numbers)
    with pytest.raises(DatasetError, match=message):
        shrec14(tmp_path, "synthetic")


def test_shrec14_takes_the_canonical_pose_and_the_camera_from_its_folder(tmp_path):
    folder = empty_shrec14(tmp_path, "real")
    assert canonical_entry(shrec14(tmp_path, "real"), "3").identifier == "30"
    (folder / "dataset.toml").write_text('canonical_pose = 4\ncamera = "side"\n')
    dataset = shrec14(tmp_path, "real")
    assert canonical_entry(dataset, "3").identifier == "34"
    assert dataset.camera(dataset.entries[0]) == SIDE


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
