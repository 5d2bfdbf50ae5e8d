"""Data sets that modify the meshes of another data set on loading."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import get_args

from benchmark.api.contracts import Input
from benchmark.datasets.base import Dataset, Entry
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.mesh import Mesh

__all__ = ["ChangedDataset"]


@dataclass(frozen=True)
class ChangedDataset(ABC):
    """Base class of modified data sets, with everything inherited from the clean data set.

    Parameters
    ----------
    clean
        The unmodified data set.
    """

    clean: Dataset

    @property
    def stand_in_for(self) -> str:
        """Name of the official set that the clean set replaces."""
        return self.clean.stand_in_for

    @property
    def half_width(self) -> float | None:
        """Half the width of the camera's frame, as in the clean set."""
        return self.clean.half_width

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Shapes of the clean set, without file paths."""
        return tuple(Entry(entry.identifier, entry.subject, entry.pose) for entry in self.clean.entries)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs supported by the clean set."""
        inputs: tuple[Input, ...] = getattr(self.clean, "inputs", get_args(Input))
        return inputs

    @property
    def canonical_poses(self) -> Mapping[str, str]:
        """Canonical poses by subject, if set in the clean set."""
        poses: Mapping[str, str] = getattr(self.clean, "canonical_poses", {})
        return poses

    def camera(self, entry: Entry) -> Camera:
        """Return the camera of the clean set."""
        return self.clean.camera(self.clean_entry(entry))

    def sensor(self, entry: Entry) -> DepthSensor | None:
        """Return the depth sensor of the clean set; None for an ideal camera."""
        sensor = getattr(self.clean, "sensor", None)
        return sensor(self.clean_entry(entry)) if sensor else None

    @cached_property
    def _clean_entries(self) -> dict[str, Entry]:
        return {entry.identifier: entry for entry in self.clean.entries}

    def clean_entry(self, entry: Entry) -> Entry:
        """Return the corresponding shape of the clean set."""
        return self._clean_entries[entry.identifier]

    @abstractmethod
    def changed(self, mesh: Mesh, entry: Entry) -> Mesh:
        """Modify a mesh of the clean set."""

    def load(self, entry: Entry) -> Mesh:
        """Return the modified mesh; errors are those of the clean set and of :meth:`changed`."""
        return self.changed(self.clean.load(self.clean_entry(entry)), entry)

    def _clean_recipe(self, entry: Entry) -> str:
        """Return the recipe of the mesh in the clean set."""
        return self.clean.recipe(self.clean_entry(entry))
