"""A mesh from a file of a format, without trust in its content; errors name the file."""

from __future__ import annotations

import gzip
import io
import warnings
from pathlib import Path

from benchmark.errors import InvalidMesh, UnreadableMesh, surface_command
from benchmark.files import LARGEST_FILE, named_errors, read_file
from benchmark.formats.base import Format, MeshArrays, mesh_suffix
from benchmark.formats.polygons import count_from_0, split_polygons
from benchmark.geometry.mesh import Mesh


def read_with(format: Format, path: Path) -> Mesh:
    """Return the mesh in a file of a format, in its units and order, neither cleaned nor scaled.

    Raises
    ------
    UnreadableMesh
        If the file is missing, empty, too large, truncated or not numeric.
    InvalidMesh
        If a coordinate is not finite, a vertex index is out of range, or there are no faces.
    """
    kind = f"{mesh_suffix(path)[1:]} file"
    with named_errors(path, kind, UnreadableMesh, "fetch or export the file again"):
        vertices, corners, *sizes = read_arrays(format, path)
        if not len(corners):
            hint = f"make a surface of the points: {surface_command(path.name)}"
            raise InvalidMesh("there are no faces", hint)
        corners = count_from_0(corners, len(vertices), format.first_vertex)
        faces = split_polygons(vertices, corners, sizes[0]) if sizes else corners
        return Mesh(vertices, faces)  # type: ignore[arg-type]


def read_arrays(format: Format, path: Path) -> MeshArrays:
    """Return the vertices and the corners of faces in a file, as its format reads them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of readers, about damaged files
        # numpy below 2.3 does not raise.
        warnings.filterwarnings("error", "string or file could not be read")
        return format.read(read_unpacked(path), path)


def read_unpacked(path: Path) -> bytes:
    """Return the content of a file, unpacked; raise ``UnreadableMesh`` if empty or too large."""
    data = read_file(path, LARGEST_FILE)
    if data and path.suffix.lower() == ".gz":
        data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(LARGEST_FILE + 1)
    if len(data) > LARGEST_FILE:
        problem = f"it holds more than {LARGEST_FILE / 2**30:g} GiB"
        raise UnreadableMesh(problem, "decimate the mesh")
    if not data.strip():
        raise UnreadableMesh("the file is empty", "fetch or export the file again")
    return data
