"""Clock matching: compare two forms over the 24 ways to turn one view sphere against the other.

Only views of the same orbit of the cube group ever meet: 1332 of the 4356 pairs of views. The sums of minima of all
these pairs come from an inverted index, word by word, so that the work is proportional to the words that two forms
share; the 24 candidates are then sums over a table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from retrieval.views import N_VIEWS, ORBITS, VIEW_PERMUTATIONS

Counts = NDArray[np.int32]

#: Forms in one inverted index: the table of 1332 minima for each of them stays in the second-level cache.
BLOCK = 96
N_ORBITS = int(ORBITS.max()) + 1
ORBIT_SIZES = np.bincount(ORBITS).astype(np.int32)
#: Place of a view inside its orbit.
PLACES = np.array([(ORBITS[:v] == ORBITS[v]).sum() for v in range(N_VIEWS)], dtype=np.int32)
#: Where the row of a view begins in the table of same-orbit pairs.
ROW_STARTS = np.concatenate([[0], np.cumsum(ORBIT_SIZES[ORBITS])[:-1]]).astype(np.int32)
N_PAIRS = int(ORBIT_SIZES[ORBITS].sum())
#: Entry of the table for each of the 24 rotations and each view, shape (24, 66).
CLOCK_ENTRIES = (ROW_STARTS + PLACES[VIEW_PERMUTATIONS]).astype(np.int32)
#: First view of each orbit's row of sizes, when the views are sorted by orbit and place.
ORBIT_STARTS = np.concatenate([[0], np.cumsum(ORBIT_SIZES)[:-1]]).astype(np.int32)
BY_ORBIT = np.argsort(ORBITS, kind="stable").astype(np.int32)
#: Adding and subtracting this rounds a number in [0, 1] to a multiple of 2^-45. Sums over 66 views are then exact,
#: whatever their order: exchanging or renaming two forms cannot change the last bit of a distance and so break a tie.
ROUNDING = 128.0


@dataclass(frozen=True, eq=False)
class Signature:
    """How often each word occurs in each view of one form.

    Parameters
    ----------
    words
        Shape (k,), int32: words of view 0 in ascending order, then those of view 1, and so on.
    counts
        Shape (k,), int32: their numbers of occurrences, at least 1.
    view_offsets
        Shape (67,), int32: view v owns the entries ``view_offsets[v]`` to ``view_offsets[v + 1]``.
    mirrored
        Signature of the mirror image of the form, if the scorer asks for it.
    """

    words: Counts
    counts: Counts
    view_offsets: Counts
    mirrored: Signature | None = None

    @property
    def view_sizes(self) -> Counts:
        """Number of keypoints in each view, shape (66,)."""
        running = np.concatenate([[0], np.cumsum(self.counts)])
        return np.asarray(np.diff(running[self.view_offsets]), dtype=np.int32)

    @property
    def views(self) -> Counts:
        """View of each entry, shape (k,)."""
        return np.repeat(np.arange(N_VIEWS, dtype=np.int32), np.diff(self.view_offsets))

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Plain arrays for an ``.npz`` file."""
        arrays = {"words": self.words, "counts": self.counts, "view_offsets": self.view_offsets}
        if self.mirrored is not None:
            arrays |= {f"mirrored_{name}": array for name, array in self.mirrored.to_arrays().items()}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Signature:
        """Rebuild the signature from :meth:`to_arrays`."""
        mirrored = None
        if "mirrored_words" in arrays:
            mirrored = cls(arrays["mirrored_words"], arrays["mirrored_counts"], arrays["mirrored_view_offsets"])
        return cls(arrays["words"], arrays["counts"], arrays["view_offsets"], mirrored)


def count_words(words: NDArray[np.int32], view_offsets: Counts, n_words: int) -> Signature:
    """Count the words of each view.

    Parameters
    ----------
    words
        Nearest word of each descriptor, shape (k,).
    view_offsets
        Shape (67,): first descriptor of each view.
    n_words
        Size of the codebook.
    """
    views = np.repeat(np.arange(N_VIEWS), np.diff(view_offsets))
    keys, counts = np.unique(views * n_words + words, return_counts=True)
    offsets = np.searchsorted(keys, np.arange(N_VIEWS + 1) * n_words)
    return Signature((keys % n_words).astype(np.int32), counts.astype(np.int32), offsets.astype(np.int32))


def match_all(signatures: Sequence[Signature], threads: int = 1) -> NDArray[np.float64]:
    """Clock-matching dissimilarities of all pairs.

    Two views compare by 1 - sum_k min(h1_k, h2_k) / max(sum h1, sum h2); two empty views are equal (0), an empty and a
    filled one share nothing (1). Two forms compare by the smallest sum over the 66 views among the 24 rotations.

    Parameters
    ----------
    signatures
        One per form, N in all.
    threads
        Threads that share the work; the result does not depend on it.

    Returns
    -------
    numpy.ndarray
        Shape (N, N), float64 in [0, 66], symmetric, zero diagonal.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF", Machine Vision and Applications 24, 2013, section 3.
    """
    distances = _match(signatures, signatures, threads, symmetric=True)
    upper = np.triu(distances, 1)
    return np.asarray(upper + upper.T)


def match_across(first: Sequence[Signature], second: Sequence[Signature], threads: int = 1) -> NDArray[np.float64]:
    """Dissimilarities as in :func:`match_all`, of each of M forms to each of N others, shape (M, N)."""
    return _match(first, second, threads, symmetric=False)


def _match(
    rows: Sequence[Signature], columns: Sequence[Signature], threads: int, *, symmetric: bool
) -> NDArray[np.float64]:
    distances = np.zeros((len(rows), len(columns)))
    if distances.size == 0:
        return distances
    row_sizes = np.array([s.view_sizes for s in rows], dtype=np.int32).reshape(-1, N_VIEWS)
    n_words = 1 + max((int(s.words.max()) for s in (*rows, *columns) if len(s.words)), default=0)
    row_offsets = np.concatenate([[0], np.cumsum([len(s.words) for s in rows])]).astype(np.int64)
    row_views = np.concatenate([s.views for s in rows])
    row_counts = np.concatenate([s.counts for s in rows])
    row_groups = np.concatenate([s.words for s in rows]) * np.int32(N_ORBITS) + ORBITS[row_views]
    entries = (row_offsets, row_groups, row_views, row_counts, row_sizes)
    with ThreadPoolExecutor(max(threads, 1)) as pool:
        tasks = []
        for start in range(0, len(columns), BLOCK):
            block = columns[start : start + BLOCK]
            index = _invert(block, n_words)
            sizes = np.array([s.view_sizes[BY_ORBIT] for s in block], dtype=np.int32)
            last_row = min(len(rows), start + len(block)) if symmetric else len(rows)
            for thread in range(max(threads, 1)):
                own_rows = np.arange(thread, last_row, max(threads, 1))
                first_columns = np.maximum(own_rows + 1 - start, 0) if symmetric else np.zeros_like(own_rows)
                target = distances[:, start : start + len(block)]
                arguments: tuple[Any, ...] = (own_rows, first_columns, *entries, *index, sizes, target)
                tasks.append(pool.submit(_match_rows, *arguments))
        for task in tasks:
            task.result()
    return distances


def _invert(signatures: Sequence[Signature], n_words: int) -> tuple[NDArray[np.int64], Counts, Counts]:
    """Inverted index of a block: postings of each (word, orbit), sorted by form.

    Returns the offsets of the groups, and for each posting form * 1332 + place of the view in its orbit, and its count.
    """
    forms = np.repeat(np.arange(len(signatures)), [len(s.words) for s in signatures])
    views = np.concatenate([s.views for s in signatures])
    groups = np.concatenate([s.words for s in signatures]) * N_ORBITS + ORBITS[views]
    order = np.lexsort((forms, groups))
    offsets = np.searchsorted(groups[order], np.arange(n_words * N_ORBITS + 1))
    targets = (forms * N_PAIRS + PLACES[views])[order].astype(np.int32)
    return offsets.astype(np.int64), targets, np.concatenate([s.counts for s in signatures])[order]


@njit(cache=True, nogil=True, error_model="numpy")
def _match_rows(
    rows: NDArray[np.int64],
    first_columns: NDArray[np.int64],
    row_offsets: NDArray[np.int64],
    row_groups: Counts,
    row_views: Counts,
    row_counts: Counts,
    row_sizes: Counts,
    posting_offsets: NDArray[np.int64],
    posting_targets: Counts,
    posting_counts: Counts,
    column_sizes: Counts,
    distances: NDArray[np.float64],
) -> None:
    """Fill the given rows of one block of columns, from the first column that each row asks for."""
    n_columns = column_sizes.shape[0]
    # A posting names form * 1332 + place, a view the start of its row; both are of one orbit, so the sum stays in the
    # table of the form.
    minima = np.zeros(n_columns * N_PAIRS, dtype=np.int32)
    similarity = np.empty(N_PAIRS)
    for r in range(len(rows)):
        row, first = rows[r], first_columns[r]
        if first >= n_columns:
            continue
        minima[first * N_PAIRS :] = 0
        for entry in range(row_offsets[row], row_offsets[row + 1]):
            group, count, shift = row_groups[entry], row_counts[entry], ROW_STARTS[row_views[entry]]
            begin, end = posting_offsets[group], posting_offsets[group + 1]
            if first > 0:
                begin += np.searchsorted(posting_targets[begin:end], first * N_PAIRS)
            for posting in range(begin, end):
                minima[posting_targets[posting] + shift] += min(count, posting_counts[posting])
        for column in range(first, n_columns):
            shared = minima[column * N_PAIRS : (column + 1) * N_PAIRS]
            for view in range(N_VIEWS):
                orbit, size, start = ORBITS[view], row_sizes[row, view], ROW_STARTS[view]
                others = column_sizes[column, ORBIT_STARTS[orbit] : ORBIT_STARTS[orbit] + ORBIT_SIZES[orbit]]
                for place in range(len(others)):
                    # Two empty views: 1 / 1.
                    larger = max(size, others[place])
                    ratio = (shared[start + place] + (larger == 0)) / max(larger, 1)
                    similarity[start + place] = (ratio + ROUNDING) - ROUNDING
            best = 0.0
            for turn in range(CLOCK_ENTRIES.shape[0]):
                total = 0.0
                for view in range(N_VIEWS):
                    total += similarity[CLOCK_ENTRIES[turn, view]]
                best = max(best, total)
            distances[row, column] = N_VIEWS - best
