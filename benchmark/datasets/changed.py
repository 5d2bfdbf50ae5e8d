"""A data set whose meshes are those of another one, changed when they are loaded."""

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
    """All that a changed data set has of the clean one.

    Parameters
    ----------
    clean
        The data set.
    """

    clean: Dataset

    @property
    def stand_in_for(self) -> str:
        """Return what the clean set stands in for."""
        return self.clean.stand_in_for

    @property
    def half_width(self) -> float | None:
        """Half the width of the camera's frame, that of the clean set."""
        return self.clean.half_width

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The shapes of the clean set; none has a file of its own."""
        return tuple(Entry(entry.identifier, entry.subject, entry.pose) for entry in self.clean.entries)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs that the clean set can be ranked under."""
        inputs: tuple[Input, ...] = getattr(self.clean, "inputs", get_args(Input))
        return inputs

    @property
    def canonical_poses(self) -> Mapping[str, str]:
        """Canonical pose of each subject of which the clean set names one."""
        poses: Mapping[str, str] = getattr(self.clean, "canonical_poses", {})
        return poses

    def camera(self, entry: Entry) -> Camera:
        """Return the camera of the clean set."""
        return self.clean.camera(self.clean_entry(entry))

    def sensor(self, entry: Entry) -> DepthSensor | None:
        """Return what the depth camera of the clean set adds to its image; None for one without faults."""
        sensor = getattr(self.clean, "sensor", None)
        return sensor(self.clean_entry(entry)) if sensor else None

    @cached_property
    def _clean_entries(self) -> dict[str, Entry]:
        return {entry.identifier: entry for entry in self.clean.entries}

    def clean_entry(self, entry: Entry) -> Entry:
        """Return the shape of the clean set."""
        return self._clean_entries[entry.identifier]

    @abstractmethod
    def changed(self, mesh: Mesh, entry: Entry) -> Mesh:
        """Return the mesh of the clean set as this set has it."""

    def load(self, entry: Entry) -> Mesh:
        """Return the changed mesh; errors are those of the clean set and of :meth:`changed`."""
        return self.changed(self.clean.load(self.clean_entry(entry)), entry)

    def _clean_recipe(self, entry: Entry) -> str:
        """Name what determines the mesh of the clean set."""
        return self.clean.recipe(self.clean_entry(entry))
