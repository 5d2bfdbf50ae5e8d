"""The form of one mesh as a file: whole, or not there."""

import numpy as np
import pytest
from PIL import Image

from benchmark.commands.canonicalise import form_of_file
from benchmark.datasets.mesh_files import read_mesh
from benchmark.geometry.mesh import Mesh
from tests.geometry.surfaces import joined, limbed_body, sphere
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
    np.testing.assert_allclose(
        form.vertices, scale * (mixed.vertices - mixed.vertices.mean(axis=0)), atol=1e-5
    )
    pair = joined(sphere(2), sphere(2).with_vertices(sphere(2).vertices + np.array([6, 0, 0])))
    write_off(tmp_path / "pair.off", pair)
    assert "joined_pieces 2, largest_gap 4" in canonicalise(
        tmp_path / "pair.off", "-o", tmp_path / "joined.off"
    )


def test_a_decimated_form_has_a_file_of_the_nearest_vertices(tmp_path):
    body = limbed_body(4)
    write_off(tmp_path / "body.off", body)
    said = canonicalise(tmp_path / "body.off", "-o", tmp_path / "form.off")
    assert (
        f"{tmp_path / 'form.vertices.txt'}: for each vertex of the form, the number of the nearest "
        f"vertex in {tmp_path / 'body.off'}, counted from 0" in said.replace("\n", " ")
    )
    numbers = np.loadtxt(tmp_path / "form.vertices.txt", dtype=int)
    moved = (body.vertices - body.vertices.mean(axis=0)) / body.area**0.5
    assert np.abs(read_mesh(tmp_path / "form.off").vertices - moved[numbers]).max() < 0.1
    # A later form of this name, which has the vertices of its mesh, has no such file.
    write_off(tmp_path / "rod.off", rod(0.1, 0.5))
    canonicalise(tmp_path / "rod.off", "-o", tmp_path / "form.off")
    assert not (tmp_path / "form.vertices.txt").exists()


def test_a_form_is_never_written_over_its_mesh(tmp_path, monkeypatch):
    write_off(tmp_path / "data" / "rod.off", rod(0.1, 0.5))
    (tmp_path / "link.off").symlink_to(tmp_path / "data" / "rod.off")
    before = (tmp_path / "data" / "rod.off").read_bytes()
    monkeypatch.chdir(tmp_path / "data")
    for mesh, output in (
        ("rod.off", "../link.off"),
        ("../link.off", "rod.off"),
        ("rod.off", "rod.off"),
    ):
        assert "would be replaced: it is read; write to another file or folder" in canonicalise(
            mesh, "-o", output, code=2
        )
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["rod.off"]
    assert (tmp_path / "data" / "rod.off").read_bytes() == before


def test_several_meshes_are_refused_with_what_makes_all_forms(tmp_path):
    meshes = [tmp_path / "a.off", tmp_path / "b.off"]
    for mesh in meshes:
        write_off(mesh, rod(0.1, 0.5))
    said = canonicalise(*meshes, "-o", tmp_path / "forms", code=2)
    assert "these are meshes" in said
    assert "make all forms with 'run -d'" in said


def test_what_a_plugin_raises_is_one_line_and_ends_the_work_on_one_shape_alone(
    tmp_path, monkeypatch
):
    """An error of a file, too, which is none of the output; one of the suite stays what it is."""
    mesh = tmp_path / "rod.off"
    write_off(mesh, rod(0.1, 0.5))
    plugin = tmp_path / "own.py"
    plugin.write_text(
        "from benchmark.api import canonical_form\n"
        '@canonical_form(name="wrong", title="Wrong")\n'
        "def wrong(shape): return 1 / 0\n"
        '@canonical_form(name="lost", title="Lost")\n'
        'def lost(shape): return open("weights.npz")\n'
    )
    words = (mesh, "--plugin", plugin, "-o", tmp_path / "form.off")
    said = call("canonicalise", *words, "-m", "wrong", code=2)
    assert f"{mesh}: the code of a plugin failed: own.py:3: ZeroDivisionError" in said
    said = call("canonicalise", *words, "-m", "lost", code=2)
    assert "the code of a plugin failed: own.py:5: FileNotFoundError" in said
    page = tmp_path / "page.html"
    chosen = ("-m", "wrong", "-m", "identity", "--plugin", plugin)
    said = call("demo", mesh, *chosen, "-o", page, "--no-open", code=1)
    assert "wrong of rod: the code of a plugin failed: own.py:3" in said
    assert page.is_file()
    monkeypatch.setattr("baselines.identity.Identity.canonicalise", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        form_of_file(mesh, "identity")


def test_a_picture_shows_a_mesh_and_its_form(tmp_path):
    write_off(tmp_path / "rod.off", rod(0.1, 0.5))
    words = (tmp_path / "rod.off", "-o", tmp_path / "form.off", "--picture")
    canonicalise(*words, tmp_path / "shape.png")
    with Image.open(tmp_path / "shape.png") as picture:
        left, right = (
            np.asarray(picture.convert("L"))[:, half]
            for half in (slice(None, 300), slice(-300, None))
        )
    assert min((left < 200).mean(), (right < 200).mean()) > 0.02
