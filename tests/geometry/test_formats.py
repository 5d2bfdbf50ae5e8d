"""Readers against damaged and hostile files: a named error or a mesh, in time and memory that the file accounts for."""

import struct
import time
import tracemalloc
import zlib

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from benchmark.errors import InvalidMesh, UnreadableMesh
from benchmark.geometry.io import read_mesh
from benchmark.geometry.mesh import Mesh
from tests.geometry.mutations import mat, mutations, valid_files
from tests.geometry.surfaces import sphere

BALL = sphere(1)
FILES = valid_files(BALL)
NAMES = sorted(FILES)


def read(folder, name, content, companions=FILES):
    """Read a file; the other half of a .vert/.tri pair lies beside it."""
    for other in ("a.vert", "a.tri"):
        (folder / other).write_bytes(companions[other])
    (folder / name).write_bytes(content)
    return read_mesh(folder / name.replace(".tri", ".vert"))


def corner_positions(mesh):
    return mesh.vertices[mesh.faces]


@pytest.mark.parametrize("name", NAMES)
def test_every_format_gives_the_mesh_that_was_written(tmp_path, name):
    mesh = read(tmp_path, name, FILES[name])
    tolerance = 1e-7 if name.endswith(".stl") else 0
    np.testing.assert_allclose(corner_positions(mesh), corner_positions(BALL), rtol=0, atol=tolerance)
    if not name.endswith(".stl"):
        assert mesh.vertices.tobytes() == BALL.vertices.tobytes()
        assert mesh.faces.tobytes() == BALL.faces.tobytes()


def assert_named_or_a_mesh(folder, name, content):
    try:
        mesh = read(folder, name, content)
    except (UnreadableMesh, InvalidMesh) as error:
        file = name if str(folder / name) in error.problem else name.replace(".tri", ".vert")
        assert error.problem.startswith(f"{folder / file}: ")
        assert error.hint
        assert len(error.problem) < len(str(folder)) + 300
        return False
    assert isinstance(mesh, Mesh)
    assert mesh.n_faces <= len(content) + len(FILES["a.tri"])
    return True


def damage(folder, name, count, seed=0):
    start = time.process_time()
    survivors = sum(assert_named_or_a_mesh(folder, name, content) for content in mutations(FILES[name], count, seed))
    assert time.process_time() - start < 0.1 * count + 5
    return survivors


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_is_a_named_error_or_a_mesh(tmp_path, name):
    survivors = damage(tmp_path, name, 80)
    assert survivors < 80


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", NAMES)
def test_thousands_of_damaged_files_are_named_errors_or_meshes(tmp_path, name):
    damage(tmp_path, name, 4000, seed=1)


MILLION = 10**6


def hostile():
    """Files of about a megabyte that cost minutes or gigabytes where a reader believes them, by name."""
    newlines = b"\n" * MILLION
    head = "ply\nformat {} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    faces = "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
    extra = "element strip {}\nproperty list uchar int items\n"
    points = np.eye(3, dtype="<f4").tobytes()
    little = head.format("binary_little_endian")
    return {
        "newlines.stl": b"solid vertex" + newlines,
        "newlines-between.stl": b"solid a\n" + newlines + b"vertex 0 0 0\nendfacet\n",
        "spaces.stl": b"solid vertex" + b" " * MILLION + b"x",
        "count.stl": b" " * 80 + struct.pack("<I", 2**32 - 1) + bytes(1000),
        "newlines.off": b"OFF\n3 1 0\n" + newlines,
        "spaces.off": b"OFF" + b" " * MILLION,
        "digits.off": b"OFF " + b"9" * MILLION,
        "count.off": b"OFF\n999999999999 999999999999 0\n0 0 0\n",
        "comments.off": b"#\n" * (MILLION // 2),
        "no-corners.off": b"OFF\n3 400000 0\n0 0 0\n0 0 1\n0 1 0\n" + b"0\n" * 400_000,
        "newlines.obj": b"v 0 0 0\nf " + newlines,
        "slashes.obj": b"v 0 0 0\nf " + b"/" * MILLION,
        "continued.obj": b"v 0 0 0\nf 1 1 9" + b"\\\n" * (MILLION // 2),
        "ascii-no-corners.ply": (head.format("ascii") + faces.format(400_000)).encode()
        + b"0 0 0\n0 0 1\n0 1 0\n"
        + b"0\n" * 400_000,
        "ascii-count.ply": (head.format("ascii") + faces.format(10**17)).encode() + b"0 0 0\n0 0 1\n0 1 0\n",
        "digits.ply": (head.format("ascii") + faces.format("9" * MILLION)).encode() + b"0 0 0\n" * 3,
        "no-corners.ply": (little + faces.format(MILLION)).encode() + points + bytes(MILLION),
        "no-items.ply": (little + extra.format(200_000) + faces.format(1)).encode() + points + bytes(200_000),
        "count.ply": (little + faces.format(10**17)).encode() + points + bytes(100),
        "long-list.ply": (little + faces.format(1).replace("uchar", "uint")).encode() + points + b"\xff" * 100,
        "negative-list.ply": (little + faces.format(9).replace("uchar", "char")).encode() + points + b"\xff" * 100,
        "no-properties.ply": b"ply\nformat binary_little_endian 1.0\nelement a 99999999999999999\nend_header\n",
        "elements.ply": b"ply\nformat binary_little_endian 1.0\n"
        + b"".join(b"element e%d 0\nproperty int a\n" % at for at in range(20_000))
        + b"end_header\n"
        + bytes(MILLION),
        "no-header.ply": b"ply\n" + newlines,
        "bomb.mat": bomb,
        "size.mat": oversized_mat(),
    }


def bomb(size=200 * MILLION):
    """A compressed variable of zeros, which takes most of a second to make."""
    packed = zlib.compress(struct.pack("<II", 14, size) + bytes(size), 9)
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(packed)) + packed


def oversized_mat():
    """X announces 2**31 - 1 rows."""
    whole = FILES["plain.mat"]
    size = struct.pack("<ii", BALL.n_vertices, 1)
    assert whole.count(size) == 3
    return whole.replace(size, struct.pack("<ii", 2**31 - 1, 1), 1)


HOSTILE = hostile()


@pytest.mark.parametrize("name", sorted(HOSTILE))
def test_a_hostile_file_is_refused_in_time_and_memory_of_its_size(tmp_path, name):
    content = HOSTILE[name]() if callable(HOSTILE[name]) else HOSTILE[name]
    (tmp_path / name).write_bytes(content)
    tracemalloc.start()
    start = time.process_time()
    try:
        with pytest.raises((UnreadableMesh, InvalidMesh), match=name):
            read_mesh(tmp_path / name)
        seconds = time.process_time() - start
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert seconds < 20  # with every allocation traced; minutes or hours where the cost is quadratic
    assert peak < 250 * len(content) + 2**22


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("underscore.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 0_2\n"),
        ("underscore-coordinate.off", b"OFF\n3 1 0\n0 0 0\n1_0 0 0\n0 1 0\n3 0 1 2\n"),
        ("shifted.off", b"OFF\n3 1 0\n0 0\n1 0 0 0\n0 1 0\n3 0 1 2\n"),
        ("script.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 ١ 0\n3 0 1 2\n".encode()),
        ("underscore.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0_3\n"),
        ("beyond-negative.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n"),
        ("zero-and-negative.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 2 -1\n"),
        ("negative.ply", FILES["ascii.ply"].replace(b"7 3 ", b"7 -3 ", 1)),
        ("negative-corner.ply", FILES["ascii.ply"].replace(b"7 3 0 37 16", b"7 3 -1 37 16")),
        ("twice.ply", FILES["ascii.ply"].replace(b"element face", b"element vertex")),
        ("underscore.stl", FILES["ascii.stl"].replace(b"vertex ", b"vertex 0_", 1)),
        (
            "lengths.mat",
            mat({"X": np.zeros(3), "Y": np.zeros(4), "Z": np.zeros(3), "TRIV": [[1, 2, 3]]}, compressed=True),
        ),
        ("text.mat", mat(dict.fromkeys("XYZ", "abc") | {"TRIV": [[1, 2, 3]]}, compressed=True)),
        ("fields.mat", mat({"X": np.zeros(3)}, compressed=False)),
        ("hdf5.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF"),
    ],
)
def test_what_is_no_number_of_a_mesh_is_refused_not_cast(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises((UnreadableMesh, InvalidMesh), match=name):
        read_mesh(tmp_path / name)


@pytest.mark.parametrize(("kind", "compressed"), [("f8", False), ("f4", True), ("u2", True)])
def test_mat_files_are_read_as_scipy_reads_them(tmp_path, kind, compressed):
    random = np.random.default_rng(3)
    fields = {
        "name": "cat",
        "X": random.integers(0, 200, (1, 9)).astype(kind),
        "Y": random.integers(0, 200, (9, 1)).astype(kind),
        "Z": random.integers(0, 200, 9).astype(kind),
        "TRIV": random.integers(1, 10, (5, 3)).astype(kind),
        "more": {"inner": [1, 2, 3]},
    }
    path = tmp_path / "mixed.mat"
    savemat(path, {"before": np.arange(9), "surface": fields, "after": "x"}, do_compression=compressed)
    surface = loadmat(path, squeeze_me=True, struct_as_record=False)["surface"]
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, np.stack([surface.X, surface.Y, surface.Z], axis=1).astype(float))
    np.testing.assert_array_equal(mesh.faces, surface.TRIV.astype(int) - 1)
