"""The nearest shapes of each shape without all pairs: candidates by vectors, and exact distances of these alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["CANDIDATES", "FEWEST_CANDIDATES", "GalleryIndex", "Nearest", "candidates", "nearest"]

Places = NDArray[np.int64]
Vectors = NDArray[np.float32]

#: Candidates for each neighbour that is wanted, and how many there are at least; chosen on generated bodies, see
#: docs/appendix/scale.md.
CANDIDATES, FEWEST_CANDIDATES = 5, 100


class GalleryIndex(Protocol):
    """What a scorer keeps of a gallery of N forms, so that some pairs can be compared without all others.

    The vectors, shape (N, k), are whole numbers, so that their order is the same on every machine; forms with a small
    dissimilarity have vectors with a small Euclidean distance.
    """

    @property
    def vectors(self) -> Vectors:
        """One vector a form, shape (N, k), float32."""
        ...

    def distances(self, first: Places, second: Places) -> NDArray[np.float64]:
        """Return the dissimilarities of pairs of forms, shape (P,), the same as in the matrix of all pairs.

        Parameters
        ----------
        first, second
            Places in the gallery, shape (P,) each; the first ones ascending.
        """
        ...


@dataclass(frozen=True, eq=False)
class Nearest:
    """A sparse matrix: the shapes nearest to each shape of a gallery.

    Parameters
    ----------
    offsets
        Shape (N + 1,): shape i owns the entries ``offsets[i]`` to ``offsets[i + 1]``, the nearest first.
    shapes
        Places of the other shapes in the gallery, shape (M,).
    distances
        Dissimilarities, shape (M,).
    """

    offsets: Places
    shapes: NDArray[np.int32]
    distances: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def of(self, place: int) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Return the neighbours of a shape and their dissimilarities, the nearest first."""
        own = slice(self.offsets[place], self.offsets[place + 1])
        return self.shapes[own], self.distances[own]

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Plain arrays for an ``.npz`` file."""
        return {"offsets": self.offsets, "neighbours": self.shapes, "neighbour_distances": self.distances}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Nearest:
        """Rebuild it from :meth:`to_arrays`."""
        return cls(arrays["offsets"], arrays["neighbours"], arrays["neighbour_distances"])


def nearest(index: GalleryIndex, count: int) -> Nearest:
    """Return the nearest shapes of each shape of a gallery.

    Two shapes are compared where either is a candidate of the other. Shapes as far away as the last one wanted are kept
    as well, so that no order of the gallery decides between them.

    Parameters
    ----------
    index
        The gallery, of N shapes.
    count
        Neighbours of each shape; with N - 1 or more nothing is left out.
    """
    from scipy.sparse import coo_array

    n_shapes = len(index.vectors)
    found = candidates(index.vectors, max(FEWEST_CANDIDATES, CANDIDATES * count))
    others = np.repeat(np.arange(n_shapes), found.shape[1])
    pairs = np.unique(np.minimum(others, found.ravel()) * n_shapes + np.maximum(others, found.ravel()))
    first, second = pairs // n_shapes, pairs % n_shapes
    distances = index.distances(first, second)
    rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
    matrix = coo_array((np.tile(distances, 2), (rows, columns)), shape=(n_shapes, n_shapes)).tocsr()
    kept = [_smallest(matrix.data[a:b], count) for a, b in zip(matrix.indptr[:-1], matrix.indptr[1:], strict=True)]
    order = np.concatenate([start + own for start, own in zip(matrix.indptr, kept, strict=False)])
    offsets = np.concatenate([[0], np.cumsum([len(own) for own in kept])]).astype(np.int64)
    return Nearest(offsets, matrix.indices[order].astype(np.int32), matrix.data[order])


def candidates(vectors: Vectors, count: int, queries: Vectors | None = None) -> Places:
    """Return the places of the nearest vectors in the Euclidean metric.

    Parameters
    ----------
    vectors
        Shape (N, k).
    count
        Wanted for each; at most all others, or all, are returned.
    queries
        Shape (M, k); None for the vectors themselves, none of which is a candidate of its own.

    Returns
    -------
    numpy.ndarray
        Shape (N, count) or (M, count), the nearest first.
    """
    from sklearn.neighbors import NearestNeighbors

    most = len(vectors) - (queries is None)
    if not most:
        return np.empty((len(vectors), 0), dtype=np.int64)
    search = NearestNeighbors(n_neighbors=min(count, most), algorithm="brute").fit(vectors)
    return np.asarray(search.kneighbors(queries, return_distance=False), dtype=np.int64)


def _smallest(distances: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Places of the smallest distances in ascending order, with all that tie with the last one."""
    if count < len(distances):
        kept = np.flatnonzero(distances <= np.partition(distances, count - 1)[count - 1])
    else:
        kept = np.arange(len(distances))
    return kept[np.argsort(distances[kept], kind="stable")]
