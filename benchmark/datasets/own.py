"""Adapter from data sets of plugin files to the interface of the harness."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from benchmark.datasets.base import Entry
from benchmark.datasets.files import file_digest
from benchmark.errors import DatasetError, UnreadableMesh
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.io import read_mesh
from benchmark.geometry.mesh import Mesh
from benchmark.plugins.inspection import plugins_of
from benchmark.plugins.specs import DatasetSpec

__all__ = ["OwnDataset", "data_sets_of", "is_own", "open_own", "sources_in"]

#: Separator between the path of a plugin file and a class name in a data set source.
_MARK = ".py:"


class OwnDataset:
    """A data set of a plugin file; see :class:`~benchmark.datasets.base.Dataset`."""

    stand_in_for = ""

    def __init__(self, spec: DatasetSpec) -> None:
        self.spec, self.code = spec, spec.module
        self.name, self.title, self.half_width = spec.info.name, spec.info.title, spec.info.half_width
        self.entries = spec.entries

    @property
    def sources(self) -> dict[str, str]:
        """Parts of the plugin."""
        return self.spec.sources

    @property
    def files(self) -> dict[str, str]:
        """Digests of the files that the plugin has read so far."""
        return self.spec.remote.files

    def load(self, entry: Entry) -> Mesh:
        """Generate or read the mesh; raises ``UnreadableMesh`` if there is none, also if the plugin fails."""
        if "load" in self.spec.offers:
            arrays = self.spec.ask("load", entry.identifier)[1]
            return Mesh(arrays["vertices"], arrays["faces"])
        if entry.path is None:
            raise UnreadableMesh(
                f"data set '{self.name}', shape '{entry.identifier}': has no file",
                "give the entry a path, or the class a 'load'",
            )
        return read_mesh(entry.path)

    def recipe(self, entry: Entry) -> str:
        """Return the names of set and shape, the parameters, and the plugin's recipe or the digest of the file."""
        if "recipe" in self.spec.offers:
            outside = str(self.spec.ask("recipe", entry.identifier)[0]["recipe"])
        else:
            outside = file_digest(entry.path) if entry.path else ""
        return " ".join(filter(None, (self.name, entry.identifier, self.spec.parameters_text, outside)))

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera of a shape."""
        if "camera" not in self.spec.offers:
            return FRONT
        facts, _ = self.spec.ask("camera", entry.identifier)
        camera = Camera(tuple(facts["direction"]), tuple(facts["up"]))
        object.__setattr__(camera, "up", tuple(facts["up"]))  # normalising again may change the last bits
        return camera


def is_own(source: str) -> bool:
    """Return whether a source is a class in a plugin file."""
    return _MARK in source


def open_own(source: str) -> OwnDataset:
    """Open the data set of a plugin file.

    Parameters
    ----------
    source
        Source from :func:`data_sets_of`: ``"/path/to/file.py:ClassName"``.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, or has no such class.
    DatasetError
        If the list of shapes is invalid.
    """
    return OwnDataset(DatasetSpec(source.rpartition(":")[2], source))


def data_sets_of(paths: Iterable[Path]) -> dict[str, str]:
    """Return the data sets of plugin files, as sources for :func:`open_own` by name.

    Raises
    ------
    ConfigurationError
        If a file cannot be imported, or a data set has invalid metadata.
    DatasetError
        If two data sets have the same name.
    """
    targets: dict[str, str] = {}
    for path in paths:
        for spec in plugins_of(DatasetSpec, path):
            if spec.base_name in targets:
                raise DatasetError(
                    f"two data sets are called '{spec.base_name}': {targets[spec.base_name]} and {path}", "rename one"
                )
            targets[spec.base_name] = spec.target
    return targets


def sources_in(path: str) -> dict[str, str]:
    """Return the parts of a plugin file with a data set, given its absolute path."""
    return plugins_of(DatasetSpec, Path(path))[0].sources
