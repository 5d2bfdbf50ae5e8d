"""Reading and writing of mesh files; every error names the file and includes a hint."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmark.errors import ConfigurationError, InvalidMesh, UnreadableMesh
from benchmark.geometry.formats.mat import read_mat
from benchmark.geometry.formats.parsing import Arrays
from benchmark.geometry.formats.ply import read_ply
from benchmark.geometry.formats.text import read_obj, read_off, read_stl, read_vert_tri
from benchmark.geometry.mesh import Mesh

_READERS: dict[str, Callable[..., Arrays]] = {
    ".off": read_off,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".mat": read_mat,
    ".vert": read_vert_tri,
}
READABLE: tuple[str, ...] = tuple(_READERS)
WRITABLE: tuple[str, ...] = (".off", ".obj", ".ply")


def read_mesh(path: Path | str) -> Mesh:
    """Read a triangle mesh; vertices and faces keep the order of the file.

    Parameters
    ----------
    path
        An ``.off``, ``.obj``, ``.ply``, ``.stl`` or ``.mat`` file, or a ``.vert`` file next to its ``.tri`` file.
        Polygons are split into triangle fans. Exactly coincident corners of an STL file are merged.

    Returns
    -------
    Mesh
        The mesh in units of the file, neither cleaned nor scaled.

    Raises
    ------
    UnreadableMesh
        If the file is missing, empty, truncated, not numeric, or in an unknown format.
    InvalidMesh
        If a coordinate is not finite, a vertex index is out of range, or there are no faces.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READABLE:
        raise UnreadableMesh(f"{path}: unknown extension '{suffix}'", f"convert it to one of {', '.join(READABLE)}")
    parts = [_load(part) for part in ((path, path.with_suffix(".tri")) if suffix == ".vert" else (path,))]
    try:
        vertices, faces = _READERS[suffix](*parts)
    except Exception as error:  # any reader failure on a damaged file excludes this file only
        reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__} {error}".strip()
        raise UnreadableMesh(
            f"{path}: not a readable {suffix[1:]} file: {reason}", "fetch or export the file again"
        ) from error
    if not len(faces):
        raise InvalidMesh(f"{path}: there are no faces", "export a surface, not a point cloud")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InvalidMesh(
            f"{path}: faces name vertices {faces.min()} to {faces.max()}, but there are {len(vertices)}, from 0",
            "check whether the file counts from 1 or was truncated",
        )
    try:
        return Mesh(vertices, faces.astype(np.int32))
    except InvalidMesh as error:
        raise InvalidMesh(f"{path}: {error.problem}", error.hint) from error


def write_mesh(path: Path | str, mesh: Mesh) -> None:
    """Write a mesh as OFF, OBJ or binary PLY, by extension, with coordinates in full precision.

    Raises
    ------
    ConfigurationError
        If the extension is none of ``.off``, ``.obj``, ``.ply``, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".off":
        content = f"OFF\n{mesh.n_vertices} {mesh.n_faces} 0\n" + _rows("", mesh.vertices) + _rows("3 ", mesh.faces)
        data = content.encode("ascii")
    elif suffix == ".obj":
        data = (_rows("v ", mesh.vertices) + _rows("f ", mesh.faces + 1)).encode("ascii")
    elif suffix == ".ply":
        data = _ply(mesh)
    else:
        raise ConfigurationError(f"{path}: cannot write '{suffix}' files", f"choose one of {', '.join(WRITABLE)}")
    try:
        path.write_bytes(data)
    except OSError as error:
        raise ConfigurationError(
            f"{path}: {error.strerror}", "choose a file in a folder that can be written"
        ) from error


def _load(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UnreadableMesh(f"{path}: {error.strerror}", "check the path and its permissions") from error
    if not data.strip():
        raise UnreadableMesh(f"{path}: the file is empty", "fetch or export the file again")
    return data


def _rows(prefix: str, table: np.ndarray) -> str:
    return "".join(f"{prefix}{a!r} {b!r} {c!r}\n" for a, b, c in table.tolist())


def _ply(mesh: Mesh) -> bytes:
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {mesh.n_vertices}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {mesh.n_faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(mesh.n_faces, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    return header.encode("ascii") + mesh.vertices.astype("<f8").tobytes() + faces.tobytes()
