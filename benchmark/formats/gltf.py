"""glTF 2.0, ``.gltf`` and ``.glb``: the triangles of the default scene.

Vertices count from 0. What would move or replace them is refused by its name: skins, morph targets,
extensions.
"""

from __future__ import annotations

import base64
import os
import struct
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import UnreadableMesh
from benchmark.files import parse_json, read_file
from benchmark.formats.ascii import whole_numbers
from benchmark.formats.base import Format
from benchmark.formats.polygons import count_from_0
from benchmark.geometry.mesh import FloatArray, IntArray

#: Vertices and triangles.
Surface = tuple[FloatArray, IntArray]
#: An object of the scene in the file.
Node = dict[str, Any]

#: Extensions that change a surface or replace its data.
_UNREAD = (
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "EXT_mesh_gpu_instancing",
    "KHR_node_visibility",
    "KHR_gaussian_splatting",
)

#: Beginnings of the names of those that do not.
_HARMLESS = (
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_xmp",
)

#: Types of numbers by their codes, as numpy writes them.
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}

#: Numbers of an item by its type.
_WIDTHS = {"SCALAR": 1, "VEC3": 3}

#: Most vertices of a scene, and most triangles: nodes may show a mesh any number of times.
_MOST_VERTICES = 2**24
_MOST_TRIANGLES = 2**25

#: Bytes at the beginning of a binary file.
_MAGIC = b"glTF"

#: Bytes of the header of a binary file, and of the header of each of its chunks.
_FILE_HEADER = 12
_CHUNK_HEADER = 8

#: Mode of primitives that are triangles; those of smaller modes are points and lines.
_TRIANGLES = 4


def read(data: bytes, path: Path) -> Surface:
    """Return the vertices and triangles of the default scene of a glTF file.

    Nodes stand where their transforms place them; animations are not played.

    Parameters
    ----------
    data
        Bytes of the file, as text (``.gltf``) or binary (``.glb``).
    path
        The file, beside which its buffers lie.

    Raises
    ------
    ValueError
        If the file is damaged.
    UnreadableMesh
        If it needs an extension, a skin, morph targets or sparse data, or a buffer is missing; the
        message names it.
    """
    text, binary = _chunks(data)
    tree = parse_json(text)
    if not isinstance(tree, dict) or not _version_of(tree).startswith("2."):
        raise ValueError("it is not a glTF of version 2")
    _check_extensions(tree, text)
    return _joined(_File(tree, binary, path).surfaces())


def _check_extensions(tree: Mapping[str, Any], text: bytes) -> None:
    """Raise ``UnreadableMesh`` if a file needs or uses an extension without which it has no shape.

    Parameters
    ----------
    tree
        Description of the file.
    text
        The same as JSON, in which an extension may be named anywhere.
    """
    required = tree.get("extensionsRequired", [])
    unread = [name for name in required if not name.startswith(_HARMLESS)]
    unread += [name for name in _UNREAD if f'"{name}"'.encode() in text]
    if unread:
        problem = f"it needs the extension {unread[0]}, which is not read"
        raise UnreadableMesh(problem, "export it without")


def _joined(surfaces: Iterable[Surface]) -> Surface:
    """Return several surfaces as one: all vertices, and all faces with new numbers of vertices.

    Raises
    ------
    UnreadableMesh
        If they have more than :data:`_MOST_VERTICES` vertices together, or more than
        :data:`_MOST_TRIANGLES` triangles.
    """
    vertices = [np.empty((0, 3))]
    faces = [np.empty((0, 3), dtype=np.int64)]
    n_vertices = 0
    n_triangles = 0
    for points, corners in surfaces:
        vertices.append(points)
        faces.append(corners + n_vertices)
        n_vertices += len(points)
        n_triangles += len(corners)
        if n_vertices > _MOST_VERTICES or n_triangles > _MOST_TRIANGLES:
            problem = (
                f"its scene shows more than {_MOST_VERTICES} vertices"
                f" or {_MOST_TRIANGLES} triangles"
            )
            raise UnreadableMesh(problem, "export one shape")
    return np.concatenate(vertices), np.concatenate(faces)


def _version_of(tree: dict[str, Any]) -> str:
    """Return the version of glTF that a file states; "" without one."""
    return str(tree.get("asset", {}).get("version", ""))


def buffer_files(path: Path) -> list[Path]:
    """Return the files beside a ``.gltf`` or ``.glb`` file that hold its numbers.

    There are none if it cannot be read.
    """
    try:
        text, _ = _chunks(read_file(path))
        buffers = parse_json(text).get("buffers", [])
        uris = [buffer["uri"] for buffer in buffers if "uri" in buffer]
        names = [unquote(uri) for uri in uris if not uri.startswith("data:")]
        return [path.parent / name for name in names if _can_be_name(name)]
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, struct.error):
        return []


def _can_be_name(name: str) -> bool:
    """Return whether a file can have a name; the reader says what is wrong with any other."""
    try:
        return b"\0" not in os.fsencode(name)
    except UnicodeError:
        return False


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """Split a glTF file into its description and its numbers.

    A text file holds the description alone. A binary file (GLB) has a header, then a chunk with the
    description, then one with numbers. Before each chunk stands its length.

    Returns
    -------
    text : bytes
        The description, as JSON.
    binary : bytes or None
        The numbers of a binary file; None if there are none.

    Raises
    ------
    ValueError
        If a binary file is of another version or cut off.
    """
    if not data.startswith(_MAGIC):
        return data, None
    version, size = struct.unpack_from("<II", data, 4)
    if version != 2 or size > len(data):
        raise ValueError(f"version {version}, {size} bytes announced, but it holds {len(data)}")
    chunks = []
    position = _FILE_HEADER  # lengths of headers in bytes
    while position + _CHUNK_HEADER <= size:
        (length,) = struct.unpack_from("<I", data, position)
        start = position + _CHUNK_HEADER
        end = start + length
        if end > size:
            raise ValueError("it ends within a chunk")
        chunks.append(data[start:end])
        position = end
    if not chunks:
        raise ValueError("it ends before its first chunk")
    text, *further = chunks
    binary = further[0] if further else None
    return text, binary


def _matrix(node: Node) -> FloatArray:
    """Return the transform of a node relative to its parent, shape (4, 4), for column vectors.

    Parameters
    ----------
    node
        It holds a ``matrix``, column by column, or a ``translation``, a ``rotation`` as quaternion
        and a ``scale``, which is applied first.

    Raises
    ------
    ValueError
        If it holds both, or the matrix is not affine.
    """
    if "matrix" not in node:
        return _composed(node)
    matrix: FloatArray = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    is_affine = np.allclose(matrix[3], (0, 0, 0, 1))
    if not is_affine or not node.keys().isdisjoint(("rotation", "scale", "translation")):
        problem = "a node has a matrix that is not affine, or another transform beside it"
        raise ValueError(problem)
    return matrix


def _composed(node: Node) -> FloatArray:
    """Return the matrix that scales, then rotates, then translates as a node says, shape (4, 4)."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_quat(node.get("rotation", [0, 0, 0, 1])).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * node.get("scale", [1, 1, 1])
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


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
    """Objects of one kind by their numbers; Python would count negative ones from the end."""

    def __getitem__(self, number: Any) -> Any:
        if type(number) is not int or not 0 <= number < len(self):
            raise ValueError(f"it names an object {number!r:.40}, and has {len(self)} of its kind")
        return super().__getitem__(number)


class _File:
    """The arrays of a file and its surfaces."""

    def __init__(self, tree: dict[str, Any], binary: bytes | None, path: Path) -> None:
        self._tree: dict[str, Any] = {}
        for name, value in tree.items():
            self._tree[name] = _Items(value) if isinstance(value, list) else value
        self._binary = binary
        self._path = path
        self._read: dict[int, bytes] = {}

    def surfaces(self) -> Iterator[Surface]:
        """Yield vertices and triangles of each part of the default scene, in world coordinates.

        Raises
        ------
        UnreadableMesh
            If a node is posed by a skin or by morph targets.
        """
        nodes = self._tree.get("nodes", _Items())
        for number, transform in _placed(nodes, self._roots(nodes)).items():
            node = nodes[number]
            mesh: dict[str, Any] = {"primitives": []}
            if "mesh" in node:
                mesh = self._tree["meshes"][node["mesh"]]
            if "skin" in node:
                raise _posed("skin")
            if any(node.get("weights", mesh.get("weights", []))):
                raise _posed("weights")
            # The transform of the node is a 4 x 4 matrix. If it mirrors, so that surfaces turn
            # inside out, the corners of faces are reversed.
            linear = transform[:3, :3]
            is_mirrored = np.linalg.det(transform) < 0
            for primitive in mesh["primitives"]:
                vertices, faces = self._primitive(primitive)
                if is_mirrored:
                    faces = faces[:, ::-1]
                yield vertices @ linear.T + transform[:3, 3], faces

    def _roots(self, nodes: list[Node]) -> Iterable[int]:
        """Return the numbers of the nodes at the top of the default scene.

        In a file without scenes, they are the nodes that are no children of another node.

        Parameters
        ----------
        nodes
            All nodes of the file; each names its children by their numbers.

        Raises
        ------
        ValueError
            If there are several scenes and none is the default.
        """
        scenes = self._tree.get("scenes", [])
        if len(scenes) > 1 and "scene" not in self._tree:
            raise ValueError(f"it has {len(scenes)} scenes, and none is the default; export one")
        if scenes:
            roots: list[int] = scenes[self._tree.get("scene", 0)].get("nodes", [])
            return roots
        below: set[int] = set()
        for node in nodes:
            below.update(node.get("children", []))
            # The extension for levels of detail names coarser versions of the node.
            below.update(node.get("extensions", {}).get("MSFT_lod", {}).get("ids", []))
        return set(range(len(nodes))) - below

    def _primitive(self, primitive: dict[str, Any]) -> Surface:
        """Return vertices, shape (n, 3), and triangles, shape (m, 3), of a part of a mesh.

        Points and lines have no triangles.

        Parameters
        ----------
        primitive
            The part: in ``attributes``, the ``POSITION`` of vertices; optionally ``indices``, the
            corners of triangles; and its ``mode``. Positions and indices are given by the number of
            an accessor.

        Raises
        ------
        InvalidMesh
            If a corner is none of its vertices.
        UnreadableMesh
            If it is a strip or a fan of triangles.
        """
        vertices = self._accessor(primitive["attributes"]["POSITION"], "VEC3")
        # Without indices, three vertices each are a triangle.
        corners: NDArray[Any] = np.arange(len(vertices))
        if primitive.get("indices") is not None:
            corners = whole_numbers(self._accessor(primitive["indices"], "SCALAR")[:, 0])
        # Modes 0 to 3 are points and lines, 5 and 6 strips and fans of triangles.
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in range(_TRIANGLES + 1):
            problem = f"primitives of mode {mode} are not read"
            raise UnreadableMesh(problem, f"export triangles, mode {_TRIANGLES}")
        if mode != _TRIANGLES:
            corners = corners[:0]
        if corners.size:  # checked here: in the joined mesh, they would be vertices of other parts
            corners = count_from_0(corners, len(vertices), 0)
        return vertices, corners.reshape(-1, 3)

    def _accessor(self, number: int, kind: str) -> FloatArray:
        """Return the numbers that an accessor describes, as floats, shape (count, width).

        An accessor is a table within a buffer: it has the type of the numbers, how many of them a
        row holds, the number of rows, and the place of the first. Its view has the part of the
        buffer, and how far rows are apart.

        Parameters
        ----------
        number
            Number of the accessor.
        kind
            Type of its rows, a key of :data:`_WIDTHS`.

        Raises
        ------
        ValueError
            If its rows are of another type, or the buffer with the numbers is cut off.
        UnreadableMesh
            If they are sparse, compressed or missing.
        """
        accessor = self._tree["accessors"][number]
        if accessor["type"] != kind:
            raise ValueError(f"accessor {number} has rows of type {accessor['type']}, not {kind}")
        if "sparse" in accessor:
            problem = f"accessor {number} is sparse, which is not read"
            raise UnreadableMesh(problem, "export it in full")
        if "bufferView" not in accessor:
            raise UnreadableMesh(f"accessor {number} has no data", "export it in full")
        rows = self._rows(accessor)
        result = rows.astype(np.float64)
        # Whole numbers may stand for fractions from -1 or 0 to 1.
        if accessor.get("normalized") and rows.dtype.kind != "f":
            result = np.maximum(result / np.iinfo(rows.dtype).max, -1)
        return result

    def _rows(self, accessor: dict[str, Any]) -> NDArray[Any]:
        """Return the numbers of an accessor as they lie in the buffer, shape (count, width).

        Parameters
        ----------
        accessor
            Type and place of the numbers.

        Raises
        ------
        ValueError
            If the buffer is cut off.
        """
        number_type = np.dtype(_TYPES[accessor["componentType"]])
        n_rows = accessor["count"]
        width = _WIDTHS[accessor["type"]]
        offset = accessor.get("byteOffset", 0)  # of the first row, within the view
        view = self._tree["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0)
        size = view["byteLength"]
        row_size = number_type.itemsize * width
        stride = view.get("byteStride", row_size)  # from one row to the next
        content = self._buffer(view["buffer"])[start : start + size]
        end = offset + stride * (n_rows - 1) + row_size
        if stride < row_size or len(content) < max(size, end):
            raise ValueError(f"buffer {view['buffer']} is cut off")
        rows: NDArray[Any] = np.ndarray(
            (n_rows, width), number_type, content, offset, (stride, number_type.itemsize)
        )
        return rows

    def _buffer(self, number: int) -> bytes:
        """Return the bytes of a buffer, which are read once."""
        if number not in self._read:
            buffer = self._tree["buffers"][number]
            content = self._content(number, buffer.get("uri"))
            size = buffer["byteLength"]
            if content is None or len(content) < size:
                n_bytes = len(content or b"")
                raise ValueError(f"buffer {number} holds {n_bytes} of {size} bytes")
            self._read[number] = content
        return self._read[number]

    def _content(self, number: int, uri: str | None) -> bytes | None:
        """Return the bytes of a buffer: of this file, in its text, or of a file beside it.

        None if there are none.
        """
        if uri is None:
            return self._binary if number == 0 else None
        if uri.startswith("data:"):
            return base64.b64decode(unquote(uri.partition(",")[2]), validate=True)
        if self._path.suffix.lower() == ".gz":
            raise UnreadableMesh(f"its buffer {uri} is not packed with it", "unpack it")
        return self._beside(unquote(uri))

    def _beside(self, name: str) -> bytes:
        """Return the content of a file beside this one."""
        try:
            return read_file(self._path.parent / name)
        except OSError as error:
            hint = "put that file beside it, or export a .glb"
            raise UnreadableMesh(f"its buffer {name}: {error.strerror}", hint) from error


def _posed(what: str) -> UnreadableMesh:
    """Return the error for what poses a mesh."""
    problem = f"'{what}', which poses a mesh, is not read"
    hint = "apply the pose, and export again"
    return UnreadableMesh(problem, hint)


FORMAT = Format(
    module=__name__,
    extensions=(".glb", ".gltf"),
    first_vertex=0,
    read=read,
    files_beside=buffer_files,
    extensions_beside=(".bin",),
    preference=6,
)
