"""Mesh files: odd ones that are valid, and damaged ones, each with a named error."""

from __future__ import annotations

import gzip
import io
import struct
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from benchmark.errors import BenchmarkError, ConfigurationError, InvalidMesh, UnreadableMesh
from benchmark.geometry.io import WRITABLE, read_mesh, write_mesh
from benchmark.geometry.mesh import Mesh
from tests.toy import files_of_at_most, rod

INPUTS = Path(__file__).with_name("inputs")
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FAN = np.array([[0, 1, 2], [0, 2, 3]])
POINTS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
OFF = f"OFF\n4 2 0\n{POINTS}3 0 1 2\n3 0 2 3\n"
V = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
OBJ = f"{V}f 1 2 3\nf 1 3 4\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
CORNERS = "property list uchar int vertex_indices\n"
EDGES = "element edge 1\nproperty int a\nproperty int b\n"
ROWS = "3 0 1 2\n3 0 2 3\n"


def ply(body: str | bytes, kind: str = "ascii", xyz: str = XYZ, faces: str = f"element face 2\n{CORNERS}") -> bytes:
    head = f"ply\nformat {kind} 1.0\nelement vertex 4\n{xyz}{faces}end_header\n".encode()
    return head + (body.encode() if isinstance(body, str) else body)


def binary(order: str, floats: str = "f4", count: str = "B", index: str = "i4") -> bytes:
    faces = [struct.pack(f"{order}{count}", 3) + face.astype(f"{order}{index}").tobytes() for face in FAN]
    return SQUARE.astype(f"{order}{floats}").tobytes() + b"".join(faces)


def stl(binary_head: bytes | None = None, name: str = " a") -> bytes:
    corners = SQUARE[FAN].astype("<f4")
    if binary_head is not None:
        facets = b"".join(struct.pack("<3f", 0, 0, 1) + facet.tobytes() + b"\0\0" for facet in corners)
        return binary_head.ljust(80) + struct.pack("<I", 2) + facets
    vertices = ["".join(f"vertex {x:e} {y:e} {z:e}\n" for x, y, z in facet) for facet in corners]
    text = "".join(f"facet normal 0 0 1\nouter loop\n{facet}endloop\nendfacet\n" for facet in vertices)
    return f"solid{name}\n{text}endsolid{name}\n".encode()


def mat(kind: str = "f8", compressed: bool = True, **other: object) -> bytes:
    stream = io.BytesIO()
    fields = {axis: SQUARE[:, [k]].astype(kind) for k, axis in enumerate("XYZ")} | {"TRIV": (FAN + 1).astype(kind)}
    savemat(stream, {"before": np.arange(9), "surface": fields | other}, do_compression=compressed)
    return stream.getvalue()


def glb() -> bytes:
    return trimesh.Trimesh(SQUARE, FAN, process=False).export(file_type="glb")


ODD = {
    "plain.off": OFF,
    "no-blank-before-counts.off": OFF.replace("OFF\n4", "OFF4"),
    "counts-beside.off": OFF.replace("OFF\n", "OFF "),
    "lower-case.off": OFF.lower(),
    "no-edges.off": OFF.replace("4 2 0", "4 2"),
    "edges.off": OFF.replace("4 2 0", "4 2 5"),
    "no-keyword.off": OFF.removeprefix("OFF\n"),
    "no-final-break.off": OFF[:-1],
    "windows.off": OFF.replace("\n", "\r\n"),
    "old-macintosh.off": OFF.replace("\n", "\r"),
    "mark.off": "\ufeff" + OFF,
    "utf-16.off": OFF.encode("utf-16"),
    "comments.off": "# by hand\n" + OFF.replace("OFF", "OFF # head").replace("1 1 0", "1 1 0 # third") + "# end",
    "blank-lines.off": "\n\n" + OFF.replace("\n", "\n\n"),
    "tabs.off": OFF.replace(" ", "\t"),
    "indented.off": OFF.replace("\n", "  \n  "),
    "one-line.off": "OFF\n4 2 0\n" + OFF[10:].replace("\n", " "),
    "quad.off": f"OFF\n4 1 0\n{POINTS}4 0 1 2 3\n",
    "colour-of-quad.off": f"OFF\n4 1 0\n{POINTS}4 0 1 2 3 0.5 0.5 0.5\n",
    "colour-of-some.off": OFF.replace("3 0 1 2", "3 0 1 2 255 0 0"),
    "colours.off": "C" + OFF.replace(" 0\n", " 0 9 9 9 1\n").replace("4 2 0 9 9 9 1", "4 2 0"),
    "normals.off": "N" + OFF.replace(" 0\n", " 0 0 0 1\n").replace("4 2 0 0 0 1", "4 2 0"),
    "textures.off": "ST" + OFF.replace(" 0\n", " 0 .5 .5\n").replace("4 2 0 .5 .5", "4 2 0"),
    "plain.obj": OBJ,
    "everything.obj": f"mtllib a.mtl\no a\ng b\ns off\n{V}vt 0 0\nvn 0 0 1\nusemtl m\nf 1/1/1 2/1/1 3/1/1 4/1/1\n",
    "colours.obj": OBJ.replace(" 0\n", " 0 .5 .5 .5\n"),
    "colour-of-some.obj": OBJ.replace("1 1 0", "1 1 0 .5 .5 .5"),
    "weights.obj": OBJ.replace(" 0\n", " 0 1.0\n"),
    "counting-back.obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\nf -4 -2 -1\n",
    "continued.obj": f"{V}f 1 2 \\\n3 4\n",
    "mark.obj": "\ufeff" + OBJ,
    "latin.obj": "o B\xe4r\n".encode("latin-1") + OBJ.encode(),
    "comment-of-vertex.obj": OBJ.replace("1 1 0", "1 1 0 # third"),
    "old-faces.obj": OBJ.replace("f 1 2", "fo 1 2"),
    "points-and-lines.obj": OBJ + "p 1\nl 1 2\nvp 0 0\n",
    "indented.obj": "  " + OBJ.replace("\n", "  \n\t"),
    "faces-first.obj": "f 1 2 3\nf 1 3 4\n" + V,
    "plain.ply": ply(POINTS + ROWS),
    "little.ply": ply(binary("<"), "binary_little_endian"),
    "big.ply": ply(binary(">"), "binary_big_endian"),
    "doubles.ply": ply(binary("<", "f8"), "binary_little_endian", XYZ.replace("float", "double")),
    "types.ply": ply(
        binary("<", "f4", "I", "u2"),
        "binary_little_endian",
        XYZ.replace("float", "float32"),
        f"element face 2\n{CORNERS.replace('uchar int', 'uint32 ushort')}",
    ),
    "vertex_index.ply": ply(POINTS + ROWS).replace(b"vertex_indices", b"vertex_index"),
    "end_header-in-comment.ply": ply(POINTS + ROWS).replace(b"1.0\n", b"1.0\ncomment before end_header\nobj_info x\n"),
    "windows.ply": ply(POINTS + ROWS).replace(b"\n", b"\r\n"),
    "quad.ply": ply(POINTS + "4 0 1 2 3\n", faces=f"element face 1\n{CORNERS}"),
    "mixed.ply": ply(POINTS + ROWS + "4 0 0 0 0\n", faces=f"element face 3\n{CORNERS}"),
    "colours.ply": ply(POINTS.replace(" 0\n", " 0 9 9\n") + ROWS, xyz=XYZ + "property uchar r\nproperty uchar g\n"),
    "flags-first.ply": ply(POINTS + "7 3 0 1 2\n7 3 0 2 3\n", faces=f"element face 2\nproperty uchar flag\n{CORNERS}"),
    "edges.ply": ply(POINTS + ROWS + "0 1\n", faces=f"element face 2\n{CORNERS}{EDGES}"),
    "trailing.ply": ply(binary("<") + bytes(9), "binary_little_endian"),
    "plain.stl": stl(),
    "no-name.stl": stl(name=""),
    "upper-case.stl": stl().upper(),
    "binary.stl": stl(b"by hand"),
    "binary-solid.stl": stl(b"solid but binary"),
    "trailing.stl": stl(b"") + b"\0",
    "compressed.mat": mat(),
    "plain.mat": mat("f4", compressed=False),
    "integers.mat": mat("u2", name="cat", more={"inner": [1, 2]}),
    "rows.mat": mat(**{axis: SQUARE[None, :, k] for k, axis in enumerate("XYZ")}),
    "pair.vert": POINTS,
    "glb.glb": glb(),
    "gltf.gltf": (INPUTS / "gltf.gltf").read_bytes(),
    "upper.OFF": OFF,
    "packed.off.gz": gzip.compress(OFF.encode()),
    "packed.ply.gz": gzip.compress(ply(binary("<"), "binary_little_endian")),
}  # fmt: skip


def read(folder: Path, name: str, content: str | bytes, tri: str = "1 2 3\n1 3 4\n") -> Mesh:
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    if name.endswith(".vert"):
        (folder / name).with_suffix(".tri").write_text(tri)
    return read_mesh(folder / name)


@pytest.mark.parametrize("name", ODD)
def test_odd_but_valid_files_are_read(tmp_path: Path, name: str) -> None:
    mesh = read(tmp_path, name, ODD[name])
    corners = mesh.vertices[mesh.faces[np.ptp(mesh.faces, axis=1) > 0]].reshape(-1, 9)
    expected = SQUARE[[[0, 1, 2], [0, 2, 3]]]
    np.testing.assert_array_equal(corners, expected.reshape(-1, 9))
    assert mesh.n_vertices == 4


def test_a_pair_counts_from_1_or_0_and_an_unclear_one_is_refused(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read(tmp_path, "a.vert", POINTS, "0 1 2\n0 2 3\n").faces, FAN)
    with pytest.raises(UnreadableMesh, match=r"vertices 1 to 3 of 4, so they may count from 0 or from 1"):
        read(tmp_path, "a.vert", POINTS, "1 2 3\n")
    with pytest.raises(UnreadableMesh, match=r"holds triangles alone; name a\.vert"):
        read_mesh(tmp_path / "a.tri")


CUT = ("plain.off", "little.ply", "plain.ply", "plain.stl", "binary.stl", "plain.obj", "packed.off.gz", "glb.glb")


@pytest.mark.parametrize("name", [*CUT, "compressed.mat"])
def test_no_truncated_file_is_accepted(tmp_path: Path, name: str) -> None:
    """A cut in the last number passes, and in OBJ, which has no counts, one between two faces."""
    whole = ODD[name]
    data = whole.encode() if isinstance(whole, str) else whole
    last = data.rindex(b"3\n") if name in ("plain.off", "plain.ply") else len(data) - 1
    last = {"plain.obj": data.rfind(b"4"), "plain.stl": data.rfind(b"endsolid") + 7}.get(name, last)
    ends = np.unique(np.linspace(0, last, 150).astype(int))
    between_faces = range(len(V) + 7, len(V) + 11) if name == "plain.obj" else ()
    for end in set(ends.tolist()) - set(between_faces):
        with pytest.raises((UnreadableMesh, InvalidMesh)):
            read(tmp_path, name, data[:end])


NUMBER = "expected a number"
BAD: dict[str, tuple[str | bytes, str]] = {
    "empty.off": ("", "the file is empty; fetch or export"),
    "blank.ply": (" \n", "the file is empty"),
    "noise.off": (bytes(range(256)), "does not begin with OFF"),
    "noise.ply": (bytes(range(256)), "expected 'ply'|ply"),
    "noise.stl": (bytes(range(256)), "neither an ASCII STL"),
    "noise.mat": (bytes(range(256)), "not a readable mat file"),
    "noise.glb": (bytes(range(256)), "not a readable glb file"),
    "noise.off.gz": (OFF, "not a readable off file: .*incorrect header"),
    "words.obj": ("once upon a time", "no line of a vertex"),
    "unknown.xyz": ("0 0 0\n", r"unknown extension '\.xyz'; convert it to one of \.off"),
    "none": ("0 0 0\n", "unknown extension ''"),
    "underscore.off": (OFF.replace("3 0 1 2", "3 0 1 0_2"), "a number"),
    "script.off": (OFF.replace("1 1 0", "\u0661 1 0"), NUMBER),
    "fraction.off": (OFF.replace("3 0 1 2", "3 0 1.5 2"), "not a whole number"),
    "negative.off": (OFF.replace("3 0 2 3", "3 0 2 -1"), "faces name vertices -1 to 2, but there are 0 to 3"),
    "beyond.off": (OFF.replace("3 0 2 3", "3 1 3 4"), "faces name vertices 0 to 4, but there are 0 to 3"),
    "from-1.off": (OFF.replace(ROWS, "3 1 2 3\n3 1 3 4\n"), "counts vertices from 0, the file from 1; subtract 1 from"),
    "fewer.off": (OFF.replace("4 2 0", "4 3 0"), "4 vertices and 3 faces announced, but 6 lines follow"),
    "more.off": (OFF.replace("4 2 0", "4 1 0"), "4 vertices and 1 faces announced, but 6 lines follow"),
    "corners.off": (OFF.replace("3 0 2 3", "4 0 2 3"), "face 2 of 2 has 3 corners, not 4"),
    "negative-count.off": (OFF.replace("3 0 1 2", "-3 0 1 2"), "face 1 of 2 has -3 corners"),
    "zero-count.off": (OFF.replace("3 0 1 2", "0 0 1 2"), "face 1 of 2 has 0 corners"),
    "two-corners.off": (OFF.replace("4 2 0", "4 3 0") + "2 0 1\n", "face 3 of 3 has 2 corners"),
    "one-corner.obj": (OBJ.replace("f 1 2 3", "f 1"), "face 1 of 2 has 1 corner;"),
    "two-corners.obj": (OBJ.replace("f 1 2 3", "f 1 2"), "face 1 of 2 has 2 corners"),
    "no-break.obj": (OBJ[:-1], "last line has no line break, so it may be cut off"),
    "homogeneous.off": ("4OFF\n4 2 0\n0 0 0 2\n", "does not begin with OFF"),
    "binary.off": ("OFF BINARY\n4 2 0\n", "does not begin with OFF"),
    "points.off": (OFF[:-16].replace("4 2 0", "4 0 0"), "there are no faces; make a surface of the points: python -c"),
    "nan.off": (OFF.replace("1 1 0", "nan 1 0"), "NaN or infinite"),
    "letters.obj": (OBJ.replace("1 1 0", "1 x 0"), NUMBER),
    "ragged.obj": (OBJ.replace("1 1 0", "1 1"), "fewer than three numbers"),
    "zero.obj": (OBJ.replace("f 1 2", "f 0 2"), "faces name vertices 0 to 4, but there are 1 to 4"),
    "from-0.obj": (V + "f 0 1 2\nf 0 2 3\n", "counts vertices from 1, the file from 0; add 1 to each"),
    "from-0.mat": (mat(TRIV=FAN.astype("f8")), "counts vertices from 1, the file from 0; add 1 to each"),
    "beyond.obj": (OBJ.replace("f 1 2", "f -9 2"), "faces name vertices -1"),
    "twice.ply": (ply(POINTS + ROWS).replace(b"element face", b"element vertex"), "not a readable ply file"),
    "surf.obj": (
        OBJ + "surf 0 1 0 1 1 2 3 4\n",
        "it has lines 'surf', which are not read; export one file of triangles",
    ),
    "strips.ply": (
        ply(POINTS + ROWS + "4 0 1 2 3\n", faces=f"element face 2\n{CORNERS}element tristrips 1\n{CORNERS}"),
        "the elements vertex, face, tristrips, not vertex and face alone",
    ),
    "no-faces.ply": (ply(POINTS, faces=""), "elements vertex, not vertex and face"),
    "two-corners.ply": (ply(POINTS + "2 0 1\n3 0 2 3\n"), "face 1 of 2 has 2 corners"),
    "zeroed.ply": (
        ply(binary("<")[:48] + b"\0" + binary("<")[61:], "binary_little_endian"),
        "face 1 of 2 has 0 corners",
    ),
    "count.ply": (ply(POINTS, faces=f"element face {10**17}\n{CORNERS}"), "rows announced, but it holds"),
    "letters.ply": (ply(POINTS.replace("1 1", "1 x") + ROWS), "not a readable ply file"),
    "open.stl": (stl()[:-12], "does not end with 'endsolid'"),
    "two-corners.stl": (stl().replace(b"vertex", b"normal", 1), "facet 1 of 2 has 2 vertices"),
    "no-end.stl": (stl().replace(b"endfacet\n", b"", 1), "facet 1 of 1 has 6 vertices"),
    "fewer.stl": (stl(b"").replace(struct.pack("<I", 2), struct.pack("<I", 1)), "neither an ASCII STL"),
    "count.stl": (b" " * 80 + struct.pack("<I", 2**32 - 1) + bytes(1000), "neither an ASCII STL"),
    "hdf5.mat": (b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF", "save it with '-v7'"),
    "lengths.mat": (mat(X=np.zeros(3)), "differ in length"),
    "text.mat": (mat(X="abc"), "no real numbers"),
    "columns.mat": (mat(TRIV=np.ones((2, 4))), "three columns"),
    "alone.gltf": ('{"asset": {"version": "2.0"}}', "there are no faces"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_have_one_line_that_names_them_and_a_hint(tmp_path: Path, name: str) -> None:
    content, reason = BAD[name]
    with pytest.raises((UnreadableMesh, InvalidMesh), match=reason) as caught:
        read(tmp_path, name, content)
    assert str(caught.value).startswith(str(tmp_path / name))
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
    "list.ply": ply(b"\xff" * 100, "binary_little_endian", faces=f"element face 1\n{CORNERS.replace('uchar', 'uint')}"),
    "breaks.stl": b"solid vertex" + b"\n" * MILLION,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_in_time_and_memory_of_its_size(tmp_path: Path, name: str) -> None:
    tracemalloc.start()
    start = time.process_time()
    try:
        with pytest.raises((UnreadableMesh, InvalidMesh)):
            read(tmp_path, name, HOSTILE[name])
        assert time.process_time() - start < 20
        assert tracemalloc.get_traced_memory()[1] < 250 * len(HOSTILE[name]) + 2**22
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["plain.off", "packed.off.gz", "compressed.mat"])
def test_what_is_larger_than_the_limit_is_refused(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmark.geometry.io.LARGEST_FILE", 20)
    if name == "compressed.mat":  # only what is packed in it
        monkeypatch.setattr("benchmark.geometry.io._load", Path.read_bytes)
    with pytest.raises(UnreadableMesh, match="more than .* GiB"):
        read(tmp_path, name, ODD[name])


@settings(max_examples=30)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=9, max_size=9), st.sampled_from(WRITABLE))
def test_every_finite_coordinate_survives_writing(tmp_path_factory, numbers: list[float], suffix: str) -> None:
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
    with files_of_at_most(4096), pytest.raises(ConfigurationError, match=f"^{target}: File too large; choose a file"):
        write_mesh(target, rod(0.1, 0.5))
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("rod.off", "old")]
    write_mesh(target, rod(0.1, 0.5))
    assert target.read_text().startswith("OFF")


def test_paths_that_cannot_be_read(tmp_path: Path) -> None:
    for name, reason in (("missing.off", "No such file"), ("folder.off", "Is a directory")):
        (tmp_path / "folder.off").mkdir(exist_ok=True)
        with pytest.raises(BenchmarkError, match=f"{name}: {reason}"):
            read_mesh(tmp_path / name)
    (tmp_path / "alone.vert").write_text(POINTS)
    with pytest.raises(UnreadableMesh, match=r"alone\.tri: No such file"):
        read_mesh(tmp_path / "alone.vert")
