import struct
from contextlib import suppress

import numpy as np
import pytest

from benchmark.errors import ConfigurationError, InvalidMesh, UnreadableMesh
from benchmark.geometry.io import READABLE, read_mesh, write_mesh
from benchmark.geometry.mesh import Mesh
from tests.geometry.mutations import valid_files
from tests.geometry.surfaces import sphere

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FAN = [[0, 1, 2], [0, 2, 3]]


def written(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def assert_square(mesh):
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    np.testing.assert_array_equal(mesh.faces, FAN)


@pytest.mark.parametrize(
    "content",
    [
        "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n",
        "OFF 4 2 5\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n",
        "# made by hand\nOFF # header\n\n4 1\n0 0 0 # first\n1 0 0\n\n1 1 0\n0 1 0\n4 0 1 2 3\n",
        "OFF\r\n4 2 0\r\n0 0 0\r\n1 0 0\r\n1 1 0\r\n0 1 0\r\n3 0 1 2 255 0 0\r\n3 0 2 3\r\n",
        "COFF\n4 1 0\n0 0 0 9 9 9 1\n1 0 0 9 9 9 1\n1 1 0 9 9 9 1\n0 1 0 9 9 9 1\n4 0 1 2 3 0.5 0.5 0.5\n",
    ],
)
def test_off(tmp_path, content):
    assert_square(read_mesh(written(tmp_path, "square.off", content)))


@pytest.mark.parametrize(
    "content",
    [
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n",
        "mtllib a.mtl\no square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\n",
        "v 0 0 0 .5 .5 .5\nv 1 0 0 .5 .5 .5\nv 1 1 0 .5 .5 .5\nv 0 1 0 .5 .5 .5\nf 1//1 2//1 3//1 # one\nf 1 3 4\n",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\nf -4 -2 -1\n",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\n3 4\n",
    ],
)
def test_obj(tmp_path, content):
    assert_square(read_mesh(written(tmp_path, "square.obj", content)))


def ply_header(encoding, face="property list uchar int vertex_indices\n", faces=2):
    return (
        f"ply\nformat {encoding} 1.0\ncomment by hand\nelement vertex 4\nproperty float x\nproperty float y\n"
        f"property float z\nproperty uchar red\nelement face {faces}\n{face}"
        "element edge 1\nproperty int a\nend_header\n"
    ).encode()


def test_ply_with_a_quad_and_further_properties(tmp_path):
    header = ply_header("ascii", face="property uchar flag\nproperty list uchar uint vertex_index\n", faces=1)
    body = b"0 0 0 7\n1 0 0 7\n1 1 0 7\n0 1 0 7\n9 4 0 1 2 3\n1\n"
    assert_square(read_mesh(written(tmp_path, "square.ply", header + body)))
    binary = ply_header("binary_big_endian", faces=1) + b"".join(struct.pack(">fffB", *point, 7) for point in SQUARE)
    assert_square(read_mesh(written(tmp_path, "binary.ply", binary + struct.pack(">B5i", 4, 0, 1, 2, 3, 1))))


@pytest.mark.parametrize("base", [0, 1])
def test_vert_tri_pair_counts_from_its_minimum(tmp_path, base):
    written(tmp_path, "square.tri", "".join(f"{a + base} {b + base} {c + base}\n" for a, b, c in FAN))
    assert_square(read_mesh(written(tmp_path, "square.vert", "0 0 0\n1 0 0\n1 1 0\n0 1 0\n")))


PLY_ROWS = b"0 0 0 7\n1 0 0 7\n1 1 0 7\n0 1 0 7\n3 0 1 2\n3 0 2 3\n1\n"
PLY_BINARY = (
    ply_header("binary_little_endian")
    + b"".join(struct.pack("<fffB", *point, 7) for point in SQUARE)
    + b"".join(struct.pack("<B3i", 3, *face) for face in FAN)
    + struct.pack("<i", 1)
)
GOOD_OFF = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"


@pytest.mark.parametrize(
    ("name", "content", "error"),
    [
        *((f"empty{suffix}", b"", UnreadableMesh) for suffix in READABLE),
        *((f"noise{suffix}", bytes(range(256)) * 4, UnreadableMesh) for suffix in READABLE),
        *((f"words{suffix}", "solid once upon a time\n", UnreadableMesh) for suffix in READABLE),
        ("fraction.off", GOOD_OFF.replace("3 0 1 2", "3 0 1.5 2"), UnreadableMesh),
        ("negative.off", GOOD_OFF.replace("3 0 2 3", "3 0 2 -1"), InvalidMesh),
        ("letters.obj", "v 0 0 x\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", UnreadableMesh),
        ("ragged.obj", "v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", UnreadableMesh),
        ("unknown.xyz", "0 0 0\n", UnreadableMesh),
        ("none", "0 0 0\n", UnreadableMesh),
    ],
)
def test_bad_files_raise_a_named_error_with_file_and_hint(tmp_path, name, content, error):
    if name.endswith(".vert"):
        written(tmp_path, name.replace(".vert", ".tri"), "0 1 2\n")
    with pytest.raises(error) as caught:
        read_mesh(written(tmp_path, name, content))
    assert name in str(caught.value)
    assert caught.value.hint


def test_every_truncation_is_an_error_where_a_header_counts_and_else_an_error_or_a_mesh(tmp_path):
    for name, content in valid_files(sphere(0)).items():
        if name.endswith((".mat", ".vert", ".tri")):
            continue
        ends = {"ascii.stl": content.rfind(b"endsolid") + 8, "a.obj": 0}  # of OBJ nothing tells
        complete = ends.get(name, len(content))
        for length in {*range(0, len(content), 7), *range(len(content) - 20, len(content))}:
            part = written(tmp_path, f"part-{name}", content[:length])
            if length < complete:
                with pytest.raises((UnreadableMesh, InvalidMesh), match="part") as caught:
                    read_mesh(part)
                assert caught.value.hint
            else:
                with suppress(UnreadableMesh, InvalidMesh):
                    read_mesh(part)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("number.off", GOOD_OFF[:-1], "its last line does not end, so it may be cut off .if it is whole, add a line"),
        ("fewer.off", GOOD_OFF.replace("4 2 0", "4 3 0"), "4 vertices and 3 faces announced, but 6 lines follow"),
        ("more.off", GOOD_OFF.replace("4 2 0", "4 1 0"), "4 vertices and 1 faces announced, but 6 lines follow"),
        ("more.ply", ply_header("ascii") + PLY_ROWS + b"3 0 1 2\n", "more follows than the header announces"),
        ("number.ply", ply_header("ascii") + PLY_ROWS[:-1], "its last line does not end"),
        ("more-binary.ply", PLY_BINARY + bytes(9), "more follows than the header announces"),
        (
            "open.stl",
            "solid a\n" + "facet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\n",
            "end with 'endsolid'",
        ),
    ],
)
def test_a_count_that_disagrees_with_what_follows_is_named(tmp_path, name, content, reason):
    with pytest.raises(UnreadableMesh, match=f"{name}: not a readable ... file: .*{reason}"):
        read_mesh(written(tmp_path, name, content))


def test_paths_that_cannot_be_read(tmp_path):
    with pytest.raises(UnreadableMesh, match=r"missing\.off: No such file"):
        read_mesh(tmp_path / "missing.off")
    (tmp_path / "folder.off").mkdir()
    with pytest.raises(UnreadableMesh, match=r"folder\.off: Is a directory"):
        read_mesh(tmp_path / "folder.off")
    with pytest.raises(UnreadableMesh, match=r"alone\.tri"):
        read_mesh(written(tmp_path, "alone.vert", "0 0 0\n"))


def test_writing_where_one_cannot(tmp_path):
    mesh = Mesh(SQUARE, FAN)
    with pytest.raises(ConfigurationError, match=r"\.stl"):
        write_mesh(tmp_path / "square.stl", mesh)
    with pytest.raises(ConfigurationError, match="No such file"):
        write_mesh(tmp_path / "nowhere" / "square.off", mesh)
