"""All that the author of a data set imports: a class that lists shapes and makes the mesh of each.

A *data set* is a frozen, keyword-only dataclass with a class attribute ``info``, a method ``entries`` that lists its
shapes, and a method ``load`` that makes the mesh of one; ``load`` may be left out where every entry names a mesh file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol, runtime_checkable

from benchmark.geometry.camera import FRONT, SIDE, Camera
from benchmark.geometry.mesh import Mesh

__all__ = ["FRONT", "SIDE", "Camera", "DatasetInfo", "Entry", "ListsShapes", "Mesh"]


@dataclass(frozen=True)
class Entry:
    """One shape of a data set.

    Parameters
    ----------
    identifier
        Unique name inside the data set, e.g. ``"cat0"``.
    subject
        The retrieval class.
    pose
        The pose; equal names mean the same pose where the data set knows that, else unique.
    path
        The file that holds the mesh; None for generated shapes.
    """

    identifier: str
    subject: str
    pose: str
    path: Path | None = None


@dataclass(frozen=True, kw_only=True)
class DatasetInfo:
    """Facts about a data set, for the harness and the tables.

    Parameters
    ----------
    name
        Name on the command line: lower case, words joined by hyphens.
    title
        Name in the tables.
    summary
        One line for ``list datasets``.
    half_width
        Half the width of the depth camera's frame in units of the meshes; None fits it to the whole set.
    """

    name: str
    title: str
    summary: str = ""
    half_width: float | None = None


@runtime_checkable
class ListsShapes(Protocol):
    """A data set of one's own.

    Beside ``entries`` it has ``load(entry)``, which returns the :class:`Mesh` of a shape, unless every entry has a
    ``path``: then the file is read. It may have ``camera(entry)``, which returns the depth camera of a shape (by
    default :data:`FRONT`), and ``recipe(entry)``, a text that names whatever outside of its own code determines a mesh,
    such as the digest of a file that ``load`` reads (by default the digest of ``path``).
    """

    info: ClassVar[DatasetInfo]

    def entries(self) -> Iterable[Entry]:
        """List the shapes, always the same ones in the same order; the order is that of the distance matrix."""
        ...
