"""TOSCA high resolution (Bronstein, Bronstein, Kimmel 2008), in any of its official layouts."""

from __future__ import annotations

import re
from pathlib import Path

from benchmark.datasets.base import Entry, natural_key
from benchmark.datasets.files import FolderDataset
from benchmark.datasets.folder import mesh_files
from benchmark.datasets.official.layouts import folders_of_set
from benchmark.datasets.settings import with_settings
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT, SIDE, Camera

#: Classes with long axis y, viewed from the side by the depth camera.
QUADRUPEDS = frozenset({"cat", "centaur", "dog", "horse", "wolf"})

#: Number of shapes per class.
CLASS_SIZES = {
    "cat": 11,
    "centaur": 6,
    "david": 7,
    "dog": 9,
    "gorilla": 4,
    "horse": 8,
    "michael": 20,
    "victoria": 12,
    "wolf": 3,
}

#: The null pose of each class is number 0; there is no gorilla0, and gorilla1 stands upright.
CANONICAL_POSE = {subject: "1" if subject == "gorilla" else "0" for subject in CLASS_SIZES}

_STEM = re.compile(r"(?P<subject>[a-z]+)(?P<pose>[0-9]+)")


def tosca(data_root: Path) -> FolderDataset:
    """Read the list of shapes in ``DATA_ROOT/tosca`` and its sub-folders.

    A ``dataset.toml`` may set canonical poses and cameras.

    Raises
    ------
    DatasetError
        If the folder is missing, contains no file such as ``cat0.off``, ``cat0.mat`` or ``cat0.vert``, or contains two
        files for the same shape.
    ConfigurationError
        If ``dataset.toml`` has an unknown key, class or pose.
    """
    folder = data_root / "tosca"
    entries: dict[str, Entry] = {}
    for path in (path for place in folders_of_set(folder) for path in mesh_files(place)):
        match = _STEM.fullmatch(path.stem.lower())
        if not match:
            continue
        entry = Entry(match[0], match["subject"], match["pose"], path)
        other = entries.setdefault(entry.identifier, entry)
        if other.path != path:
            raise DatasetError(f"{folder} holds one shape as {other.path} and {path}", "keep one of them")
    if not entries:
        raise DatasetError(
            f"no TOSCA meshes in {folder}", "expected files such as cat0.off, cat0.mat or cat0.vert + cat0.tri"
        )
    ordered = sorted(entries.values(), key=lambda entry: natural_key(entry.identifier))
    return with_settings(
        FolderDataset(
            name="tosca",
            title="TOSCA",
            entries=tuple(ordered),
            camera_for=camera,
            folder=folder,
            canonical_poses=CANONICAL_POSE,
        )
    )


def camera(entry: Entry) -> Camera:
    """Return the side view for quadrupeds, the front view for people and gorillas; z is up."""
    return SIDE if entry.subject in QUADRUPEDS else FRONT
