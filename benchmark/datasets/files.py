"""Data sets whose meshes are files: how a shape is read, and what names its content."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from benchmark.datasets.base import Entry
from benchmark.errors import BenchmarkError, DatasetError, UnreadableMesh
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.io import read_mesh
from benchmark.geometry.mesh import Mesh

__all__ = ["FolderDataset", "file_digest"]


@dataclass(frozen=True)
class FolderDataset:
    """Meshes on disk.

    Parameters
    ----------
    name, title, entries, stand_in_for, half_width
        See :class:`~benchmark.datasets.base.Dataset`; every entry has a path.
    camera_for
        Chooses the depth camera of an entry; None looks at the front.
    folder
        The folder that the data set was read from.
    canonical_poses
        Canonical pose of each subject; a subject that is not named has its first pose.
    """

    name: str
    title: str
    entries: tuple[Entry, ...]
    stand_in_for: str = ""
    half_width: float | None = None
    camera_for: Callable[[Entry], Camera] | None = None
    folder: Path = Path()
    canonical_poses: Mapping[str, str] = field(default_factory=dict)

    def load(self, entry: Entry) -> Mesh:
        """Read the mesh from its file."""
        return read_mesh(_path(entry))

    def recipe(self, entry: Entry) -> str:
        """Digest of the file, and of the companion that holds the triangles where there is one."""
        path = _path(entry)
        parts = (path, path.with_suffix(".tri")) if path.suffix.lower() == ".vert" else (path,)
        return "sha256:" + "+".join(file_digest(part) for part in parts)

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        return self.camera_for(entry) if self.camera_for else FRONT


def file_digest(path: Path) -> str:
    """SHA-256 of a file in hexadecimal; a file that has not changed is read once in a process.

    Raises
    ------
    UnreadableMesh
        If it cannot be read.
    """
    try:
        facts = path.stat()
        return _digest(path.absolute(), facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns)
    except OSError as error:
        raise UnreadableMesh(f"cannot read {path}: {error.strerror}", "check the file and its rights") from error


def is_there(path: Path) -> bool:
    """Return whether there is anything of this name, be it a link that leads nowhere."""
    return path.is_symlink() or path.exists()


def text_of(path: Path) -> str:
    """Text of a list of shapes or of settings.

    Raises
    ------
    DatasetError
        If it cannot be read, or is not UTF-8.
    """
    try:
        if not path.is_file():
            raise DatasetError(f"{path} is no file, or a link that leads nowhere", "correct it or remove it")
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"cannot read {path}: {error}", "correct the file or remove it") from error


@functools.lru_cache(maxsize=65536)
def _digest(path: Path, size: int, modified: int, changed: int) -> str:
    """Size and times are what the cache tells the versions of a file apart by."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _path(entry: Entry) -> Path:
    if entry.path is None:
        raise BenchmarkError(f"shape '{entry.identifier}' has no file", "generated shapes have their own loader")
    return entry.path
