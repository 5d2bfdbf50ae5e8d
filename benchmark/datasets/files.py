"""Data sets of mesh files: reading of shapes and digests of their content."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from benchmark.datasets.base import Entry
from benchmark.errors import BenchmarkError, DatasetError
from benchmark.files import file_digest
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
        Function from entry to depth camera; None for the front view.
    folder
        The folder of the data set.
    canonical_poses
        Canonical poses by subject; the default is the first pose.
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
        """Return the digest of the file and of its companion triangle file, if any."""
        path = _path(entry)
        parts = (path, path.with_suffix(".tri")) if path.suffix.lower() == ".vert" else (path,)
        return "sha256:" + "+".join(file_digest(part) for part in parts)

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        return self.camera_for(entry) if self.camera_for else FRONT


def is_there(path: Path) -> bool:
    """Return whether the path exists, including broken links."""
    return path.is_symlink() or path.exists()


def text_of(path: Path) -> str:
    """Return the text of a list of shapes or a settings file.

    Raises
    ------
    DatasetError
        If the file is unreadable or not UTF-8.
    """
    try:
        if not path.is_file():
            raise DatasetError(f"{path} is no file, or a link that leads nowhere", "correct it or remove it")
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"cannot read {path}: {error}", "correct the file or remove it") from error


def _path(entry: Entry) -> Path:
    if entry.path is None:
        raise BenchmarkError(f"shape '{entry.identifier}' has no file", "generated shapes have their own loader")
    return entry.path
