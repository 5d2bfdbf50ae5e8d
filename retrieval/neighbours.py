"""The nearest shapes of each shape without all pairs: candidates by vectors, and exact distances of these alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["CANDIDATES", "FEWEST_CANDIDATES", "GalleryIndex", "Nearest", "among_candidates", "candidates", "nearest"]

Places = NDArray[np.int64]

#: Candidates for each neighbour that is wanted, and how many there are at least; chosen on generated bodies, see
#: docs/appendix/scale.md.
CANDIDATES, FEWEST_CANDIDATES = 10, 500
#: Forms that are looked at together.
ROWS = 64


class GalleryIndex(Protocol):
    """The part of a gallery of N forms that a scorer keeps to compare some pairs without all others."""

    def __len__(self) -> int: ...

    def closeness(self, forms: slice) -> NDArray[np.floating[Any]]:
        """Return how close all N forms are to some of them by their vectors, larger for a closer one, shape (n, N).

        It costs far less than the dissimilarities, and is in whole numbers, the same on every machine.
        """
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

    A shape among the nearest of another is looked at for its own, too. Shapes as far away as the last one wanted
    are kept as well, so that no order of the gallery decides between them.

    Parameters
    ----------
    index
        The gallery, of N shapes.
    count
        Neighbours of each shape; with N - 1 or more nothing is left out.
    """
    from scipy.sparse import coo_array

    n_shapes = len(index)
    parts = [among_candidates(index, count, range(a, min(a + ROWS, n_shapes))) for a in range(0, n_shapes, ROWS)]
    rows, columns, distances = (np.concatenate(each) for each in zip(*parts, strict=True))
    pairs, first = np.unique(np.minimum(rows, columns) * n_shapes + np.maximum(rows, columns), return_index=True)
    rows, columns = np.divmod(pairs, n_shapes)
    both = (np.concatenate([rows, columns]), np.concatenate([columns, rows]))
    matrix = coo_array((np.tile(distances[first], 2), both), shape=(n_shapes, n_shapes)).tocsr()
    kept = [_smallest(matrix.data[a:b], count) for a, b in zip(matrix.indptr[:-1], matrix.indptr[1:], strict=True)]
    order = np.concatenate([start + own for start, own in zip(matrix.indptr, kept, strict=False)])
    offsets = np.concatenate([[0], np.cumsum([len(own) for own in kept])]).astype(np.int64)
    return Nearest(offsets, matrix.indices[order].astype(np.int32), matrix.data[order])


def among_candidates(index: GalleryIndex, count: int, forms: range) -> tuple[Places, Places, NDArray[np.float64]]:
    """Return the nearest of the candidates of some forms: place of the form, place of the other, dissimilarity."""
    found = candidates(index, max(FEWEST_CANDIDATES, CANDIDATES * count), forms)
    rows = np.repeat(np.arange(forms.start, forms.stop), found.shape[1])
    distances = index.distances(rows, found.ravel())
    kept = [_smallest(own, count) + k * found.shape[1] for k, own in enumerate(distances.reshape(found.shape))]
    chosen = np.concatenate(kept)
    return rows[chosen], found.ravel()[chosen], distances[chosen]


def candidates(index: GalleryIndex, count: int, forms: range | None = None) -> Places:
    """Return the places of the forms that are closest to some by their vectors, the closest first.

    Parameters
    ----------
    index
        The gallery, of N forms.
    count
        Wanted for each; at most the N - 1 others are returned.
    forms
        Places of the forms, n of them; None for all.

    Returns
    -------
    numpy.ndarray
        Shape (n, count).
    """
    wanted = forms or range(len(index))
    most = min(count, len(index) - 1)
    found = np.empty((len(wanted), most), dtype=np.int64)
    for start in range(wanted.start, wanted.stop, ROWS):
        rows = np.arange(start, min(start + ROWS, wanted.stop))
        close = index.closeness(slice(start, rows[-1] + 1))
        close[np.arange(len(rows)), rows] = -np.inf
        found[rows - wanted.start] = [_smallest(-row, most)[:most] for row in close]  # of equals the first, everywhere
    return found


def _smallest(distances: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Places of the smallest distances in ascending order, with all that tie with the last one."""
    if count < len(distances):
        kept = np.flatnonzero(distances <= np.partition(distances, count - 1)[count - 1])
    else:
        kept = np.arange(len(distances))
    return kept[np.argsort(distances[kept], kind="stable")]
