import re
import time

import igl
import numpy as np
import pytest
from typer.testing import CliRunner

from benchmark.cli.main import data
from benchmark.datasets.checking import check, check_source, count_holes
from benchmark.datasets.folder import folder_set
from benchmark.geometry.io import read_mesh, write_mesh
from benchmark.geometry.mesh import Mesh
from tests.toy import rod, write_off, write_rods

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
        faces = np.delete(ROD.faces, random.choice(ROD.n_faces, 6, replace=False), axis=0).astype(np.int64)
        loops = igl.boundary_loop_all(faces)
        if min(map(len, loops)) >= 3:  # holes that touch in a vertex are cut up differently
            assert count_holes(faces) == len(loops)
            compared += 1
    assert compared > 20


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([], [[0, 0, 1]], "1 degenerate faces; "),
        ([[9.0, 9, 9]], [], "1 vertices without a face; "),
        ([], [ROD.faces[0]], "1 duplicate faces; "),
        ([ROD.vertices[0]], [], "1 duplicate vertices; nothing to do: preparation merges"),
        ([[0.0, 0, 9], [0, 1, 9], [1, 0, 9]], [[290, 291, 292]], "1 components beside the first; join them"),
        ([[0.0, 0, 9]], [[0, 1, 290]], "1 non-manifold edges; remove faces"),
        ([[0.0, 0, 9]], [[0, 1, 290]], "2 boundary edges; close the surface"),
        ([[0.0, 0, 9], [0, 1, 9]], [[0, 290, 291]], "1 non-manifold vertices; split each"),
    ],
)
def test_flaws_of_a_mesh_are_warnings(rods, vertices, faces, message):
    flawed = Mesh(
        np.vstack([ROD.vertices, *map(np.atleast_2d, vertices)]), np.vstack([ROD.faces, *map(np.atleast_2d, faces)])
    )
    write_off(rods / "thick2.off", flawed)
    assert any(line.startswith(f"warning  thick2.off  {message}") for line in lines(rods))
    assert check(folder_set(rods)).usable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", "1 of 3 vertices are NaN or infinite; "),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n", "no face has an area; export the mesh again"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_an_error(rods, text, message):
    (rods / "thin0.off").write_text(text)
    report = check_source(str(rods), None)
    assert not report.usable
    assert any(str(anomaly).startswith(f"error    thin0.off  {message}") for anomaly in report.anomalies)


def test_the_same_geometry_under_two_names_is_named_whatever_the_format(rods):
    write_mesh(rods / "thick7.obj", read_mesh(rods / "thin1.off"))
    assert only(rods) == (
        "error    thin1.off  the same geometry as thick7.obj of another class, 'thick'; keep one of the two"
    )
    write_mesh(rods / "thin7.obj", read_mesh(rods / "thin0.off"))
    (rods / "thick7.obj").unlink()
    assert only(rods) == "warning  thin7.obj  the same geometry as thin0.off; keep one of the two"


def test_what_cannot_be_read_is_a_shape_and_lowers_coverage(rods):
    (rods / "thin7.vtk").write_text("# vtk DataFile")
    (rods / "thin8.xyz").write_text("0 0 0")
    (rods / "thick0.off").write_text("OFF")
    report = check(folder_set(rods))
    assert (len(report.dataset.shapes), len(report.rows)) == (7, 5)
    assert report.lines()[0] == "rods: 7 shapes, 2 classes, not a stand-in, 2 unreadable, which count as 0"
    skipped, broken, unknown = lines(rods)
    assert skipped.startswith("warning  thin8.xyz  is skipped: it holds points, not a surface; convert it to")
    assert broken.startswith("error    thick0.off  ")
    assert unknown.startswith("error    thin7.vtk  unknown extension '.vtk'; convert it to one of .off,")
    assert [(row.file, row.subject, row.counts["vertices_before"], row.counts["holes"]) for row in report.rows][:2] == [
        ("thick1.off", "thick", 290, 0), ("thick2.off", "thick", 290, 0)
    ]  # fmt: skip


def test_meshes_that_are_passed_over_are_named(rods):
    write_off(rods / "more" / "extra0.off", rod(0.3, 1.0))
    assert only(rods).startswith("warning  more/extra0.off  is none of the shapes of this data set; ")


def test_what_keeps_a_folder_from_being_opened_is_an_error_and_the_meshes_are_read_all_the_same(rods):
    (rods / "x.cla").write_text("PSB 2\n")
    (rods / "thin0.off").write_text("")
    first, second = lines(rods)
    assert re.match("error    rods  .* does not start with 'PSB 1'", first)
    assert second.startswith("error    thin0.off  the file is empty")


def test_an_incomplete_official_set_is_an_error(tmp_path):
    for number in range(4):
        write_off(tmp_path / "tosca" / f"{'cat' if number % 2 else 'dog'}{number}.off", rod(0.1, number))
    anomalies = [str(anomaly) for anomaly in check_source("tosca", tmp_path).anomalies]
    assert anomalies[0].startswith("error    tosca  class 'cat' has 2 shapes, officially 11; unpack")
    assert len(anomalies) == 9
    # The hint that it names helps: the same folder by its path is a set of its own.
    assert f"name the folder, -d {tmp_path / 'tosca'}," in anomalies[0]
    assert lines(tmp_path / "tosca") == []


def test_a_frame_that_is_too_small_is_an_error(rods):
    (rods / "dataset.toml").write_text("half_width = 0.3\n")
    assert only(rods).startswith("error    thick1.off  extends to 0.567563, beyond")
    assert "set half_width = 0.630626" in only(rods)


@pytest.mark.parametrize(
    ("scales", "message"),
    [
        ([1e-5], "extends to .*, almost nothing in a frame"),
        ([1.0, 1e5], "extends to .*, out of scale with the others"),  # a stray vertex
    ],
)
def test_a_shape_out_of_scale_is_named(rods, scales, message):
    write_off(rods / "thin1.off", ROD.with_vertices(ROD.vertices * np.resize(scales, 290)[:, None]))
    assert re.match(f"warning  thin1.off  {message}", only(rods))


def test_warnings_alone_are_no_failure_of_the_verb(rods):
    (rods / "thin1.obj").write_text("")
    warned = CliRunner().invoke(data, ["check", str(rods)])
    assert (warned.exit_code, warned.output.splitlines()[-1]) == (0, "0 errors, 1 warning")


@pytest.mark.data
def test_tosca_is_whole_but_for_one_open_mesh(data_root):
    start = time.process_time()
    done = CliRunner().invoke(data, ["check", "tosca", "--data-root", str(data_root)])
    assert time.process_time() - start < 10
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[0] == "tosca: 80 shapes, 9 classes, not a stand-in"
    assert [line for line in lines if line.startswith(("error", "warning"))] == [
        "warning  victoria10.off  20 boundary edges; close the surface for methods that need it closed"
    ]
