"""Meshes of other libraries go in, and forms come out for them."""

import io
from types import SimpleNamespace

import numpy as np
import pymeshlab
import pytest
import trimesh

import benchmark
from benchmark.commands.form import WRITTEN
from benchmark.commands.meshes import as_mesh
from benchmark.datasets.mesh_files import read_mesh
from benchmark.errors import ConfigurationError, InvalidMesh
from tests.geometry.surfaces import limbed_body
from tests.toy import rod, write_off
from tests.verbs import call, refusal

ROD = rod(0.1, 0.5)


def of_open3d():
    """What Open3D calls the arrays of a legacy mesh."""
    return SimpleNamespace(vertices=ROD.vertices.tolist(), triangles=ROD.faces.tolist())


def of_tensors():
    return SimpleNamespace(to_legacy=of_open3d)


@pytest.mark.parametrize(
    "given",
    [
        trimesh.Trimesh(ROD.vertices, ROD.faces, process=False),
        of_open3d(),
        of_tensors(),
        pymeshlab.Mesh(ROD.vertices, ROD.faces),
        (ROD.vertices, ROD.faces),
        (ROD.vertices.tolist(), ROD.faces.astype(np.uint64)),
        ROD,
    ],
    ids=["trimesh", "open3d", "tensors", "pymeshlab", "arrays", "lists", "mesh"],
)
def test_a_mesh_of_any_library_has_the_form_of_its_arrays(given):
    expected = benchmark.canonicalise(ROD.vertices, ROD.faces, "gps")
    np.testing.assert_array_equal(as_mesh(given).vertices, ROD.vertices)
    form = benchmark.canonicalise(given, method="gps")
    np.testing.assert_array_equal(form.vertices, expected.vertices)
    np.testing.assert_array_equal(form.faces, ROD.faces)


def test_a_path_is_a_mesh_and_names_its_form(tmp_path):
    write_off(tmp_path / "rod.off", ROD)
    form = benchmark.canonicalise(tmp_path / "rod.off", method="identity")
    assert form.title.startswith("rod, ")
    assert len(form.vertices) == ROD.n_vertices


def test_sheets_that_touch_in_a_vertex_part_in_the_form():
    """A ribbon is bent to a ring whose ends touch in one point; its form is straight."""
    along, across = 40, 5
    angles = np.linspace(0.1, 2 * np.pi - 0.1, along).repeat(across)
    heights = np.tile(np.linspace(-0.3, 0.3, across), along)
    vertices = np.stack([np.cos(angles), np.sin(angles), heights], axis=1)
    vertices[[across // 2, -(across // 2) - 1]] = [1, 0, 0]
    corners = np.arange(along * across).reshape(along, across)
    a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
    halves = [np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]
    faces = np.concatenate(halves).reshape(-1, 3)
    form = benchmark.canonicalise(vertices, faces, "classic-mds")
    ends = form.vertices[form.faces]
    lengths = np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)
    assert lengths.max() < np.ptp(form.vertices, axis=0).max() / 5
    np.testing.assert_allclose(np.ptp(vertices[form.vertex_map], axis=0), np.ptp(vertices, axis=0))


@pytest.mark.parametrize("what", ["vertices", "faces"])
def test_masked_values_of_a_mesh_are_no_values(what):
    arrays = {"vertices": ROD.vertices, "faces": ROD.faces}
    arrays[what] = np.ma.masked_array(arrays[what], arrays[what] == arrays[what][1, 1])
    for given in (tuple(arrays.values()), SimpleNamespace(**arrays)):
        with pytest.raises(InvalidMesh, match=what):
            benchmark.canonicalise(given, method="identity")
    with pytest.raises(InvalidMesh, match=what):
        benchmark.canonicalise(*arrays.values(), method="identity")


@pytest.mark.parametrize(
    "given",
    [trimesh.PointCloud(ROD.vertices), trimesh.Scene(), object(), {}, 3],
    ids=lambda given: type(given).__name__,
)
def test_what_is_no_triangle_mesh_is_named_with_what_is_taken(given):
    with pytest.raises(InvalidMesh, match=r"no triangle mesh; pass a trimesh\.Trimesh, an Open3D"):
        benchmark.canonicalise(given)


@pytest.mark.parametrize("n_vertices", [3, 0, -1, 100.0, True, "100", None])
def test_the_number_of_vertices_of_a_surface_is_whole_and_enough(n_vertices):
    with pytest.raises(ConfigurationError, match=r"n_vertices=.*; pass a whole number of at le"):
        benchmark.canonicalise(ROD, method="identity", n_vertices=n_vertices)
    few = benchmark.canonicalise(ROD, method="identity", n_vertices=np.int64(20))
    assert len(few.vertices) <= 20


def test_a_method_in_the_place_of_the_faces_is_named():
    with pytest.raises(ConfigurationError, match="name the method: method="):
        benchmark.canonicalise(ROD, "gps")


def test_a_form_for_trimesh_has_its_vertices_in_order_and_parts_of_one_colour():
    form = benchmark.canonicalise(ROD, method="identity")
    taken = form.to_trimesh()
    np.testing.assert_array_equal(taken.vertices, form.vertices)
    np.testing.assert_array_equal(taken.faces, form.faces)
    bent = benchmark.canonicalise(rod(0.1, 1.0), method="identity")
    near = np.abs(bent.colours().astype(int) - taken.visual.vertex_colors.astype(int))
    assert near.mean() < 12  # parts have their colours in every pose
    assert np.ptp(taken.visual.vertex_colors[:, :3].astype(int), axis=0).max() > 100


@pytest.mark.parametrize(
    ("suffix", "largest"), [(".off", 0.0), (".obj", 0.0), (".ply", 0.0), (".glb", 1e-7)]
)
def test_a_written_form_is_read_back_by_others_with_its_vertices_in_order(
    tmp_path, suffix, largest
):
    form = benchmark.canonicalise(ROD, method="gps")
    form.write(tmp_path / f"form{suffix}")
    by_trimesh = trimesh.load(tmp_path / f"form{suffix}", process=False, force="mesh")
    by_meshlab = pymeshlab.MeshSet()
    by_meshlab.load_new_mesh(str(tmp_path / f"form{suffix}"))
    for vertices, faces in (
        (by_trimesh.vertices, by_trimesh.faces),
        (by_meshlab.current_mesh().vertex_matrix(), by_meshlab.current_mesh().face_matrix()),
        (
            read_mesh(tmp_path / f"form{suffix}").vertices,
            read_mesh(tmp_path / f"form{suffix}").faces,
        ),
    ):
        np.testing.assert_array_equal(faces, form.faces)
        assert np.abs(vertices - form.vertices).max() <= max(largest, 1e-7)
    exact = read_mesh(tmp_path / f"form{suffix}").vertices
    assert np.abs(exact - form.vertices).max() <= largest


def test_an_stl_has_the_same_triangles_and_says_that_it_numbers_no_vertices(tmp_path):
    write_off(tmp_path / "body.off", limbed_body(4))
    words = ("canonicalise", "-m", "identity", tmp_path / "body.off", "-o")
    said = call(*words, tmp_path / "form.stl").replace("\n", " ")
    assert "STL repeats the corners of triangles: it has no numbers of vertices" in said
    assert not (tmp_path / "form.vertices.txt").exists()
    call(*words, tmp_path / "form.off")
    corners = trimesh.load(tmp_path / "form.stl", process=False, force="mesh").triangles
    expected = read_mesh(tmp_path / "form.off")
    np.testing.assert_allclose(corners, expected.vertices[expected.faces], atol=1e-6)


def test_a_glb_says_its_precision_and_has_colours_and_other_names_are_refused(tmp_path):
    write_off(tmp_path / "rod.off", ROD)
    words = ("canonicalise", "-m", "identity", tmp_path / "rod.off", "-o")
    assert "GLB has coordinates in single precision" in call(*words, tmp_path / "form.glb")
    found = trimesh.load(tmp_path / "form.glb", process=False, force="mesh")
    assert np.ptp(found.visual.vertex_colors[:, :3].astype(int), axis=0).max() > 100
    assert f"use {', '.join(WRITTEN)}" in refusal(*words, tmp_path / "form.fbx")


def test_a_notebook_shows_a_form_in_3d_without_a_network():
    form = benchmark.canonicalise(ROD, method="identity")
    shown = form._repr_html_()
    assert "http" not in shown.replace("http://www.w3.org", "")
    assert "SURFACE = " in shown
    assert len(shown) < 150_000
    assert trimesh.util.wrap_as_stream(form._repr_png_()).read(4) == b"\x89PNG"
    beside = benchmark.side_by_side(form, form)._repr_html_()
    assert beside.count("<iframe") == 2


def test_a_title_is_text_in_a_notebook():
    form = benchmark.canonicalise(ROD, method="identity")
    object.__setattr__(form, "title", "<script>alert(1)</script>")
    assert "<script>alert" not in form._repr_html_()
    assert io.StringIO(form._repr_html_()).read().count("<figcaption>") == 1
