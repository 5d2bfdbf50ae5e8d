"""What the harness asks of a data set."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from benchmark.errors import BenchmarkError, DatasetError, UnreadableMesh
from benchmark.geometry.mesh import Mesh

if TYPE_CHECKING:
    from benchmark.geometry.depth import Camera


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
        The nuisance; equal names mean the same pose where the data set knows that, else unique.
    path
        The file that holds the mesh; None for generated shapes.
    """

    identifier: str
    subject: str
    pose: str
    path: Path | None = None


class Dataset(Protocol):
    """A collection of shapes; order of entries is the order of the matrix rows.

    Attributes
    ----------
    name
        Name on the command line.
    title
        Name in captions.
    stand_in_for
        Name of the official set that this generated one stands in for, or "" for real data.
    half_width
        Half the width of the depth camera's frame in file units, or None to fit it to the whole set.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def title(self) -> str: ...  # noqa: D102
    @property
    def stand_in_for(self) -> str: ...  # noqa: D102
    @property
    def half_width(self) -> float | None: ...  # noqa: D102
    @property
    def entries(self) -> tuple[Entry, ...]: ...  # noqa: D102

    def load(self, entry: Entry) -> Mesh:
        """Return the mesh as the set gives it, or raise ``UnreadableMesh`` / ``InvalidMesh``."""
        ...

    def recipe(self, entry: Entry) -> str:
        """Name what determines the mesh: a digest of the file, or of the generator and its parameters."""
        ...

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        ...


@dataclass(frozen=True)
class FileDataset:
    """Meshes on disk.

    Parameters
    ----------
    name, title, stand_in_for, half_width, entries
        See :class:`Dataset`; every entry has a path.
    camera_for
        Chooses the depth camera of an entry; None looks at the front.
    """

    name: str
    title: str
    entries: tuple[Entry, ...]
    stand_in_for: str = ""
    half_width: float | None = None
    camera_for: Callable[[Entry], Camera] | None = None

    def load(self, entry: Entry) -> Mesh:
        """Read the mesh from its file."""
        from benchmark.geometry.io import read_mesh

        return read_mesh(_path(entry))

    def recipe(self, entry: Entry) -> str:
        """Digest of the file, and of the companion that holds the triangles where there is one."""
        digest = hashlib.sha256()
        path = _path(entry)
        for part in (path, path.with_suffix(".tri")) if path.suffix.lower() == ".vert" else (path,):
            try:
                digest.update(part.read_bytes())
            except OSError as error:
                raise UnreadableMesh(
                    f"cannot read {part}: {error.strerror}", "check the file and its rights"
                ) from error
        return f"sha256:{digest.hexdigest()}"

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        from benchmark.geometry.depth import FRONT

        return self.camera_for(entry) if self.camera_for else FRONT


def check_retrievable(dataset: Dataset) -> None:
    """Raise ``DatasetError`` unless the set has at least two classes and a class with two shapes."""
    subjects = [entry.subject for entry in dataset.entries]
    if not subjects:
        raise DatasetError(
            f"data set '{dataset.name}' has no meshes", "point to a folder with .off, .obj, .ply or .stl files"
        )
    if len(set(subjects)) < 2:
        raise DatasetError(
            f"data set '{dataset.name}' has one class ('{subjects[0]}'), so every ranking is perfect",
            "sort the meshes into one sub-folder per class, add a .cla file, or name them CLASS + number",
        )
    if len(set(subjects)) == len(subjects):
        raise DatasetError(
            f"each class of data set '{dataset.name}' has one shape, so nothing can be retrieved",
            "add a second shape to at least one class",
        )


def natural_key(text: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key that puts ``cat2`` before ``cat10``."""
    parts = re.findall(r"[0-9]+|[^0-9]+", text)
    return tuple((0, int(part), "") if part[0] in "0123456789" else (1, 0, part) for part in parts)


def _path(entry: Entry) -> Path:
    if entry.path is None:
        raise BenchmarkError(f"shape '{entry.identifier}' has no file", "generated shapes have their own loader")
    return entry.path
