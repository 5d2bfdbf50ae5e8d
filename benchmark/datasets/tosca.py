"""TOSCA high resolution (Bronstein, Bronstein, Kimmel 2008), in any of its official layouts."""

from __future__ import annotations

import re
from pathlib import Path

from benchmark.datasets.base import Entry, FileDataset, natural_key
from benchmark.datasets.folder import mesh_files
from benchmark.errors import DatasetError
from benchmark.geometry.depth import FRONT, SIDE, Camera

#: Classes whose long axis is y: the depth camera looks at their side.
QUADRUPEDS = frozenset({"cat", "centaur", "dog", "horse", "wolf"})

#: The null pose of each class is number 0, except where the official set has none.
CANONICAL_POSE = {"gorilla": "5"}

_STEM = re.compile(r"^(?P<subject>[a-z]+)(?P<pose>\d+)$")


def tosca(data_root: Path) -> FileDataset:
    """Read the list of shapes under ``DATA_ROOT/tosca``.

    Raises
    ------
    DatasetError
        If the folder is missing, or holds no file named like ``cat0.off``, ``cat0.mat`` or ``cat0.vert``.
    """
    folder = data_root / "tosca"
    entries = []
    for path in mesh_files(folder):
        match = _STEM.match(path.stem.lower())
        if match:
            entries.append(Entry(path.stem.lower(), match["subject"], match["pose"], path))
    if not entries:
        raise DatasetError(
            f"no TOSCA meshes in {folder}", "expected files such as cat0.off, cat0.mat or cat0.vert + cat0.tri"
        )
    entries.sort(key=lambda entry: natural_key(entry.identifier))
    return FileDataset(name="tosca", title="TOSCA", entries=tuple(entries), camera_for=camera)


def camera(entry: Entry) -> Camera:
    """Quadrupeds are seen from the side, people and gorillas from the front; z is up."""
    return SIDE if entry.subject in QUADRUPEDS else FRONT
