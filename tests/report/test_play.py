"""The page to play with: which shapes, forms and rankings it holds, and how small they are."""

import base64
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.record_arrays import read_distances
from benchmark.report import play
from benchmark.report.forms import Drawn, StoredForms, centred
from benchmark.report.play import (
    PlayGallery,
    PlayMethod,
    PlayShape,
    play_galleries,
    play_page,
    thinned_surface,
    write_play_page,
)
from benchmark.report.results import open_results
from tests.report.records import record
from tests.runs.toy import run_toy
from tests.toy import rod


def content_of(page):
    """Return what the script of a page reads, and the numbers of its surfaces."""
    content = re.search(r'<script id="content"[^>]*>(.*?)</script>', page, re.DOTALL)[1]
    packed = re.search(r'<script id="numbers"[^>]*>(.*?)</script>', page, re.DOTALL)[1]
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed)), np.uint8).reshape(2, -1)
    return json.loads(content), np.ascontiguousarray(planes.T).view("<i2").ravel()


def points_of(surface, meshes, numbers):
    n_vertices = meshes[surface["mesh"]]["vertices"]
    return numbers[surface["points"] : surface["points"] + 3 * n_vertices].reshape(-1, 3)


@pytest.fixture(scope="module")
def stored(results):
    return StoredForms(results.folder)


@pytest.fixture(scope="module")
def galleries(results, stored):
    return play_galleries(stored, results.records)


def test_a_gallery_has_the_shapes_first_then_the_forms_and_no_descriptor(galleries):
    (gallery,) = galleries
    assert [method.name for method in gallery.methods] == ["identity", "gps"]
    assert gallery.methods[0].title == "The shape itself"
    assert all(method.sentence for method in gallery.methods)
    assert gallery.n_left_out == 0
    for shape in gallery.shapes:
        assert shape.forms[0] is shape.body
        assert shape.forms[1].body is not None


def test_a_gallery_is_shown_though_its_first_shape_is_refused():
    class Stored:
        def shape(self, record, name):
            return None if name == "cat0" else "a surface"

    files = {"prepared": [f"{number:032x}" for number in range(12)]}
    lacking = record("gps", unsupported=[("cat0", "cut off")], files=files)
    assert play._grouped([lacking], Stored()) == [[lacking]]


def test_rankings_are_those_of_the_distances_without_the_query(results, stored, galleries):
    (gallery,) = galleries
    record = next(record for record in results.records if record.method == "gps")
    matrix = read_distances(results.folder, record)
    for query, ranked in enumerate(gallery.methods[1].ranked):
        others = [number for number in range(len(matrix)) if number != query]
        assert ranked == sorted(others, key=lambda number: matrix[query, number])


def test_where_there_is_no_room_all_classes_have_as_many_poses_and_rank_each_other(results, stored):
    (gallery,) = play_galleries(stored, results.records, most_surfaces=9)
    assert [shape.label for shape in gallery.shapes] == [gallery.shapes[0].label] * 2
    assert gallery.n_left_out == len(results.records[0].shapes) - 2
    assert [*map(list, gallery.methods[1].ranked)] == [[1], [0]]


@pytest.mark.parametrize(
    ("labels", "most", "expected"),
    [
        ("aabbcc", 6, [0, 1, 2, 3, 4, 5]),
        ("aaaabbbb", 6, [0, 1, 2, 4, 5, 6]),
        ("abababab", 6, [0, 1, 2, 3, 4, 5]),
        ("aaabbbccc", 4, [0, 1, 2]),
        ("aaaa", 1, [0, 1, 2]),
        ("", 3, []),
    ],
)
def test_shapes_are_left_out_by_pose_then_by_class(labels, most, expected):
    assert play._chosen(labels, most) == expected


def test_the_page_holds_each_surface_once_within_the_unit_ball(galleries):
    page = play_page(galleries)
    content, numbers = content_of(page)
    (gallery,) = content["galleries"]
    assert [shape["forms"][0] for shape in gallery["shapes"]] == [
        shape["body"] for shape in gallery["shapes"]
    ]
    for shape, made in zip(gallery["shapes"], galleries[0].shapes, strict=True):
        for surface, drawn in zip(shape["forms"], made.forms, strict=True):
            points = points_of(surface, content["meshes"], numbers) / 32767
            kept, _ = thinned_surface(made.body.mesh)
            true = drawn.mesh.vertices[kept]
            true = true - (true.min(axis=0) + true.max(axis=0)) / 2
            true = true / np.linalg.norm(true, axis=1).max()
            assert points == pytest.approx(true, abs=1e-4)


def test_a_surface_is_thinned_to_whole_triangles_of_its_own_vertices():
    mesh = rod(0.1, 1.0)
    kept, faces = thinned_surface(mesh, mesh.n_vertices // 2)
    assert len(kept) <= mesh.n_vertices // 2 + 10
    assert kept.max() < mesh.n_vertices
    assert faces.max() == len(kept) - 1
    assert (np.diff(np.sort(faces, axis=1), axis=1) > 0).all()


def moebius_strip(n_around=60, n_across=5):
    """A band with a half turn: its triangles cannot all be oriented alike."""
    angle, across = np.meshgrid(
        np.linspace(0, 2 * np.pi, n_around, endpoint=False),
        np.linspace(-0.3, 0.3, n_across),
        indexing="ij",
    )
    radius = 1 + across * np.cos(angle / 2)
    vertices = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)], axis=2
    )
    numbers = np.arange(n_around * n_across).reshape(n_around, n_across)
    here = np.concatenate([numbers, numbers[:1, ::-1]])  # the end meets the start upside down
    corners = [here[:-1, :-1], here[1:, :-1], here[1:, 1:], here[:-1, 1:]]
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(vertices.reshape(-1, 3), faces)


def test_a_surface_with_one_side_is_thinned_without_libigl_which_would_never_return(monkeypatch):
    monkeypatch.delattr("igl.decimate")
    mesh = moebius_strip()
    kept, faces = thinned_surface(mesh, 100)
    assert 50 < len(kept) < 120
    assert len(np.unique(faces)) == len(kept)


def gallery_of(label="cat", name="cat0", **more):
    body = Drawn(centred(rod(0.1, 1.0)))
    flat = Drawn(Mesh(np.zeros_like(body.mesh.vertices), body.mesh.faces), body)
    shape = PlayShape(name=name, label=label, body=body, forms=[body, flat, None])
    methods = [PlayMethod(name=f"m{k}", title=f"M{k}") for k in range(3)]
    return PlayGallery(title="Own", methods=methods, shapes=[shape], **more)


def test_shapes_without_classes_have_forms_and_no_ranking(tmp_path):
    write_play_page(tmp_path / "play.html", [gallery_of()])
    content, _ = content_of((tmp_path / "play.html").read_text(encoding="utf-8"))
    (gallery,) = content["galleries"]
    assert [method["ranked"] for method in gallery["methods"]] == [[], [], []]
    (shape,) = gallery["shapes"]
    assert shape["forms"][2] is None
    assert shape["forms"][1]["mesh"] == shape["body"]["mesh"]


@pytest.mark.parametrize(
    ("name", "label", "pose"),
    [
        ("cat0", "cat", "pose 0"),
        ("man-1_kneeling", "man-1", "kneeling"),
        ("man-1/a-b", "man-1", "a b"),
        ("scan", "cat", "scan"),
        ("cat", "cat", "cat"),
    ],
)
def test_poses_are_named_by_what_follows_the_class(name, label, pose):
    assert gallery_of(label, name).shapes[0].pose == pose


def test_hostile_names_end_no_script():
    page = play_page([gallery_of("</script><b>", "</script><b>1")], back='x" onclick="y')
    assert page.count("</script") == 3
    assert 'onclick="y' not in page
    assert content_of(page)[0]["galleries"][0]["shapes"][0]["label"] == "</script><b>"


def test_without_shapes_there_is_no_page(results, stored):
    published = [record.without_files() for record in results.records]
    assert play_galleries(stored, published) == []
    with pytest.raises(ConfigurationError, match="no forms to play with"):
        play_page([])


def test_the_page_needs_no_network(galleries):
    addresses = re.findall(r'(?:src|href)="([^"]*)"', play_page(galleries, back="index.html"))
    assert [each for each in addresses if not each.startswith("data:image/")] == ["index.html"]


def test_the_sentence_of_a_plugin_is_that_of_its_record(rods, tmp_path):
    plugin = Path(__file__).parents[2] / "examples" / "ray_stretch.py"
    run_toy(rods, tmp_path, "ray-stretch", plugins=(plugin,))
    (gallery,) = play_galleries(StoredForms(tmp_path), open_results(tmp_path).records)
    (method,) = gallery.methods
    assert method.sentence == "Vertices at their geodesic distance from the centre."
    assert [shape.forms[0].body for shape in gallery.shapes] == [
        shape.body for shape in gallery.shapes
    ]
