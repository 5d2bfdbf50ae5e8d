"""glTF 2.0, ``.gltf`` and ``.glb``: the triangles of the default scene, whose vertices count from 0.

What would move or replace them is refused by its name: skins, morph targets, extensions.
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from benchmark.errors import UnreadableMesh
from benchmark.files import parse_json, read_file
from benchmark.formats.base import Format
from benchmark.geometry.mesh import FloatArray, IntArray

Arrays = tuple[FloatArray, IntArray]
Node = dict[str, Any]

#: Extensions that change a surface or replace its data, and beginnings of the names of those that
#: do not.
_UNREAD = (
    *(
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
        "KHR_meshopt_compression",
        "EXT_mesh_gpu_instancing",
    ),
    *("KHR_node_visibility", "KHR_gaussian_splatting"),
)
_HARMLESS = (
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_xmp",
)

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}

#: Most vertices of a scene.
_MOST_VERTICES = 2**24


def read(data: bytes, path: Path) -> Arrays:
    """Return the triangles of the default scene of a file; animations are not played.

    Raises
    ------
    ValueError
        If the file is damaged.
    UnreadableMesh
        If it needs an extension, a skin, morph targets or sparse data, or a buffer is missing; the
        message names it.
    """
    text, binary = _chunks(data) if data[:4] == b"glTF" else (data, None)
    tree = parse_json(text)
    if not isinstance(tree, dict) or not str(tree.get("asset", {}).get("version", "")).startswith(
        "2."
    ):
        raise ValueError("it is not a glTF of version 2")
    unread = [name for name in tree.get("extensionsRequired", []) if not name.startswith(_HARMLESS)]
    if unread := unread or [name for name in _UNREAD if f'"{name}"'.encode() in text]:
        raise UnreadableMesh(
            f"it needs the extension {unread[0]}, which is not read", "export it without"
        )
    file = _File(tree, binary, path)
    vertices, faces, start = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for points, corners in file.surfaces():
        vertices.append(points)
        faces.append(corners + start)
        start += len(points)
        if start > _MOST_VERTICES:
            raise UnreadableMesh(
                f"its scene shows more than {_MOST_VERTICES} vertices", "export one shape"
            )
    return np.concatenate(vertices), np.concatenate(faces)


def buffer_files(path: Path) -> list[Path]:
    """Return the files beside a ``.gltf`` or ``.glb`` file that hold its numbers; none if it cannot be read."""
    try:
        data = read_file(path)
        buffers = parse_json(_chunks(data)[0] if data[:4] == b"glTF" else data).get("buffers", [])
        names = [buffer["uri"] for buffer in buffers if "uri" in buffer]
        return [path.parent / unquote(name) for name in names if not name.startswith("data:")]
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, struct.error):
        return []


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    version, size = struct.unpack_from("<II", data, 4)
    if version != 2 or size > len(data):
        raise ValueError(f"version {version}, {size} bytes announced, but it holds {len(data)}")
    chunks, at = [], 12
    while at + 8 <= size:
        length = struct.unpack_from("<I", data, at)[0]
        if at + 8 + length > size:
            raise ValueError("it ends within a chunk")
        chunks.append(data[at + 8 : at + 8 + length])
        at += 8 + length
    if not chunks:
        raise ValueError("it ends before its first chunk")
    return chunks[0], chunks[1] if len(chunks) > 1 else None


def _matrix(node: Node) -> FloatArray:
    """Return the transform of a node, shape (4, 4), for column vectors."""
    if "matrix" in node:
        matrix: FloatArray = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
        if not np.allclose(matrix[3], (0, 0, 0, 1)) or not node.keys().isdisjoint(
            ("rotation", "scale", "translation")
        ):
            raise ValueError(
                "a node has a matrix that is not affine, or another transform beside it"
            )
        return matrix
    from scipy.spatial.transform import Rotation

    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(node.get("rotation", [0, 0, 0, 1])).as_matrix() * node.get(
        "scale", [1, 1, 1]
    )
    result[:3, 3] = node.get("translation", [0, 0, 0])
    return result


def _placed(nodes: list[Node], roots: Iterable[int]) -> dict[int, FloatArray]:
    """Return the transforms of nodes and all nodes below them."""
    placed: dict[int, FloatArray] = {}
    waiting = [(root, np.eye(4)) for root in roots]
    while waiting:
        number, above = waiting.pop()
        if number in placed:
            raise ValueError(f"node {number} has two parents")
        placed[number] = above @ _matrix(nodes[number])
        waiting += [(child, placed[number]) for child in nodes[number].get("children", [])]
    return placed


class _Items(list[Any]):
    """Objects of one kind by their numbers, of which Python would count negative ones from the end."""

    def __getitem__(self, number: Any) -> Any:
        if number < 0:
            raise ValueError(f"it names an object {number}")
        return super().__getitem__(number)


class _File:
    """The arrays of a file and its surfaces."""

    def __init__(self, tree: dict[str, Any], binary: bytes | None, path: Path) -> None:
        self._tree = {name: _Items(of) if isinstance(of, list) else of for name, of in tree.items()}
        self._binary, self._path = binary, path
        self._read: dict[int, bytes] = {}

    def surfaces(self) -> Iterator[Arrays]:
        """Yield vertices and triangles of each primitive of the default scene, where its node puts them."""
        nodes, scenes = self._tree.get("nodes", []), self._tree.get("scenes", [])
        if len(scenes) > 1 and "scene" not in self._tree:
            raise ValueError(f"it has {len(scenes)} scenes, and none is the default; export one")
        coarser = [
            number
            for node in nodes
            for number in node.get("extensions", {}).get("MSFT_lod", {}).get("ids", [])
        ]
        roots = set(range(len(nodes))) - {*coarser}
        roots -= {child for node in nodes for child in node.get("children", [])}
        shown = scenes[self._tree.get("scene", 0)].get("nodes", []) if scenes else roots
        for number, transform in _placed(nodes, shown).items():
            node = nodes[number]
            mesh = self._tree["meshes"][node["mesh"]] if "mesh" in node else {"primitives": []}
            if "skin" in node or any(node.get("weights", mesh.get("weights", []))):
                poser = "skin" if "skin" in node else "weights"
                raise UnreadableMesh(
                    f"'{poser}', which poses a mesh, is not read",
                    "apply the pose, and export again",
                )
            for primitive in mesh["primitives"]:
                vertices = self._accessor(primitive["attributes"]["POSITION"])
                given = primitive.get("indices")
                corners = np.arange(len(vertices)) if given is None else self._accessor(given)[:, 0]
                if (mode := primitive.get("mode", 4)) not in range(5):
                    raise UnreadableMesh(
                        f"primitives of mode {mode} are not read", "export triangles, mode 4"
                    )
                faces = corners.astype(np.int64)[: len(corners) if mode == 4 else 0].reshape(
                    -1, 3
                )  # of points, none
                faces = faces[:, ::-1] if np.linalg.det(transform) < 0 else faces
                yield vertices @ transform[:3, :3].T + transform[:3, 3], faces

    def _accessor(self, number: int) -> FloatArray:
        """Return the numbers behind an accessor, shape (count, width)."""
        accessor = self._tree["accessors"][number]
        if "sparse" in accessor or "bufferView" not in accessor:
            problem = "is sparse, which is not read" if "sparse" in accessor else "has no data"
            raise UnreadableMesh(f"accessor {number} {problem}", "export it in full")
        kind, shape = (
            np.dtype(_TYPES[accessor["componentType"]]),
            (accessor["count"], _WIDTHS[accessor["type"]]),
        )
        view = self._tree["bufferViews"][accessor["bufferView"]]
        start, size = view.get("byteOffset", 0), view["byteLength"]
        width, offset = kind.itemsize * shape[1], accessor.get("byteOffset", 0)
        stride = view.get("byteStride", width)
        window = self._buffer(view["buffer"])[start : start + size]
        if stride < width or len(window) < max(size, offset + stride * (shape[0] - 1) + width):
            raise ValueError(f"buffer {view['buffer']} is cut off")
        result = np.ndarray(shape, kind, window, offset, (stride, kind.itemsize)).astype(np.float64)
        if accessor.get("normalized") and kind.kind != "f":
            result = np.maximum(result / np.iinfo(kind).max, -1)
        return result

    def _buffer(self, number: int) -> bytes:
        if number not in self._read:
            buffer = self._tree["buffers"][number]
            uri = buffer.get("uri")
            if uri is None:
                found = self._binary if number == 0 else None
            elif uri.startswith("data:"):
                found = base64.b64decode(unquote(uri.partition(",")[2]), validate=True)
            elif self._path.suffix.lower() == ".gz":
                raise UnreadableMesh(f"its buffer {uri} is not packed with it", "unpack it")
            else:
                found = self._beside(unquote(uri))
            if found is None or len(found) < buffer["byteLength"]:
                raise ValueError(
                    f"buffer {number} holds {len(found or b'')} of {buffer['byteLength']} bytes"
                )
            self._read[number] = found
        return self._read[number]

    def _beside(self, name: str) -> bytes:
        try:
            return read_file(self._path.parent / name)
        except OSError as error:
            hint = "put that file beside it, or export a .glb"
            raise UnreadableMesh(f"its buffer {name}: {error.strerror}", hint) from error


FORMAT = Format(
    module=__name__,
    extensions=(".glb", ".gltf"),
    first_vertex=0,
    read=read,
    files_beside=buffer_files,
    extensions_beside=(".bin",),
    preference=6,
)
