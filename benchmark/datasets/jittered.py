"""Data sets with vertices jittered by a millionth of the extent before preparation: ``tosca[jitter=2]``."""

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
"""Standard deviation per coordinate, as a fraction of the longest bounding box side: like rounding to seven digits."""

_NAME = re.compile(r"(?P<clean>.+)\[jitter=(?P<number>[1-9][0-9]*)\]", re.DOTALL)


def jittered_name(clean: str, number: int) -> str:
    """Return the name of the n-th jitter of a data set."""
    return f"{clean}[jitter={number}]"


def parsed_jitter(name: str) -> tuple[str, int] | None:
    """Return the clean data set and the number in a name; None if it is not the name of a jittered set."""
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
    """Add independent Gaussian noise to the vertices, relative to the longest side of the bounding box."""
    return noise(mesh, amount, np.random.default_rng(seed))


@dataclass(frozen=True)
class Jittered(ChangedDataset):
    """A data set with jittered shapes.

    Parameters
    ----------
    number
        Number of the jitter, from 1, which seeds the noise.
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
        """Jitter a mesh."""
        return jittered(mesh, self._seed(entry))

    def recipe(self, entry: Entry) -> str:
        """Return the recipe of the clean mesh, the amount of jitter and the seed."""
        return f"{self._clean_recipe(entry)} {AMOUNT!r} {self._seed(entry)}"

    def _seed(self, entry: Entry) -> int:
        name = f"jitter|{self.number}|{entry.identifier}".encode("utf-8", "surrogatepass")
        return int.from_bytes(hashlib.sha256(name).digest()[:4], "big")
