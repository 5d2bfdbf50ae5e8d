"""Interface for authors of data sets, which list shapes and return their meshes.

A *data set* is a frozen, keyword-only dataclass with a class attribute ``info``, a method ``entries`` that lists its
shapes, and a method ``load`` that returns the mesh of one. ``load`` is optional if every entry names a mesh file.
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
        Unique name in the data set, e.g. ``"cat0"``.
    subject
        Retrieval class.
    pose
        Name of the pose: equal for equal poses if the data set knows them, else unique.
    path
        Mesh file; None for generated shapes.
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
        Half the width of the depth camera's frame in units of the meshes; None fits it to the whole data set.
    """

    name: str
    title: str
    summary: str = ""
    half_width: float | None = None


@runtime_checkable
class ListsShapes(Protocol):
    """Interface of a data set.

    In addition to ``entries``, a data set has a method ``load(entry)`` that returns the :class:`Mesh` of a shape;
    without ``load``, the file ``path`` of the entry is read. Two more methods are optional. ``camera(entry)`` returns
    the depth camera of a shape (default: :data:`FRONT`). ``recipe(entry)`` returns text that identifies everything
    outside the code of the data set that determines a mesh, such as the digest of a file that ``load`` reads (default:
    the digest of ``path``).
    """

    info: ClassVar[DatasetInfo]

    def entries(self) -> Iterable[Entry]:
        """List the shapes: always the same ones, in the order of the distance matrix."""
        ...
