"""The ASCII pair of TOSCA: vertices in ``.vert``, triangles beside it in ``.tri``.

Triangles count vertices from 1, unless they name vertex 0.
"""

from __future__ import annotations

from pathlib import Path

from benchmark.errors import UnreadableMesh
from benchmark.files import named_errors
from benchmark.formats.ascii import (
    check_end,
    filled_lines,
    parse_table,
    plain_text,
    whole_numbers,
)
from benchmark.formats.base import Format, MeshArrays
from benchmark.formats.reading import read_unpacked


def read(data: bytes, path: Path) -> MeshArrays:
    """Return the vertices of a file, and the triangles of the file beside it, counted from 0.

    Parameters
    ----------
    data
        Bytes of the ``.vert`` file: a line of three coordinates for each vertex.
    path
        That file; the ``.tri`` file beside it has a line of three vertices for each triangle,
        counted from 0 or from 1.

    Raises
    ------
    ValueError
        If it is not clear whether the triangles count from 0 or from 1.
    UnreadableMesh
        If there is no ``.tri`` file beside it, or that is damaged.
    """
    vertices = parse_table(filled_lines(plain_text(data)))
    companion = triangle_file(path)
    with named_errors(companion, "tri file", UnreadableMesh, "fetch it again"):
        triangles = read_unpacked(companion)
        faces = parse_table(filled_lines(plain_text(triangles)))
        check_end(triangles, whole_numbers(faces), len(vertices))
    # Vertex 0 tells that they count from 0, vertex n that they count from 1.
    first = int(faces.min())
    last = int(faces.max())
    if first > 0 and last < len(vertices):
        problem = (
            f"triangles name vertices {first} to {last} of {len(vertices)}, "
            "so they may count from 0 or from 1"
        )
        raise ValueError(f"{problem}; leave out vertices without a triangle")
    corners = whole_numbers(faces)
    if first > 0:
        corners = corners - 1
    return vertices, corners


def triangle_file(path: Path) -> Path:
    """Return the ``.tri`` file beside a ``.vert`` file, which may be packed, too."""
    is_packed = path.suffix.lower() == ".gz"
    plain = path.with_suffix("") if is_packed else path
    alike, other = (".tri.gz", ".tri") if is_packed else (".tri", ".tri.gz")
    if not plain.with_suffix(alike).exists() and plain.with_suffix(other).exists():
        return plain.with_suffix(other)
    return plain.with_suffix(alike)


FORMAT = Format(
    module=__name__,
    extensions=(".vert",),
    first_vertex=0,
    read=read,
    files_beside=lambda path: [triangle_file(path)],
    extensions_beside=(".tri",),
    preference=5,
)
