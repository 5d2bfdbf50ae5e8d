"""Features of glTF: each is read as the format defines it, or refused by its name."""

from __future__ import annotations

import base64
import gzip
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark.api.datasets import Entry
from benchmark.datasets.mesh_files import digest_of_entry, read_mesh
from benchmark.errors import InvalidMesh, UnreadableMesh
from benchmark.files import file_digest
from benchmark.formats.gltf import buffer_files
from benchmark.geometry.mesh import Mesh
from tests.geometry.test_files import FAN, INPUTS, SQUARE

KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


class File:
    """A square, with what a test adds; accessors are numbered as they are added."""

    def __init__(self, kind: str = "f4", **primitive: Any) -> None:
        self.data = b""
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
        }
        self.tree |= {"nodes": [{"mesh": 0}], "bufferViews": [], "accessors": []}
        position = self.add(
            (SQUARE * (1 if kind == "f4" else np.iinfo(kind).max)).astype(kind),
            normalized=kind != "f4",
        )
        indices = self.add(FAN.astype("u2").reshape(-1, 1))
        self.primitive = {"attributes": {"POSITION": position}, "indices": indices} | primitive
        self.mesh: dict[str, Any] = {"primitives": [self.primitive]}
        self.tree["meshes"] = [self.mesh]
        self.node = self.tree["nodes"][0]

    def add(self, array: Any, kind: str = "", **accessor: Any) -> int:
        array = np.asarray(array, dtype=kind or None)
        described = {"bufferView": self.view(array), "componentType": KINDS[array.dtype.str[1:]]}
        self.tree["accessors"].append(
            {**described, "count": len(array), "type": TYPES[array.shape[1]], **accessor}
        )
        return len(self.tree["accessors"]) - 1

    def view(self, array: np.ndarray) -> int:
        self.tree["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        )
        self.data += array.tobytes() + bytes(-array.nbytes % 4)
        return len(self.tree["bufferViews"]) - 1

    def read(self, folder: Path, suffix: str = ".gltf") -> Mesh:
        path = folder / f"x{suffix}"
        buffer: dict[str, Any] = {"byteLength": len(self.data)}
        self.tree.setdefault("buffers", [buffer])
        if suffix == ".gltf":
            buffer["uri"] = (
                "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
            )
            path.write_text(json.dumps(self.tree))
        else:
            text = json.dumps(self.tree).encode()
            text += b" " * (-len(text) % 4)
            chunks = (
                struct.pack("<I4s", len(text), b"JSON")
                + text
                + struct.pack("<I4s", len(self.data), b"BIN\0")
                + self.data
            )
            path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return read_mesh(path)


def test_a_file_of_another_program() -> None:
    mesh = read_mesh(INPUTS / "quant-two.gltf")
    assert (mesh.n_faces, mesh.area) == (24, pytest.approx(12, abs=1e-3))
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [4, 1, 1])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_normalised_integers_are_divided_by_their_largest(
    tmp_path: Path, kind: str, suffix: str
) -> None:
    mesh = File(kind).read(tmp_path, suffix)
    np.testing.assert_allclose(mesh.vertices, SQUARE)
    np.testing.assert_array_equal(mesh.faces, FAN)


def test_the_lowest_normalised_integer_is_minus_one_and_others_keep_their_unit(
    tmp_path: Path,
) -> None:
    file = File()
    file.primitive["attributes"]["POSITION"] = file.add(
        [[-128, 0, 0], [127, 0, 0], [0, 127, 0], [0, 0, 127]], "i1", normalized=True
    )
    assert file.read(tmp_path).vertices.min() == -1
    file.tree["accessors"][-1]["normalized"] = False
    assert file.read(tmp_path).vertices.min() == -128


@pytest.mark.parametrize("beside", [0, 1, 2, 3])
def test_points_and_lines_have_no_surface(tmp_path: Path, beside: int) -> None:
    file = File()
    file.mesh["primitives"].append({**file.primitive, "mode": beside})
    np.testing.assert_array_equal(file.read(tmp_path).faces, FAN)
    file.mesh["primitives"].pop(0)
    with pytest.raises(InvalidMesh, match="there are no faces"):
        file.read(tmp_path)


def test_without_indices_and_with_a_stride(tmp_path: Path) -> None:
    file = File()
    file.primitive.pop("indices")
    rows = np.hstack([SQUARE[FAN.ravel()], np.full((6, 1), 9.0)]).astype("f4")
    file.primitive["attributes"]["POSITION"] = file.add(rows, type="VEC3")
    file.tree["bufferViews"][-1]["byteStride"] = 16
    mesh = file.read(tmp_path)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], SQUARE[FAN])


def test_morph_targets_without_weight_are_left_out(tmp_path: Path) -> None:
    file = File()
    file.primitive["targets"] = [{"POSITION": 0}]
    file.mesh["weights"], file.node["weights"] = [1], [0]
    np.testing.assert_allclose(file.read(tmp_path).vertices, SQUARE)


def test_nodes_move_turn_scale_and_mirror_what_is_below_them(tmp_path: Path) -> None:
    file = File()
    turn = {
        "translation": [1, 2, 3],
        "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)],
        "scale": [2, 1, 1],
    }
    matrix = np.diag([1.0, 1, 5, 1])
    matrix[:3, 3] = 0, 0, 1
    file.tree["nodes"] = [
        {"children": [1], **turn},
        {"children": [2], "matrix": matrix.T.ravel().tolist()},
        {"mesh": 0},
    ]
    expected = SQUARE @ np.diag([2, 1, 1]) @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] + [1, 2, 4]
    np.testing.assert_allclose(file.read(tmp_path).vertices, expected, atol=1e-7)
    file.tree["nodes"][0] = {"children": [1], "scale": [-1, 1, 1]}
    mirrored = file.read(tmp_path)
    normal = np.cross(*np.diff(mirrored.vertices[mirrored.faces[0]], axis=0))
    assert normal[2] > 0


def test_only_the_default_scene_is_shown(tmp_path: Path) -> None:
    file = File()
    file.tree["nodes"].append({"mesh": 0, "translation": [5, 0, 0]})
    file.tree["scenes"].append({"nodes": [1]})
    assert file.read(tmp_path).vertices.max() == 1
    file.tree["scene"] = 1
    assert file.read(tmp_path).vertices.min(axis=0)[0] == 5
    file.tree.pop("scene")
    with pytest.raises(UnreadableMesh, match="it has 2 scenes, and none is the default"):
        file.read(tmp_path)
    file.tree.pop("scenes")
    assert file.read(tmp_path).n_faces == 4


#: Edits of a file that is refused then, and what the error says.
REFUSED = dict(
    line.split("  ", 1) for line in (INPUTS / "refused-gltf.txt").read_text().splitlines()
)


@pytest.mark.parametrize("change", REFUSED)
def test_what_is_not_read_is_refused_by_its_name(tmp_path: Path, change: str) -> None:
    file = File()
    exec(change, {"file": file, "tree": file.tree})  # noqa: S102
    with pytest.raises((UnreadableMesh, InvalidMesh), match=REFUSED[change]) as caught:
        file.read(tmp_path)
    assert "\n" not in str(caught.value)


def test_buffers_beside_a_file_are_read_and_belong_to_it(tmp_path: Path) -> None:
    file = File()
    file.tree["buffers"] = [{"byteLength": len(file.data), "uri": "a%20b.bin"}]
    (tmp_path / "a b.bin").write_bytes(file.data)
    np.testing.assert_allclose(file.read(tmp_path).vertices, SQUARE)
    assert buffer_files(tmp_path / "x.gltf") == [tmp_path / "a b.bin"]
    assert buffer_files(tmp_path / "none.gltf") == []
    file.read(tmp_path, ".glb")
    assert buffer_files(tmp_path / "x.glb") == [tmp_path / "a b.bin"]
    (tmp_path / "x.gltf.gz").write_bytes(gzip.compress((tmp_path / "x.gltf").read_bytes()))
    with pytest.raises(UnreadableMesh, match="buffer a%20b.bin is not packed with it; unpack it"):
        read_mesh(tmp_path / "x.gltf.gz")
    entry = Entry("x", "x", "", tmp_path / "x.gltf")
    before = digest_of_entry(entry)
    (tmp_path / "a b.bin").write_bytes(bytes(len(file.data)))
    assert digest_of_entry(entry) != before


@pytest.mark.parametrize("name", ["a%00b.bin", "\ud800.bin"])
def test_a_buffer_of_a_name_that_no_file_can_have_is_refused_with_its_mesh(
    tmp_path: Path, name: str
) -> None:
    file = File()
    file.tree["buffers"] = [{"byteLength": len(file.data), "uri": name}]
    with pytest.raises(UnreadableMesh, match="not a readable gltf file"):
        file.read(tmp_path)
    path = tmp_path / "x.gltf"
    assert digest_of_entry(Entry("x", "x", "", path)) == file_digest(path)


def test_a_scene_of_more_vertices_than_a_file_can_hold_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = File()
    file.tree["nodes"] = [{"mesh": 0}] * 5
    file.tree["scenes"] = [{"nodes": [0, 1, 2, 3, 4]}]
    monkeypatch.setattr("benchmark.formats.gltf._MOST_VERTICES", 19)
    with pytest.raises(UnreadableMesh, match="its scene shows more than 19 vertices or "):
        file.read(tmp_path)
    monkeypatch.setattr("benchmark.formats.gltf._MOST_VERTICES", 20)
    assert file.read(tmp_path).n_faces == 10
    monkeypatch.setattr("benchmark.formats.gltf._MOST_TRIANGLES", 9)
    with pytest.raises(UnreadableMesh, match="more than 20 vertices or 9 triangles; export one"):
        file.read(tmp_path)


def test_a_corner_is_a_vertex_of_its_own_part(tmp_path: Path) -> None:
    """The vertices of the next part follow in the joined mesh."""
    file = File()
    corners = file.add([[0], [1], [5]], "u2")
    file.mesh["primitives"].insert(0, {**file.primitive, "indices": corners})
    with pytest.raises(InvalidMesh, match="faces name vertices 0 to 5, but there are 0 to 3"):
        file.read(tmp_path)
