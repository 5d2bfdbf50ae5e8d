"""Mesh files as text: without a last line break they are read and named; what counts or lines
contradict is refused.
"""

import numpy as np
import pytest

from benchmark.datasets.mesh_files import lacks_last_break, read_mesh, write_mesh
from benchmark.errors import InvalidMesh, UnreadableMesh
from tests.toy import rod, write_off
from tests.verbs import call

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
POINTS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\n"
    "property float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
)
TEXTS = {
    "a.off": f"OFF\n4 2 0\n{POINTS}3 0 1 2\n3 0 2 3\n",
    "a.obj": "".join(f"v {line}\n" for line in POINTS.splitlines()) + "f 1 2 3\nf 1 3 4\n",
    "a.ply": f"{PLY}{POINTS}3 0 1 2\n3 0 2 3\n",
}


@pytest.mark.parametrize("end", ["", "  ", "\t"])
@pytest.mark.parametrize("name", TEXTS)
def test_text_without_a_last_line_break_is_read_and_told_from_whole_text(name, end, tmp_path):
    path = tmp_path / name
    for content, lacks in ((TEXTS[name], False), (TEXTS[name].rstrip() + end, True)):
        path.write_text(content)
        mesh = read_mesh(path)
        np.testing.assert_array_equal(mesh.vertices, SQUARE)
        np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3]])
        assert lacks_last_break(path) is lacks


@pytest.mark.parametrize("name", TEXTS)
def test_a_cut_anywhere_before_the_last_number_is_refused(name, tmp_path):
    path = tmp_path / name
    whole = TEXTS[name].rstrip()
    first = 1 + whole.index("\n", whole.index("v 0 1") if name == "a.obj" else 0)
    for end in range(first, len(whole)):
        path.write_text(whole[:end])
        if whole[:end].endswith("\n") and name == "a.obj":
            continue  # a whole line may be the last one of a format without counts
        with pytest.raises((UnreadableMesh, InvalidMesh)):
            read_mesh(path)


def test_triangles_beside_vertices_may_lack_a_last_line_break_but_no_vertex(tmp_path):
    (tmp_path / "a.vert").write_text(POINTS.rstrip())
    (tmp_path / "a.tri").write_text("1 2 3\n1 3 4")
    assert read_mesh(tmp_path / "a.vert").n_faces == 2
    assert lacks_last_break(tmp_path / "a.vert")
    assert lacks_last_break(tmp_path / "a.tri")
    (tmp_path / "a.tri").write_text("1 2 3")
    with pytest.raises(UnreadableMesh, match="vertices have no face: it may be cut off"):
        read_mesh(tmp_path / "a.vert")


def test_binary_files_lack_no_line_break(tmp_path):
    for name in ("a.ply", "a.off"):
        write_mesh(tmp_path / name, rod(0.1, 1))
        assert not lacks_last_break(tmp_path / name)
    (tmp_path / "a.obj").write_bytes(b"\x1f\x8b")
    (tmp_path / "a.off.gz").write_bytes(b"no archive")
    assert not lacks_last_break(tmp_path / "a.off.gz")
    assert not lacks_last_break(tmp_path / "missing.off")


@pytest.fixture
def rods(tmp_path):
    for number in range(3):
        for kind, size in (("thin", 0.5), ("thick", 1.0)):
            write_off(tmp_path / f"{kind}{number}.off", rod(0.1, size + number / 10))
    return tmp_path


def test_data_check_and_a_run_name_text_without_a_last_line_break(rods):
    for name in ("thin1.off", "thick2.off"):
        (rods / name).write_bytes((rods / name).read_bytes().rstrip())
    said = (
        "2 files: thick2.off, thin1.off  text without a last line break: "
        "its last number may be cut off"
    )
    checked = call("data", "check", rods)
    assert f"warning  {said}" in checked.replace("thin1.off, thick2.off", "thick2.off, thin1.off")
    assert "0 errors, 2 warnings" in checked


def test_data_check_says_how_many_faces_without_corners_are_dropped(rods):
    for name, count in (("thin0.off", 1), ("thick1.off", 3)):
        content = (rods / name).read_text().split("\n")
        vertices, faces, edges = content[1].split()
        content[1] = f"{vertices} {int(faces) + count} {edges}"
        before = read_mesh(rods / name)
        (rods / name).write_text("\n".join([*content[:-1], *["0"] * count, ""]))
        np.testing.assert_array_equal(read_mesh(rods / name).faces, before.faces)
    said = call("data", "check", rods)
    assert "1 to 3 faces without corners; reading drops them" in said
    assert "0 errors, 2 warnings" in said


def test_data_check_says_the_range_of_counts_of_several_files(rods):
    for name, turned in (("thin0.off", 1), ("thin1.off", 5), ("thick0.off", 3)):
        mesh = read_mesh(rods / name)
        faces = mesh.faces.copy()
        faces[:turned] = faces[:turned, ::-1]
        write_off(rods / name, type(mesh)(mesh.vertices, faces))
    lines = [line for line in call("data", "check", rods).splitlines() if "the other way" in line]
    assert len(lines) == 1
    assert lines[0].startswith("warning  3 files: thin1.off, ")
    assert "1 to 5 faces the other way round" in lines[0]


LINES = (
    "solid a facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 "
    "endloop endfacet endsolid a\n"
)
PACKED = "".join(f"{line} 16711680\n" for line in POINTS.splitlines())
NORMALS = "".join(f"{line} 0.1 0.2 0.3\n" for line in POINTS.splitlines())
ROWS = "its rows are not those that its header announces"
FACES = "element face 2\nproperty list uchar int vertex_indices\n"
NORMAL = "\nproperty float nx"  # and neither ny nor nz
HINTS = {
    "one line.stl": (LINES, "its line breaks are missing; write each facet"),
    "binary.off": ("OFF BINARY\n\0\0\0\4", "binary OFF is not read; export it as text"),
    "dimension.off": (
        f"nOFF\n3\n4 1 0\n{POINTS}3 0 1 2\n",
        "n-dimensional OFF is not read; export",
    ),
    "order.off": ("NSTOFF\n1 0 0\n0 0 0\n", r"OFF \(or with ST, C and N before it, in"),
    "homogeneous.off": ("4OFF\n1 0 0\n0 0 0 1\n", "n-dimensional OFF is not read"),
    "colours.off": (f"COFF\n4 1 0\n{PACKED}3 0 1 2\n", "packed colour; export it without colours"),
    "packed.off": (f"OFF\n4 1 0\n{PACKED}3 0 1 2\n", "packed colour; export it without colours"),
    "points.ply": (PLY.replace(FACES, "") + POINTS, "there are no faces; make a surface of"),
    "rows.ply": (f"{PLY.replace('z', 'z' + NORMAL)}{NORMALS}3 0 1 2\n3 0 2 3\n", ROWS),
    "no corner.ply": (f"{PLY}{POINTS}0\n0\n", "there are no faces; make a surface of"),
    "no corner.off": (f"OFF\n4 2 0\n{POINTS}0\n0\n", "there are no faces; make a surface of"),
    "zeroed.off": (f"OFF\n4 2 0\n{POINTS}0 0 1 2\n3 0 2 3\n", "face 1 of 2 has 3 corners, not 0"),
    "one corner.ply": (f"{PLY}{POINTS}3 0 1 2\n1 0\n", "face 2 of 2 has 1 corner; drop faces"),
}  # fmt: skip


@pytest.mark.parametrize("name", HINTS)
def test_what_is_not_read_says_what_to_do(name, tmp_path):
    content, said = HINTS[name]
    (tmp_path / name).write_text(content)
    with pytest.raises((UnreadableMesh, InvalidMesh), match=f"{name}: .*{said}"):
        read_mesh(tmp_path / name)
