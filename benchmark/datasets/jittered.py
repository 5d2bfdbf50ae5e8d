"""A data set whose vertices are jittered by a millionth of their extent, to be prepared anew: ``tosca[jitter=2]``."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.perturbations.surface import noise
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.mesh import Mesh
from benchmark.system.fingerprints import fingerprint

__all__ = ["AMOUNT", "Jittered", "clean_dataset", "clean_name", "jittered", "jittered_name", "parsed_jitter"]

AMOUNT = 1e-6
"""Standard deviation of each coordinate, in longest sides of the bounding box: what files with seven digits round."""

_NAME = re.compile(r"(?P<clean>.+)\[jitter=(?P<number>[1-9][0-9]*)\]", re.DOTALL)


def jittered_name(clean: str, number: int) -> str:
    """Return the name of a data set that is jittered for the n-th time."""
    return f"{clean}[jitter={number}]"


def parsed_jitter(name: str) -> tuple[str, int] | None:
    """Return the clean data set and the number of a name; None where it names no jittered set."""
    match = _NAME.fullmatch(name)
    return (match["clean"], int(match["number"])) if match else None


def clean_name(name: str) -> str:
    """Return the name of a data set without its jitter."""
    found = parsed_jitter(name)
    return found[0] if found else name


def clean_dataset(dataset: Dataset) -> Dataset:
    """Return a data set without its jitter."""
    return dataset.clean if isinstance(dataset, Jittered) else dataset


def jittered(mesh: Mesh, seed: int, amount: float = AMOUNT) -> Mesh:
    """Return a mesh whose vertices are moved by independent Gaussian noise, in longest sides of the bounding box."""
    return noise(mesh, amount, np.random.default_rng(seed))


@dataclass(frozen=True)
class Jittered:
    """All shapes of a data set, jittered.

    Parameters
    ----------
    clean
        The data set.
    number
        Which jitter, from 1; each draws its own noise.
    """

    clean: Dataset
    number: int

    @property
    def name(self) -> str:
        """Name in plans and records."""
        return jittered_name(self.clean.name, self.number)

    @property
    def title(self) -> str:
        """Name in captions."""
        return f"{self.clean.title}, jitter {self.number}"

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

    @cached_property
    def _clean_entries(self) -> dict[str, Entry]:
        return {entry.identifier: entry for entry in self.clean.entries}

    def load(self, entry: Entry) -> Mesh:
        """Return the jittered mesh; errors are those of the clean set."""
        return jittered(self.clean.load(self._clean_entries[entry.identifier]), self._seed(entry))

    def recipe(self, entry: Entry) -> str:
        """Name what determines the mesh, the code of the clean set with it."""
        clean = self.clean.recipe(self._clean_entries[entry.identifier])
        code = getattr(self.clean, "code", type(self.clean).__module__)  # that of a plugin is its file
        return f"{clean} {fingerprint(code).digest} {AMOUNT!r} {self._seed(entry)}"

    def camera(self, entry: Entry) -> Camera:
        """Return the camera of the clean set."""
        return self.clean.camera(self._clean_entries[entry.identifier])

    def sensor(self, entry: Entry) -> DepthSensor | None:
        """Return what the depth camera of the clean set adds to its image; None for one without faults."""
        found = getattr(self.clean, "sensor", None)
        return found(self._clean_entries[entry.identifier]) if found else None

    def _seed(self, entry: Entry) -> int:
        name = f"jitter|{self.number}|{entry.identifier}".encode("utf-8", "surrogatepass")
        return int.from_bytes(hashlib.sha256(name).digest()[:4], "big")
