import json
import re
from pathlib import Path

import igl
import numpy as np
import pytest

from benchmark.datasets.checking import check_dataset, check_source, unreadable_files
from benchmark.datasets.folder import folder_set
from benchmark.datasets.mesh_files import read_mesh, write_mesh
from benchmark.geometry.cleaning import count_holes
from benchmark.geometry.mesh import Mesh, edges_of
from tests.toy import rod, write_off, write_rods
from tests.verbs import call

ROD = rod(0.1, 1.0)


def lines(folder):
    return [str(anomaly) for anomaly in check_source(str(folder), None).anomalies]


def only(folder):
    (line,) = lines(folder)
    return line


@pytest.fixture
def rods(tmp_path):
    return write_rods(tmp_path / "rods")


def test_the_number_of_holes_agrees_with_libigl():
    random = np.random.default_rng(0)
    compared = 0
    for _ in range(40):
        faces = np.delete(ROD.faces, random.choice(ROD.n_faces, 6, replace=False), axis=0).astype(
            np.int64
        )
        loops = igl.boundary_loop_all(faces)
        if min(map(len, loops)) >= 3:  # holes that touch in a vertex are cut up differently
            assert count_holes(edges_of(faces).boundary) == len(loops)
            compared += 1
    assert compared > 20


APART = [[0.0, 0, 9], [0, 1, 9], [1, 0, 9]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([], [[0, 0, 1]], "1 face without area; preparation removes them"),
        ([[9.0, 9, 9]], [], "1 vertex without a face; preparation drops"),
        ([], [ROD.faces[0], ROD.faces[1]], "2 duplicate faces; preparation keeps one"),
        ([ROD.vertices[0] + 1e-6], [[0, 290, 290]], "1 copy of a vertex; preparation merges"),
        (
            [*APART, [1, 1, 9]],
            [[290, 291, 292], [291, 293, 292]],
            "1 bridge between pieces; preparation adds",
        ),
        (
            [*APART, [1, 1, 9]],
            [[290, 291, 292], [291, 293, 292]],
            "bridges of length up to 8.46; join the pieces",
        ),
        (0.01 * np.array(APART), [[290, 291, 292]], "1 small piece; preparation drops"),
        (0.01 * np.array(APART), [[290, 291, 292]], "0.01% of the area; preparation drops"),
        ([[0.0, 0, 0.5]], [[0, 1, 290]], "1 non-manifold edge; preparation keeps the two largest"),
        ([[0.0, 0, 9]], [[0, 1, 290]], "2 boundary edges; close the surface"),
        (
            [[0.0, 0, 0.5], [0, 0.1, 0.5]],
            [[0, 290, 291]],
            "1 non-manifold vertex; preparation splits",
        ),
    ],
)
def test_flaws_of_a_mesh_are_warnings(rods, vertices, faces, message):
    flawed = Mesh(
        np.vstack([ROD.vertices, *map(np.atleast_2d, vertices)]),
        np.vstack([ROD.faces, *map(np.atleast_2d, faces)]),
    )
    write_off(rods / "thick2.off", flawed)
    assert any(re.match(f"warning  thick2.off  {message}", line) for line in lines(rods))
    assert check_dataset(folder_set(rods)).usable


def test_the_same_geometry_under_two_names_is_named_whatever_the_format(rods):
    write_mesh(rods / "thick7.obj", read_mesh(rods / "thin1.off"))
    assert only(rods) == (
        "error    thin1.off (thick7.obj)  the same geometry as another of another class; "
        "keep one of the two"
    )
    write_mesh(rods / "thin7.obj", read_mesh(rods / "thin0.off"))
    (rods / "thick7.obj").unlink()
    assert (
        only(rods)
        == "warning  thin7.obj (thin0.off)  the same geometry as another; keep one of the two"
    )


def test_what_cannot_be_read_is_a_shape_and_lowers_coverage(rods):
    (rods / "thin7.vtk").write_text("# vtk DataFile")
    (rods / "thin8.xyz").write_text("0 0 0")
    (rods / "thick0.off").write_text("OFF")
    report = check_dataset(folder_set(rods))
    assert (len(report.dataset.shapes), len(report.shapes)) == (7, 5)
    assert (
        report.lines()[0]
        == "rods: 7 shapes, 2 classes, not a stand-in, 2 unreadable, which count as 0"
    )
    broken, unknown, skipped = lines(rods)
    assert skipped.startswith(
        "warning  thin8.xyz  skipped: points, not a surface; make a surface of them: python -c"
    )
    assert broken.startswith("error    thick0.off  ")
    assert unknown.startswith(
        "error    thin7.vtk  unknown extension '.vtk'; convert it to one of .off,"
    )
    assert [
        (row.file, row.subject, row.counts["vertices_before"], row.counts["holes"])
        for row in report.shapes
    ][:2] == [("thick1.off", "thick", 290, 0), ("thick2.off", "thick", 290, 0)]


def test_meshes_that_are_passed_over_are_named(rods, in_this_process):
    write_off(rods / "more" / "extra0.off", rod(0.3, 1.0))
    assert only(rods).startswith("warning  more/extra0.off  none of the shapes of this data set; ")
    said = call(
        "run", "-d", rods, "-m", "surface-area", "--results", rods.parent / "results", "-j", 0
    )
    assert f"{rods}: {only(rods)}" in said


def test_a_class_whose_meshes_lie_one_folder_too_deep_is_named(tmp_path):
    names = ("cat/1", "cat/2", "cow/1", "cow/2", "dog/train/1", "dog/train/2")
    for number, name in enumerate(names, 1):
        write_off(tmp_path / "set" / f"{name}.off", rod(0.1, number / 10))
    assert only(tmp_path / "set").startswith(
        "warning  2 files: dog/train/1.off, dog/train/2.off  none of the shapes of this data set;"
    )


def test_classes_whose_names_differ_in_spelling_alone_are_named(tmp_path):
    names = ("cat1", "Cat2", "big dog1", "big-dog2", "cat3", "cow1", "crow1")
    for number, name in enumerate(names, 1):
        write_off(tmp_path / "set" / f"{name}.off", rod(0.1, number / 10))
    said = [line for line in lines(tmp_path / "set") if "spelling" in line]
    assert said == [
        "warning  set  classes that differ in spelling alone count as two: "
        "'big dog' and 'big-dog', 'Cat' and 'cat'; give each class one name"
    ]


def test_lists_and_settings_that_are_not_read_are_named(rods):
    for name in ("Dataset.toml", "dataset.toml.txt", "class.tsv", "thin9.zip"):
        (rods / name).write_text("unit = 'mm'\n")
    (rods / "dataset.toml").write_text("unit = 'm'\n")
    for name in ("thin0.mtl", "skin.png", "K.txt", "README.md"):
        (rods / name).write_text("")
    assert only(rods) == (
        "warning  4 files: Dataset.toml, class.tsv, dataset.toml.txt, thin9.zip  "
        "skipped: no shape, labels or "
        f"settings; labels.txt and dataset.toml are read, in {rods.name}"
    )


def test_what_keeps_a_folder_from_being_opened_is_an_error_and_the_meshes_are_read_all_the_same(
    rods,
):
    (rods / "x.cla").write_text("PSB 2\n")
    (rods / "thin0.off").write_text("")
    first, second = lines(rods)
    assert re.match("error    rods  .* does not start with 'PSB 1'", first)
    assert second.startswith("error    thin0.off  the file is empty")


def test_an_incomplete_official_set_is_an_error(tmp_path):
    for number in range(4):
        write_off(
            tmp_path / "tosca" / f"{'cat' if number % 2 else 'dog'}{number}.off", rod(0.1, number)
        )
    anomalies = [str(anomaly) for anomaly in check_source("tosca", tmp_path).anomalies]
    assert anomalies[0].startswith(
        "error    tosca  class 'cat' has 2 shapes, officially 11; unpack"
    )
    # Nine classes are not whole, and no copy of the set has these files.
    assert len(anomalies) == 10
    # The hint that it names helps: the same folder by its path is a set of its own.
    assert f"name the folder, -d {tmp_path / 'tosca'}," in anomalies[0]
    assert lines(tmp_path / "tosca") == []


def test_a_frame_that_is_too_small_is_an_error(rods):
    (rods / "dataset.toml").write_text("half_width = 0.3\n")
    assert only(rods).startswith("error    thick1.off  extends to 0.567563, beyond")
    assert "set half_width = 0.630626" in only(rods)


def scaled(folder, name, scale):
    write_off(
        folder / name, (mesh := read_mesh(folder / name)).with_vertices(mesh.vertices * scale)
    )


def test_a_shape_out_of_scale_and_a_stray_vertex_are_named(rods):
    scaled(rods, "thin1.off", 1e-5)
    assert re.match("warning  thin1.off  extends to .*, almost nothing in a frame", only(rods))
    stray = ROD.vertices.copy()
    stray[7] *= 1e6
    write_off(rods / "thin1.off", ROD.with_vertices(stray))
    assert (
        only(rods)
        == "error    thin1.off  1 vertex beyond 100 radii of the shape; remove stray vertices"
    )


@pytest.mark.parametrize("factor", [2.54, 10, 12, 25.4, 100, 304.8, 1000])
def test_a_shape_in_another_unit_is_named(rods, factor):
    scaled(rods, "thin1.off", 1 / factor)
    assert (
        f"warning  thin1.off  is {factor:g} times as small as 5 others (thick0.off, "
        in "\n".join(lines(rods))
    )
    scaled(rods, "thin1.off", factor**2)
    found = [line for line in lines(rods) if "a unit's factor" in line]
    assert len(found) == 1
    assert re.match(f"warning  thin1.off  is {factor:g} times as large as 5 others", found[0])
    scaled(rods, "thin1.off", 1.5 / factor)
    assert "a unit's factor" not in "".join(lines(rods))


def test_warnings_alone_are_no_failure_of_the_verb(rods):
    (rods / "thin1.obj").write_text("")
    assert call("data", "check", rods).splitlines()[-1] == "0 errors, 1 warning"


def write_mixed(folder):
    """Write rods of two classes, the first half of each in metres and the rest in millimetres."""
    for number in range(12):
        mesh = rod(0.1 if number % 2 else 0.2, number / 9)
        name = f"{'thin' if number % 2 else 'thick'}{number}.off"
        write_off(folder / name, mesh.with_vertices(mesh.vertices * (1000 if number > 5 else 1)))


def test_a_mixed_folder_takes_a_line_for_each_kind_of_problem_and_errors_come_first(tmp_path):
    write_mixed(tmp_path)
    for number in range(20, 23):
        (tmp_path / f"._thin{number}.off").write_text("")
        (tmp_path / f"thin{number}.off").write_text("OFF\n3 1 0\n")
    broken, hidden, units = lines(tmp_path)[:3]
    assert broken.startswith(
        "error    3 files: thin20.off, thin21.off, thin22.off  not a readable off file: 3 vertices"
    )
    assert hidden.startswith(
        "warning  3 files: ._thin20.off, ._thin21.off, ._thin22.off  skipped: hidden; remove"
    )
    metres, millimetres = (
        "thick0.off, thick2.off, thick4.off, 3 more",
        "thick6.off, thick8.off, thick10.off, 3 more",
    )
    assert units == (
        f"warning  6 files: {metres}  are 1000 times as small as 6 others ({millimetres}), "
        "a unit's factor; "
        "state the unit of each in dataset.toml, or ignore surface-area"
    )


METRES = [f"thick{number}" for number in (0, 2, 4)] + [f"thin{number}" for number in (1, 3, 5)]


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ('normalise = "area"', 1.0),
        (
            "[unit]\n"
            + "\n".join(["thick = 'mm'", "thin = 0.001", *(f"{name} = 'm'" for name in METRES)]),
            None,
        ),
    ],
)
def test_units_or_areas_bring_the_shapes_of_a_mixed_folder_to_one_size(tmp_path, text, size):
    write_mixed(tmp_path)
    before = folder_set(tmp_path)
    keys = [before.key(entry) for entry in before.shapes]
    (tmp_path / "dataset.toml").write_text(text)
    assert lines(tmp_path) == []
    after = folder_set(tmp_path)
    areas = {entry.identifier: after.load(entry).area for entry in after.shapes}
    assert areas["thick0"] == pytest.approx(size or read_mesh(tmp_path / "thick0.off").area)
    assert areas["thick6"] == pytest.approx(size or 1e-6 * read_mesh(tmp_path / "thick6.off").area)
    assert not {after.key(entry) for entry in after.shapes} & {*keys}


@pytest.mark.slow
@pytest.mark.data
def test_tosca_is_whole_but_for_one_open_mesh(data_root):
    lines = call("data", "check", "tosca", "--data-root", data_root).splitlines()
    assert (
        "tosca: 80 shapes, 9 classes, TOSCA, re-meshed to 5 000 vertices (SHA-256 of all 80 files)"
        in lines
    )
    assert [line for line in lines if line.startswith(("error", "warning"))] == [
        "warning  victoria10.off  20 boundary edges; "
        "close the surface for methods that need it closed"
    ]


def test_files_that_lie_elsewhere_are_named_as_seen_from_the_folder(rods, tmp_path, monkeypatch):
    buffer = {"byteLength": 4, "uri": f"{tmp_path}/absent.bin"}
    tree = {"asset": {"version": "2.0"}, "buffers": [buffer]}
    (rods / "thick9.gltf").write_text(json.dumps(tree))
    (unread,) = unreadable_files(folder_set(rods))
    assert unread.files == ("../absent.bin",)
    (tmp_path / "frames").mkdir()
    np.save(tmp_path / "frames" / "one0.npy", np.ones((4, 4)))
    (tmp_path / "frames" / "one0_mask.png").symlink_to("nowhere")
    (tmp_path / "camera.json").symlink_to("nowhere")
    monkeypatch.chdir(tmp_path)
    names = [anomaly.files for anomaly in unreadable_files(folder_set(Path("frames")))]
    assert names == [("one0_mask.png",), ("../camera.json",)]
