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
from retrieval.neighbours import Places, Vectors
from retrieval.spherical_harmonics import RESOLUTION, SphericalHarmonics

__all__ = ["EnergyIndex"]

#: Units in which an energy, which is at most about 1, is a whole number.
_UNIT = 2.0**-20


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

    @property
    def vectors(self) -> Vectors:
        """See :class:`retrieval.neighbours.GalleryIndex`."""
        return np.round(self.energies / _UNIT).astype(np.float32)

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
