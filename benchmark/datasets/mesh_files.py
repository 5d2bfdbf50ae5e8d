"""Mesh files: their formats, how the file of a shape is read, and what its mesh depends on.

This is the only module of the suite that knows formats: those are the modules of
:mod:`benchmark.formats` that have a ``FORMAT``.
"""

from __future__ import annotations

import pkgutil
import zlib
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmark import formats
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import BenchmarkError, ConfigurationError, InvalidMesh, UnreadableMesh
from benchmark.files import file_digest, named_errors, write_atomically
from benchmark.formats.ascii import ends_within_line
from benchmark.formats.base import Format, mesh_stem, mesh_suffix
from benchmark.formats.reading import read_arrays, read_unpacked, read_with
from benchmark.formats.unread import UNREAD_MESHES, UNREAD_POINTS
from benchmark.geometry.copies import check_copies
from benchmark.geometry.mesh import Mesh

__all__ = [
    "COMPANIONS",
    "FORMATS",
    "MESHES",
    "POINTS",
    "READABLE",
    "WRITABLE",
    "digest_of_entry",
    "faces_without_corners",
    "files_beside",
    "files_of",
    "find_formats",
    "lacks_last_break",
    "mesh_file_set",
    "mesh_stem",
    "mesh_suffix",
    "read_entry",
    "read_mesh",
    "read_surface",
    "readers_of",
    "write_mesh",
]


def find_formats() -> dict[str, Format]:
    """Return all mesh formats by the extensions of their files, preferred formats first.

    Each module of the package of formats with a ``FORMAT`` is one.
    """
    known: list[Format] = []
    for module_info in pkgutil.iter_modules(formats.__path__):
        module = import_module(f"{formats.__name__}.{module_info.name}")
        if hasattr(module, "FORMAT"):
            known.append(module.FORMAT)
    known.sort(key=lambda format: (format.preference, format.module))
    by_extension: dict[str, Format] = {}
    for format in known:
        by_extension |= dict.fromkeys(format.extensions, format)
    return by_extension


def _formats_of_companions() -> dict[str, Format]:
    """Return the formats by the extensions of the files that belong to their mesh files.

    A ``.tri`` file with triangles, for example, belongs to a ``.vert`` file with vertices.
    """
    by_extension: dict[str, Format] = {}
    for format in FORMATS.values():
        by_extension |= dict.fromkeys(format.extensions_beside, format)
    return by_extension


FORMATS = find_formats()
"""Formats by extension; of several files of a shape, that of the first is read."""

READABLE: tuple[str, ...] = tuple(FORMATS)
WRITABLE: tuple[str, ...] = tuple(name for name, format in FORMATS.items() if format.write)

MESHES: tuple[str, ...] = tuple(dict.fromkeys([*READABLE, *UNREAD_MESHES]))
"""Extensions of meshes, preferred first; a file that cannot be read is a shape that counts as 0."""

POINTS: tuple[str, ...] = tuple(name for name in UNREAD_POINTS if name not in FORMATS)
"""Extensions of point clouds, which are skipped."""

_FORMATS_OF_COMPANIONS = _formats_of_companions()

COMPANIONS: tuple[str, ...] = tuple(_FORMATS_OF_COMPANIONS)
"""Extensions of files that belong to a mesh file and are no mesh themselves."""


#: Extensions of meshes that mark their end, such as by a bracket or ``endsolid``. All others may be
#: text that is cut off within its last number.
_WITH_MARKED_END = (".stl", ".mat", ".glb", ".gltf")


def read_mesh(path: Path | str) -> Mesh:
    """Read a triangle mesh; vertices and faces keep the order of the file.

    Parameters
    ----------
    path
        A file with one of the extensions in :data:`READABLE`, also with ``.gz`` behind it. Polygons
        are split into triangle fans, each around the first corner that sees all others.

    Returns
    -------
    Mesh
        The mesh in units of the file, neither cleaned nor scaled.

    Raises
    ------
    UnreadableMesh
        If the file is missing, empty, too large, truncated, not numeric, or in an unknown format.
    InvalidMesh
        If a coordinate is not finite, a vertex index is out of range, or there are no faces.
    """
    path = Path(path)
    suffix = mesh_suffix(path)
    if suffix in _FORMATS_OF_COMPANIONS:
        owner = _FORMATS_OF_COMPANIONS[suffix].extensions[0]
        hint = f"name that file instead, such as {mesh_stem(path)}{owner}"
        raise UnreadableMesh(f"it belongs to a {owner} file", hint, path)
    if suffix not in FORMATS:
        hint = f"convert it to one of {', '.join(READABLE)}"
        raise UnreadableMesh(f"unknown extension '{suffix}'", hint, path)
    return read_with(FORMATS[suffix], path)


def lacks_last_break(path: Path) -> bool:
    """Return whether a mesh file is text that ends within a line; False for what cannot be read."""
    suffix = mesh_suffix(path)
    is_read = suffix in FORMATS or suffix in _FORMATS_OF_COMPANIONS
    if not is_read or suffix in _WITH_MARKED_END:
        return False
    try:
        content = read_unpacked(path)
    except (BenchmarkError, OSError, EOFError, zlib.error):  # which is refused when it is read
        return False
    is_binary = b"\0" in content or b"\nformat binary" in content[:1000]
    return not is_binary and ends_within_line(content)


def faces_without_corners(path: Path) -> int:
    """Return how many faces of a readable mesh file have no corners, as some exporters write."""
    _, _, *sizes = read_arrays(FORMATS[mesh_suffix(path)], path)
    return int(np.count_nonzero(sizes[0] == 0)) if sizes else 0


def read_surface(path: Path) -> Mesh:
    """Read a mesh that shows one surface once; see :func:`read_mesh`.

    Raises
    ------
    UnreadableMesh, InvalidMesh
        As :func:`read_mesh`, and if two pieces are copies, such as levels of detail.
    """
    mesh = read_mesh(path)
    with named_errors(path, "mesh", InvalidMesh, "export the surface once"):
        check_copies(mesh)
    return mesh


def write_mesh(path: Path | str, mesh: Mesh) -> None:
    """Write a mesh to a file, with coordinates in full precision.

    If that fails, as on a full disk, the old file remains.

    Parameters
    ----------
    path
        The file, whose extension determines the format.
    mesh
        The mesh.

    Raises
    ------
    ConfigurationError
        If the extension is none of :data:`WRITABLE`, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    write = FORMATS[suffix].write if suffix in WRITABLE else None
    if write is None:
        problem = f"{path}: cannot write '{suffix}' files"
        raise ConfigurationError(problem, f"choose one of {', '.join(WRITABLE)}")
    data = write(mesh)
    try:
        write_atomically(path.resolve(), lambda file: file.write(data))
    except OSError as error:
        problem = f"{path}: {error.strerror}"
        raise ConfigurationError(
            problem, "choose a file in a folder that can be written"
        ) from error


# Shapes of data sets
# ------------------------------------------------------------------------------------------------


def mesh_file_set(**facts: Any) -> ShapeSet:
    """Return a data set whose shapes are read from mesh files.

    The arguments are those of :class:`ShapeSet`.
    """
    return ShapeSet(
        load=read_entry,
        key=digest_of_entry,
        files=files_of,
        code=readers_of,
        **facts,
    )


def read_entry(entry: Entry) -> Mesh:
    """Read the mesh file of a shape.

    Raises
    ------
    ShapeError
        If it has none, it is damaged, or it holds a copy.
    """
    if entry.path is None:
        problem = f"shape '{entry.identifier}' has no file"
        raise UnreadableMesh(problem, "give it a path, or the data set a 'load'")
    return read_surface(entry.path)


def readers_of(entry: Entry) -> tuple[str, ...]:
    """Return the modules that read the mesh file of a shape.

    They are that of its format, and what all formats share.
    """
    format = FORMATS.get(mesh_suffix(entry.path)) if entry.path else None
    return (read_with.__module__, format.module) if format else ()


def digest_of_entry(entry: Entry) -> str:
    """Return the digest of the mesh file of a shape; "" if it has none."""
    try:
        return "+".join(map(file_digest, files_of(entry)))
    except UnreadableMesh:  # it is refused when it is prepared
        return f"{entry.identifier} cannot be read"


def files_of(entry: Entry) -> list[Path]:
    """Return the mesh file of a shape and the files beside it that belong to it."""
    return [entry.path, *files_beside(entry.path)] if entry.path else []


def files_beside(path: Path) -> list[Path]:
    """Return the files beside a mesh file from which its mesh is read, too."""
    format = FORMATS.get(mesh_suffix(path))
    return list(format.files_beside(path)) if format else []
