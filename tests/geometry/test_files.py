"""Mesh files: odd ones that are valid, and damaged ones, each with a named error."""

from __future__ import annotations

import struct
import sys
import tracemalloc
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmark import formats
from benchmark.datasets.mesh_files import (
    FORMATS,
    READABLE,
    WRITABLE,
    files_beside,
    find_formats,
    lacks_last_break,
    mesh_suffix,
    read_mesh,
    write_mesh,
)
from benchmark.errors import ConfigurationError, InvalidMesh, UnreadableMesh
from benchmark.formats import ply, polygons
from benchmark.formats.polygons import split_polygons
from benchmark.formats.reading import read_with
from benchmark.geometry.mesh import FloatArray, IntArray, Mesh
from tests.toy import files_of_at_most, rod

INPUTS = Path(__file__).with_name("inputs")
#: A square of two triangles in every way to write it.
VALID = INPUTS / "valid"
#: Files that are refused: a name, and what the error says.
BAD = dict(
    line.split("  ", 1) for line in (INPUTS / "bad.txt").read_text(encoding="utf-8").splitlines()
)
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FAN = np.array([[0, 1, 2], [0, 2, 3]])
TURN = np.linalg.qr([[1.0, 2, 3], [4, 5, 6], [7, 8, 10]])[0]
POINTS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def read(folder: Path, name: str, content: bytes, tri: str = "") -> Mesh:
    (folder / name).write_bytes(content)
    if tri:
        (folder / name).with_suffix(".tri").write_text(tri)
    return read_mesh(folder / name)


@pytest.mark.parametrize(
    "name", sorted(path.name for path in VALID.iterdir() if ".tri" not in path.name)
)
def test_odd_but_valid_files_are_read(name: str) -> None:
    mesh = read_mesh(VALID / name)
    corners = mesh.vertices[mesh.faces[np.ptp(mesh.faces, axis=1) > 0]].reshape(-1, 9)
    expected = SQUARE[[[0, 1, 2], [0, 2, 3]]]
    np.testing.assert_array_equal(corners, expected.reshape(-1, 9))
    assert mesh.n_vertices == 4


def test_each_format_has_a_valid_file_and_is_named_on_the_page_of_meshes() -> None:
    names = {mesh_suffix(path) for path in VALID.iterdir()}
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "own-meshes.md").read_text()
    assert set(READABLE) <= names
    assert [name for name in READABLE if name not in page] == []


def test_a_format_is_found_in_its_module_and_files_of_others_are_preferred(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tetrahedron.py").write_text(TETRAHEDRON)
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path)])
    found = find_formats()
    monkeypatch.delitem(sys.modules, "benchmark.formats.tetrahedron")
    assert [*found] == [*READABLE, ".tet"]
    (tmp_path / "a.tet").write_text("2")
    assert read_with(found[".tet"], tmp_path / "a.tet").vertices.max() == 2.0
    # Its text may be cut off within a number, unless the format is known to mark its end.
    monkeypatch.setitem(FORMATS, ".tet", found[".tet"])
    assert lacks_last_break(tmp_path / "a.tet")


TETRAHEDRON = """
import numpy as np
from benchmark.formats.base import Format

def read(data, path):
    corners = np.array([[1, 2, 3], [1, 4, 2], [2, 4, 3], [3, 4, 1]])
    return float(data) * np.eye(4, 3), corners

FORMAT = Format(module=__name__, extensions=(".tet",), first_vertex=1, read=read)
"""

POLYGONS = {
    "L": ([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], 3.0),
    "dart": ([[0, 0], [2, 1], [4, 0], [2, 3]], 4.0),
    "middles": ([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]], 4.0),
    "star": ([[0, 3], [-1, 1], [-3, 0], [-1, -1], [0, -3], [1, -1], [3, 0], [1, 1]], 12.0),
}


@pytest.mark.parametrize("name", POLYGONS)
def test_a_polygon_has_its_area_wherever_it_begins(tmp_path: Path, name: str) -> None:
    corners, area = np.array(POLYGONS[name][0], dtype=float), POLYGONS[name][1]
    for first in range(len(corners)):
        lines = [
            "v {} {} {}".format(*np.array([x, y, 0]) @ TURN)
            for x, y in np.roll(corners, first, axis=0)
        ]
        lines += ["f " + " ".join(str(n + 1) for n in range(len(corners))), "f 1 2 3", ""]
        mesh = read(tmp_path, "a.obj", "\n".join(lines).encode())
        assert mesh.face_areas[:-1].sum() == pytest.approx(area)
        assert (mesh.face_normals[:-1] @ TURN[2] > -1e-6).all()


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_bent_convex_quads_are_split_at_their_first_corner(seed: int) -> None:
    random = np.random.default_rng(seed)
    angles = (np.arange(4) + random.uniform(-0.3, 0.3, (99, 4))).ravel() * np.pi / 2
    corners = np.arange(4 * 99).reshape(-1, 4)
    vertices = np.stack(
        [np.cos(angles), np.sin(angles), random.normal(0, 0.3, len(angles))], axis=1
    )
    triangles = split_polygons(vertices, corners.ravel(), np.full(99, 4))
    np.testing.assert_array_equal(triangles, corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3))


N_CORNERS = 200_000
ROUND = np.linspace(0, 2 * np.pi, N_CORNERS, endpoint=False)
CIRCLE = np.stack([np.cos(ROUND), np.sin(ROUND), 0 * ROUND], axis=1)


def star(first: int) -> FloatArray:
    """A polygon of which one corner alone sees all others."""
    angles = np.linspace(0.1, 3, N_CORNERS - 1)
    radii = np.random.default_rng(1).uniform(0.5, 1, N_CORNERS - 1)
    edge = np.stack([radii * np.cos(angles), radii * np.sin(angles), 0 * angles], axis=1)
    return np.roll(np.vstack([np.zeros(3), edge]), first, axis=0)


def notched() -> FloatArray:
    polygon = CIRCLE.copy()
    polygon[1000:1100, :2] *= 0.9
    return polygon


def waved(n_waves: int, height: float) -> FloatArray:
    return CIRCLE * (1 + height * np.cos(n_waves * ROUND))[:, None]


def polygon_area(polygon: FloatArray) -> float:
    normals = np.cross(polygon, np.roll(polygon, -1, axis=0))
    return float(np.linalg.norm(normals.sum(axis=0)) / 2)


def fan(polygon: FloatArray, monkeypatch: pytest.MonkeyPatch) -> IntArray:
    """The triangles of a polygon; fans of a few corners alone may be made, so that the time is
    linear.
    """
    looked: list[int] = []

    def look(faces: FloatArray, corner: int) -> NDArray[np.bool_]:
        looked.append(corner)
        return looks_ahead(faces, corner)

    looks_ahead = polygons._looks_ahead
    monkeypatch.setattr(polygons, "_looks_ahead", look)
    try:
        return split_polygons(polygon, np.arange(len(polygon)), np.array([len(polygon)]))
    finally:
        assert len(looked) <= polygons._MOST_FANS


@pytest.mark.parametrize(
    ("polygon", "corner"), [(CIRCLE, 0), (star(3), 3), (star(123_456), 123_456), (notched(), None)]
)
def test_a_face_of_many_corners_is_split_from_one_that_sees_all(
    polygon: FloatArray, corner: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    triangles = fan(polygon, monkeypatch)
    assert corner is None or (triangles[:, 0] == corner).all()
    areas = Mesh(polygon, triangles).face_areas
    assert areas.sum() == pytest.approx(polygon_area(polygon), rel=1e-5)


@pytest.mark.parametrize(
    "polygon",
    [
        waved(50, 0.01),  # each triangle folds back by less than a millionth
        waved(5000, 0.0001),
        np.stack([np.sin(ROUND), np.sin(2 * ROUND), 0 * ROUND], axis=1),  # a bow tie
        np.random.default_rng(2).normal(size=(N_CORNERS, 3)),
    ],
    ids=["waves", "fine waves", "bow tie", "noise"],
)
def test_a_face_of_many_corners_that_none_sees_is_refused(
    polygon: FloatArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InvalidMesh, match="without a corner that sees all others"):
        fan(polygon, monkeypatch)


def test_the_triangles_beside_packed_vertices_count_as_theirs(tmp_path: Path) -> None:
    for name, others in (("a.vert", ["a.tri", "a.tri.gz"]), ("a.vert.gz", ["a.tri.gz", "a.tri"])):
        for other in reversed(others):
            (tmp_path / other).touch()
            assert files_beside(tmp_path / name) == [tmp_path / other]
        for other in others:
            (tmp_path / other).unlink()


def test_a_pair_counts_from_1_or_0_and_an_unclear_or_incomplete_one_is_refused(
    tmp_path: Path,
) -> None:
    np.testing.assert_array_equal(
        read(tmp_path, "a.vert", POINTS.encode(), "0 1 2\n0 2 3\n").faces, FAN
    )
    with pytest.raises(
        UnreadableMesh, match=r"vertices 1 to 3 of 4, so they may count from 0 or from 1"
    ):
        read(tmp_path, "a.vert", POINTS.encode(), "1 2 3\n")
    with pytest.raises(UnreadableMesh, match=r"belongs to a \.vert file; .* such as a\.vert"):
        read_mesh(tmp_path / "a.tri")
    with pytest.raises(UnreadableMesh, match=r"alone\.tri: No such file"):
        read(tmp_path, "alone.vert", POINTS.encode())


def test_each_bad_file_has_its_reason() -> None:
    assert {path.name for path in (INPUTS / "bad").iterdir()} == BAD.keys()


@pytest.mark.parametrize("name", BAD)
def test_bad_files_have_one_line_that_names_them_and_a_hint(name: str) -> None:
    with pytest.raises((UnreadableMesh, InvalidMesh), match=BAD[name]) as caught:
        read_mesh(INPUTS / "bad" / name)
    assert str(caught.value).startswith(str(INPUTS / "bad" / name))
    assert "\n" not in str(caught.value)
    assert caught.value.hint


MILLION = 10**6


HOSTILE = {
    "breaks.off": b"OFF\n3 1 0\n" + b"\n" * MILLION,
    "blanks.off": b" " * MILLION,
    "digits.off": b"OFF " + b"9" * MILLION,
    "comments.off": b"#\n" * (MILLION // 2),
    "corners.off": b"OFF\n3 400000 0\n0 0 0\n0 0 1\n0 1 0\n" + b"0\n" * 400_000,
    "slashes.obj": b"v 0 0 0\nf " + b"/" * MILLION,
    "blanks.obj": b"v" + b" " * MILLION,
    "breaks.ply": b"ply\n" + b"\n" * MILLION,
    "list.ply": (INPUTS / "list.ply").read_bytes(),
    "breaks.stl": b"solid vertex" + b"\n" * MILLION,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_in_memory_of_its_size_and_ends(
    tmp_path: Path, name: str
) -> None:
    tracemalloc.start()
    try:
        with pytest.raises((UnreadableMesh, InvalidMesh)):
            read(tmp_path, name, HOSTILE[name])
        assert tracemalloc.get_traced_memory()[1] < 250 * len(HOSTILE[name]) + 2**22
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "size"), [("plain.off", 50), ("packed.off.gz", 150), ("compressed.mat", 600)]
)
def test_what_is_larger_than_the_limit_is_refused(
    name: str, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def allow(largest: int) -> None:
        for module in ("benchmark.formats.reading", "benchmark.files"):
            monkeypatch.setattr(f"{module}.LARGEST_FILE", largest)

    allow(size)
    assert read_mesh(VALID / name).n_faces == 2
    allow(size - 1)
    with pytest.raises(UnreadableMesh, match="more than"):
        read_mesh(VALID / name)


@settings(max_examples=30)
@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=9, max_size=9),
    st.sampled_from(WRITABLE),
)
def test_every_finite_coordinate_survives_writing(
    tmp_path_factory, numbers: list[float], suffix: str
) -> None:
    path = tmp_path_factory.mktemp("bits") / f"x{suffix}"
    mesh = Mesh(np.array(numbers).reshape(3, 3), [[0, 1, 2]])
    write_mesh(path, mesh)
    assert read_mesh(path).vertices.tobytes() == mesh.vertices.tobytes()
    for name, reason in (("a.stl", r"\.stl"), (f"x{suffix}/a{suffix}", "File exists")):
        with pytest.raises(ConfigurationError, match=reason):
            write_mesh(path.parent / name, mesh)


def test_on_a_full_disk_the_old_file_stays(tmp_path: Path) -> None:
    target = tmp_path / "rod.off"
    target.write_text("old")
    with (
        files_of_at_most(4096),
        pytest.raises(ConfigurationError, match=f"^{target}: File too large; choose a file"),
    ):
        write_mesh(target, rod(0.1, 0.5))
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("rod.off", "old")]
    write_mesh(target, rod(0.1, 0.5))
    assert target.read_text().startswith("OFF")


def test_polygons_of_a_ply_file_that_change_their_number_of_corners_are_read_in_few_runs(
    tmp_path,
):
    n_quads = 500
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {1 + n_quads}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    triangle = struct.pack("<B3i", 3, 0, 1, 2)
    quad = struct.pack("<B4i", 4, 0, 1, 2, 3)
    path = tmp_path / "mixed.ply"
    path.write_bytes(header.encode() + SQUARE.astype("<f4").tobytes() + triangle + n_quads * quad)
    with patch("benchmark.formats.ply._run_at", wraps=ply._run_at) as run_at:
        mesh = read_mesh(path)
    assert mesh.n_faces == 1 + 2 * n_quads
    assert run_at.call_count < 20  # each run is twice as long as the one before
