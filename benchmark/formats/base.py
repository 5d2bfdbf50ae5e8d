"""What a format of mesh files says of itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchmark.geometry.mesh import IntArray, Mesh, Points

MeshArrays = tuple[Points, IntArray] | tuple[Points, IntArray, IntArray]
"""What a file lists.

Vertices and the corners of triangles, shape (m, 3); or vertices, the corners of polygons, one after
the other, and how many corners each has.
"""


def no_files(_: Path) -> Sequence[Path]:
    """Return nothing: a file of most formats stands alone."""
    return ()


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of mesh files.

    Parameters
    ----------
    module
        The module of the format: ``__name__``. Its code is in the keys of shapes that it reads.
    extensions
        Extensions of its files, in lower case.
    first_vertex
        Number of the first vertex in what ``read`` returns.
    read
        Function that returns the vertices and corners in the content of a file at a path; raises
        ``ValueError`` or ``UnreadableMesh`` if it is damaged.
    write
        Function that returns the content of a file with a mesh; None if the format is not written.
    files_beside
        Function that returns the other files that the mesh in a file is read from.
    extensions_beside
        Extensions of files beside its own that are no meshes, such as materials.
    preference
        Of several files of one shape, that whose format has the lowest number is read; formats that
        say nothing come last.
    """

    module: str
    extensions: tuple[str, ...]
    first_vertex: Literal[0, 1]
    read: Callable[[bytes, Path], MeshArrays]
    write: Callable[[Mesh], bytes] | None = None
    files_beside: Callable[[Path], Sequence[Path]] = no_files
    extensions_beside: tuple[str, ...] = ()
    preference: int = 100


def mesh_suffix(path: Path) -> str:
    """Return the lower-case extension of a path, that before ``.gz`` if it is packed."""
    unpacked = Path(path.stem) if path.suffix.lower() == ".gz" else path
    return unpacked.suffix.lower()


def mesh_stem(path: Path) -> str:
    """Return the name of a mesh file without its extension, also before ``.gz``."""
    return Path(path.stem).stem if path.suffix.lower() == ".gz" else path.stem
