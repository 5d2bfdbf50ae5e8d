"""A data set whose vertices are jittered by a millionth of their extent, to be prepared anew: ``tosca[jitter=2]``."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass

import numpy as np

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.changed import ChangedDataset
from benchmark.datasets.perturbations.surface import noise
from benchmark.geometry.mesh import Mesh

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
    parts = parsed_jitter(name)
    return parts[0] if parts else name


def clean_dataset(dataset: Dataset) -> Dataset:
    """Return a data set without its jitter."""
    return dataset.clean if isinstance(dataset, Jittered) else dataset


def jittered(mesh: Mesh, seed: int, amount: float = AMOUNT) -> Mesh:
    """Return a mesh whose vertices are moved by independent Gaussian noise, in longest sides of the bounding box."""
    return noise(mesh, amount, np.random.default_rng(seed))


@dataclass(frozen=True)
class Jittered(ChangedDataset):
    """All shapes of a data set, jittered.

    Parameters
    ----------
    number
        Which jitter, from 1; each draws its own noise.
    """

    number: int

    @property
    def name(self) -> str:
        """Name in plans and records."""
        return jittered_name(self.clean.name, self.number)

    @property
    def title(self) -> str:
        """Name in captions."""
        return f"{self.clean.title}, jitter {self.number}"

    def changed(self, mesh: Mesh, entry: Entry) -> Mesh:
        """Return the jittered mesh."""
        return jittered(mesh, self._seed(entry))

    def recipe(self, entry: Entry) -> str:
        """Name what determines the mesh, the code of the clean set with it."""
        return f"{self._clean_recipe(entry)} {AMOUNT!r} {self._seed(entry)}"

    def _seed(self, entry: Entry) -> int:
        name = f"jitter|{self.number}|{entry.identifier}".encode("utf-8", "surrogatepass")
        return int.from_bytes(hashlib.sha256(name).digest()[:4], "big")
