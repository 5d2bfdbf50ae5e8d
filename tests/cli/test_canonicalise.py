"""The form of one mesh as a file: whole, or not there."""

import numpy as np
import pytest
from PIL import Image

from benchmark.cli.forms import form_of_mesh
from benchmark.cli.options import Selection
from benchmark.errors import ConfigurationError
from benchmark.geometry.io import read_mesh
from benchmark.geometry.mesh import Mesh
from tests.geometry.surfaces import flipped, joined, limbed_body, soup, sphere
from tests.toy import rod, write_off
from tests.verbs import call


def canonicalise(*arguments, code=0):
    return call("canonicalise", "-m", "identity", *arguments, code=code)


def test_a_small_mesh_keeps_its_numbering_and_joined_pieces_are_told(tmp_path):
    ball = rod(0.1, 0.5)
    order = np.random.default_rng(0).permutation(len(ball.vertices))
    mixed = Mesh(ball.vertices[order], np.argsort(order)[ball.faces])
    write_off(tmp_path / "rod.off", mixed)
    canonicalise(tmp_path / "rod.off", "-o", tmp_path / "form.off")
    form = read_mesh(tmp_path / "form.off")
    np.testing.assert_array_equal(form.faces, mixed.faces)
    scale = np.sqrt(form.area / mixed.area)
    np.testing.assert_allclose(form.vertices, scale * (mixed.vertices - mixed.vertices.mean(axis=0)), atol=1e-5)
    pair = joined(sphere(2), sphere(2).with_vertices(sphere(2).vertices + np.array([6, 0, 0])))
    write_off(tmp_path / "pair.off", pair)
    assert "joined_pieces 2, largest_gap 4" in canonicalise(tmp_path / "pair.off", "-o", tmp_path / "joined.off")


def test_a_decimated_form_has_a_file_of_the_nearest_vertices(tmp_path):
    body = limbed_body(4)
    write_off(tmp_path / "body.off", body)
    said = canonicalise(tmp_path / "body.off", "-o", tmp_path / "form.off")
    assert f"the nearest of the file, counted from 0, in {tmp_path / 'form.vertices.txt'}" in said.replace("\n", " ")
    numbers = np.loadtxt(tmp_path / "form.vertices.txt", dtype=int)
    moved = (body.vertices - body.vertices.mean(axis=0)) / body.area**0.5
    assert np.abs(read_mesh(tmp_path / "form.off").vertices - moved[numbers]).max() < 0.1
    canonicalise(tmp_path / "body.off", "-o", tmp_path / "all.off", "--all-vertices")
    assert not (tmp_path / "all.vertices.txt").exists()


@pytest.mark.parametrize("subdivisions", [3, 4])
def test_copies_and_turned_faces_change_no_vertex_of_a_form(tmp_path, subdivisions):
    """Of a mesh that keeps its vertices, and of one that is decimated; two faces of a sheet lie close together."""
    body = limbed_body(subdivisions)
    body = body.with_vertices(body.vertices * [1, 1, 0.02])
    write_off(tmp_path / "body.off", body)
    write_off(tmp_path / "soup.off", soup(flipped(body, 0.5)))
    for name in ("body", "soup"):
        canonicalise(tmp_path / f"{name}.off", "-o", tmp_path / f"{name}-form.off", "--all-vertices")
    whole, scattered = (read_mesh(tmp_path / f"{name}-form.off") for name in ("body", "soup"))
    corners = [np.sort(mesh.vertices[mesh.faces], axis=1) for mesh in (whole, scattered)]
    np.testing.assert_allclose(corners[0], corners[1], atol=1e-6)


def test_a_form_is_never_written_over_its_mesh(tmp_path, monkeypatch):
    write_off(tmp_path / "data" / "rod.off", rod(0.1, 0.5))
    (tmp_path / "link.off").symlink_to(tmp_path / "data" / "rod.off")
    before = (tmp_path / "data" / "rod.off").read_bytes()
    monkeypatch.chdir(tmp_path / "data")
    for mesh, output in (("rod.off", "../link.off"), ("../link.off", "rod.off"), ("rod.off", "rod.off")):
        assert "is the mesh itself; name another file with -o" in canonicalise(mesh, "-o", output, code=2)
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["rod.off"]
    assert (tmp_path / "data" / "rod.off").read_bytes() == before


def test_a_picture_shows_a_mesh_and_its_form(tmp_path):
    write_off(tmp_path / "rod.off", rod(0.1, 0.5))
    words = (tmp_path / "rod.off", "-o", tmp_path / "form.off", "--picture")
    canonicalise(*words, tmp_path / "shape.png")
    with Image.open(tmp_path / "shape.png") as picture:
        left, right = (np.asarray(picture.convert("L"))[:, half] for half in (slice(None, 300), slice(-300, None)))
    assert min((left < 200).mean(), (right < 200).mean()) > 0.02


SHEARED = """
from benchmark.api.contracts import canonical_form

@canonical_form(name="sheared", title="Sheared")
def sheared(shape):
    return shape.mesh.vertices @ [[1.0, 0.3, 0.0], [0.0, 2.0, -0.4], [0.1, 0.0, 0.5]]
"""


def test_all_vertices_of_the_file_get_their_place_in_the_form_in_their_order(tmp_path):
    (tmp_path / "sheared.py").write_text(SHEARED)
    mesh = sphere(5)
    write_off(tmp_path / "in.off", mesh)
    options = Selection(plugins=[tmp_path / "sheared.py"])
    form = form_of_mesh(tmp_path / "in.off", "sheared", options, all_vertices=True)
    assert len(form.vertices) == mesh.n_vertices == 10242
    np.testing.assert_array_equal(form.faces, mesh.faces)
    unit = (mesh.vertices - mesh.vertices.mean(axis=0)) / mesh.area**0.5
    expected = unit @ [[1.0, 0.3, 0.0], [0.0, 2.0, -0.4], [0.1, 0.0, 0.5]]
    farthest = form.notes["farthest_from_prepared"]
    assert np.abs(form.vertices - expected).max() < 3 * farthest + 0.002
    assert 0 < farthest < 0.005
    own = SHEARED.replace("return shape", "return CanonicalForm(shape.mesh.vertices[:3], [[0, 1, 2]])  # ")
    (tmp_path / "sheared.py").write_text(own.replace("import canonical", "import CanonicalForm, canonical"))
    with pytest.raises(ConfigurationError, match="vertices of their own; omit --all-vertices"):
        form_of_mesh(tmp_path / "in.off", "sheared", options, all_vertices=True)
