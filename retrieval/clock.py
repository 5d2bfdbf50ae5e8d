"""Clock matching: compare two forms over the 24 rotations of one view sphere against the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Counts = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Histograms:
    """Word counts of each view of one form.

    Parameters
    ----------
    words
        Shape (k,), int32: words of view 0 in ascending order, then those of view 1, and so on.
    counts
        Shape (k,), int32: number of occurrences of each, at least 1.
    view_offsets
        Shape (number of views + 1,), int32: view v owns the entries ``view_offsets[v]`` to ``view_offsets[v + 1]``.
    """

    words: Counts
    counts: Counts
    view_offsets: Counts

    @property
    def view_sizes(self) -> Counts:
        """Number of keypoints in each view, shape (number of views,)."""
        running = np.concatenate([[0], np.cumsum(self.counts)])
        return np.asarray(np.diff(running[self.view_offsets]), dtype=np.int32)

    def dense(self, n_words: int) -> Counts:
        """Return the counts as a table, shape (n_words, number of views)."""
        table = np.zeros((n_words, len(self.view_offsets) - 1), dtype=np.int32)
        views = np.repeat(np.arange(table.shape[1]), np.diff(self.view_offsets))
        table[self.words, views] = self.counts
        return table


def count_words(words: NDArray[np.int32], view_offsets: Counts, n_words: int) -> Histograms:
    """Count the words of each view.

    Parameters
    ----------
    words
        Nearest word of each descriptor, shape (k,).
    view_offsets
        Shape (number of views + 1,): first descriptor of each view.
    n_words
        Size of the codebook.
    """
    n_views = len(view_offsets) - 1
    views = np.repeat(np.arange(n_views), np.diff(view_offsets))
    keys, counts = np.unique(views * n_words + words, return_counts=True)
    offsets = np.searchsorted(keys, np.arange(n_views + 1) * n_words)
    return Histograms((keys % n_words).astype(np.int32), counts.astype(np.int32), offsets.astype(np.int32))


def match(
    rows: Sequence[Histograms], columns: Sequence[Histograms], permutations: NDArray[np.int32], n_words: int
) -> NDArray[np.float64]:
    """Compute the clock-matching dissimilarities of each of M forms to each of N others.

    The dissimilarity of two views is 1 - sum_k min(h1_k, h2_k) / max(sum h1, sum h2), with 0 for two empty views and 1
    for an empty and a non-empty one. That of two forms is the smallest sum over the views among the rotations.

    Parameters
    ----------
    rows, columns
        One per form, all with the same views. If they are the same sequence, each pair is computed once.
    permutations
        View that meets each view after each rotation, shape (24, number of views).
    n_words
        Size of the codebook.

    Returns
    -------
    numpy.ndarray
        Shape (M, N), float64 in [0, number of views]; exactly symmetric, with zero diagonal, for the same forms.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF", Machine Vision and Applications 24, 2013, section 3.
    """
    distances = np.zeros((len(rows), len(columns)))
    sizes = [form.view_sizes for form in columns]
    for place, row in enumerate(rows):
        table, of_row = row.dense(n_words), row.view_sizes
        for other in range(place + 1 if rows is columns else 0, len(columns)):
            form = columns[other]
            distances[place, other] = _dissimilarity(
                table, of_row, form.words, form.counts, form.view_offsets, sizes[other], permutations
            )
    return distances + distances.T if rows is columns else distances


@njit(cache=True, nogil=True)
def _dissimilarity(
    table: Counts,
    table_sizes: Counts,
    words: Counts,
    counts: Counts,
    view_offsets: Counts,
    sizes: Counts,
    permutations: NDArray[np.int32],
) -> float:
    n_views = len(sizes)
    shared = np.zeros((n_views, n_views), dtype=np.int32)
    for view in range(n_views):
        row = shared[view]
        for entry in range(view_offsets[view], view_offsets[view + 1]):
            column, count = table[words[entry]], counts[entry]
            for other in range(n_views):
                row[other] += min(count, column[other])
    # Adding and subtracting this rounds a similarity to a multiple of 2^-43: sums over the views are then exact in any
    # order, so that exchanging two forms cannot break a tie.
    rounding, most = 2.0**9, 0.0
    for turn in range(len(permutations)):
        total = 0.0
        for view in range(n_views):
            other = permutations[turn, view]
            larger = max(sizes[view], table_sizes[other])
            similarity = shared[view, other] / larger if larger > 0 else 1.0
            total += (similarity + rounding) - rounding
        most = max(most, total)
    return n_views - most
