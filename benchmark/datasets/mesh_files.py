"""Data sets of mesh files: how the file of a shape is read, and what its mesh depends on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import UnreadableMesh
from benchmark.files import file_digest
from benchmark.geometry.io import companions, read_mesh
from benchmark.geometry.mesh import Mesh


def mesh_file_set(**facts: Any) -> ShapeSet:
    """Return a data set whose shapes are read from mesh files; the arguments are those of :class:`ShapeSet`."""
    return ShapeSet(
        load=read_entry,
        key=digest_of_entry,
        files=files_of,
        code=("benchmark.geometry.io",),
        **facts,
    )


def read_entry(entry: Entry) -> Mesh:
    """Read the mesh file of a shape; raise ``UnreadableMesh`` if it has none or it is damaged."""
    if entry.path is None:
        raise UnreadableMesh(
            f"shape '{entry.identifier}' has no file", "give it a path, or the data set a 'load'"
        )
    return read_mesh(entry.path)


def digest_of_entry(entry: Entry) -> str:
    """Return the digest of the mesh file of a shape; "" if it has none."""
    try:
        return "+".join(map(file_digest, files_of(entry)))
    except UnreadableMesh:  # it is refused when it is prepared
        return f"{entry.identifier} cannot be read"


def files_of(entry: Entry) -> list[Path]:
    """Return the mesh file of a shape and the files beside it that belong to it."""
    return [entry.path, *companions(entry.path)] if entry.path else []
