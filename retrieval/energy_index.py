"""Index of the scorer by spherical harmonics: its signatures are vectors already."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from benchmark.api.scoring import SignatureArrays
from retrieval.neighbours import Places
from retrieval.spherical_harmonics import RESOLUTION, SphericalHarmonics

__all__ = ["EnergyIndex"]


@dataclass(frozen=True, eq=False)
class EnergyIndex:
    """The energies of N forms, shape (N, k); see :class:`retrieval.neighbours.GalleryIndex`."""

    energies: NDArray[np.float64]

    @classmethod
    def of(cls, scorer: SphericalHarmonics, signatures: Sequence[SignatureArrays], draw: int) -> EnergyIndex:
        """Put the signatures of a gallery together; there is nothing to draw."""
        return cls(np.array([signatures[place]["energies"].ravel() for place in range(len(signatures))]))

    def with_query(self, scorer: SphericalHarmonics, signature: SignatureArrays) -> EnergyIndex:
        """Return the same with one more form at the end."""
        return EnergyIndex(np.concatenate([self.energies, signature["energies"].reshape(1, -1)]))

    def __len__(self) -> int:
        return len(self.energies)

    def closeness(self, forms: slice) -> NDArray[np.float64]:
        """See :class:`retrieval.neighbours.GalleryIndex`: the distances themselves, with the other sign."""
        return np.asarray(-np.round(cdist(self.energies[forms], self.energies) / RESOLUTION))

    def distances(self, first: Places, second: Places) -> NDArray[np.float64]:
        """See :class:`retrieval.neighbours.GalleryIndex`."""
        bounds = [*np.flatnonzero(np.diff(first, prepend=-1)), len(first)]
        found = np.empty(len(first))
        for start, end in itertools.pairwise(bounds):
            own = self.energies[first[start] : first[start] + 1]
            found[start:end] = cdist(own, self.energies[second[start:end]])[0]
        return np.asarray(np.round(found / RESOLUTION) * RESOLUTION)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Plain arrays for an ``.npz`` file."""
        return {"energies": self.energies}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> EnergyIndex:
        """Rebuild it from :meth:`to_arrays`."""
        return cls(arrays["energies"])
