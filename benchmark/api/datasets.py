"""Data sets: a :class:`ShapeSet` lists shapes, and returns the mesh and the camera of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.geometry.camera import FRONT, Camera, DepthSensor
from benchmark.geometry.mesh import Mesh
from benchmark.text import brief

if TYPE_CHECKING:
    from benchmark.api.contracts import Input


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


def name_view(identifier: str, number: int) -> str:
    """Return the name of one of several views of a shape."""
    return f"{identifier}@{number}"


@dataclass(frozen=True, kw_only=True)
class ShapeSet:
    """A data set.

    Parameters
    ----------
    name
        Name on the command line: lower case, words joined by hyphens.
    shapes
        Shapes in the order of the distance matrix.
    load
        Function that returns the unprocessed mesh of a shape, or raises ``UnreadableMesh`` or
        ``InvalidMesh``.
    key
        Function that returns text on which the mesh of a shape depends beside the code that makes
        it: parameters of a generator, or the digest of a file; "" by default.
    files
        Function that returns the files from which the mesh of a shape is read; by default its path,
        if it has one.
    title
        Name in tables; by default the name.
    camera
        Function that returns the depth camera of a shape; by default :data:`FRONT`, for shapes that
        stand along z and face -y.
    sensor
        Function that returns the errors of the depth sensor for a shape, or None for exact depth
        images.
    observe
        Function that returns the :class:`~benchmark.depth.frame.ObservedObject` of a shape; None
        for a set of meshes.
    half_width
        Half the width of the depth camera's frame in units of the meshes; None fits it to the whole
        data set.
    canonical_poses
        Canonical pose by subject; for other subjects it is the first pose.
    inputs
        ``("mesh", "view")``, or ``("view",)`` for depth frames, which show one side of a shape.
    stand_in_for
        Name of the official set that a generated set replaces.
    folder
        Folder of the files; None for a generated set.
    code
        Function that returns the modules whose code makes the mesh of a shape.
    framed
        The data set whose frame its views have; None for its own.

    Examples
    --------
    >>> shapes = tuple(Entry(f"{s}{k}", s, str(k)) for s in ("thin", "thick") for k in range(5))
    >>> rods = ShapeSet(name="rods", shapes=shapes, load=rod)  # doctest: +SKIP
    """

    name: str
    shapes: tuple[Entry, ...]
    load: Callable[[Entry], Mesh]
    key: Callable[[Entry], str] = lambda _: ""
    files: Callable[[Entry], Sequence[Path]] = lambda entry: [entry.path] if entry.path else []
    title: str = ""
    camera: Callable[[Entry], Camera] = lambda _: FRONT
    sensor: Callable[[Entry], DepthSensor | None] = lambda _: None
    observe: Callable[[Entry], Any] | None = None
    half_width: float | None = None
    canonical_poses: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[Input, ...] = ("mesh", "view")
    stand_in_for: str = ""
    folder: Path | None = None
    code: Callable[[Entry], Sequence[str]] = lambda _: ()
    framed: ShapeSet | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", brief(self.title or self.name))
