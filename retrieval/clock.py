"""Clock matching: compare two forms over the 24 rotations of one view sphere against the other.

Only views of the same orbit of the cube group ever meet: 1332 of the 4356 pairs of 66 views. For each view, an inverted
index gives the sums of minima with the views of a whole block of forms, word by word, so that the work is proportional
to the words that two forms share; each sum is then added to the rotations in which it counts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from retrieval.views import view_sphere

Counts = NDArray[np.int32]
Forms = NDArray[np.int16]
Targets = NDArray[np.uint16]
Progress = Callable[[int, int], None]

#: Number of forms in one inverted index: the similarities of one view with 24 views of each form, and the sums over the
#: 24 rotations, stay in the first-level cache.
BLOCK = 96
#: Number of rows compared with a block at once, so that an interrupt takes effect in a fraction of a second.
ROWS = 512


class _Orbits(NamedTuple):
    """Views by their orbit of the cube group."""

    #: Orbit of each view, place of the view in it, and views sorted by both, shape (V,) each.
    of_view: Counts
    places: Counts
    by_orbit: Counts
    #: Place of the view that meets each view after each of the 24 rotations, shape (24, V).
    places_met: Counts
    #: Number of views of each orbit, and its start among the sorted views.
    sizes: Counts
    starts: Counts
    #: Adding and subtracting this rounds a number in [0, 1] to a multiple of 2^-45 (66 views). Sums over all views are
    #: then exact in any order: exchanging or renaming two forms cannot change the last bit of a distance and break a
    #: tie.
    rounding: float


@cache
def _orbits_of(n_views: int) -> _Orbits:
    sphere = view_sphere((n_views - 2).bit_length() // 2 - 1)  # of 4^(subdivisions + 1) + 2 views
    sizes = np.bincount(sphere.orbits).astype(np.int32)
    starts = (np.cumsum(sizes) - sizes).astype(np.int32)
    by_orbit = np.argsort(sphere.orbits, kind="stable").astype(np.int32)
    places = np.empty(n_views, dtype=np.int32)
    places[by_orbit] = np.arange(n_views) - np.repeat(starts, sizes)
    rounding = 2.0 ** np.ceil(np.log2(n_views))
    return _Orbits(sphere.orbits, places, by_orbit, places[sphere.permutations], sizes, starts, float(rounding))


@dataclass(frozen=True, eq=False)
class Signature:
    """Word counts of each view of one form.

    Parameters
    ----------
    words
        Shape (k,), int32: words of view 0 in ascending order, then those of view 1, and so on.
    counts
        Shape (k,), int32: number of occurrences of each, at least 1.
    view_offsets
        Shape (number of views + 1,), int32: view v owns the entries ``view_offsets[v]`` to ``view_offsets[v + 1]``.
    mirrored
        Signature of the mirror image of the form, if the scorer needs it.
    """

    words: Counts
    counts: Counts
    view_offsets: Counts
    mirrored: Signature | None = None

    @property
    def view_sizes(self) -> Counts:
        """Number of keypoints in each view, shape (number of views,)."""
        running = np.concatenate([[0], np.cumsum(self.counts)])
        return np.asarray(np.diff(running[self.view_offsets]), dtype=np.int32)

    @property
    def views(self) -> Counts:
        """View of each entry, shape (k,)."""
        return np.repeat(np.arange(len(self.view_offsets) - 1, dtype=np.int32), np.diff(self.view_offsets))

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return plain arrays for an ``.npz`` file."""
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
        Shape (number of views + 1,): first descriptor of each view.
    n_words
        Size of the codebook.
    """
    n_views = len(view_offsets) - 1
    views = np.repeat(np.arange(n_views), np.diff(view_offsets))
    keys, counts = np.unique(views * n_words + words, return_counts=True)
    offsets = np.searchsorted(keys, np.arange(n_views + 1) * n_words)
    return Signature((keys % n_words).astype(np.int32), counts.astype(np.int32), offsets.astype(np.int32))


def match_all(
    signatures: Sequence[Signature], threads: int = 1, progress: Progress | None = None
) -> NDArray[np.float64]:
    """Compute the clock-matching dissimilarities of all pairs.

    The dissimilarity of two views is 1 - sum_k min(h1_k, h2_k) / max(sum h1, sum h2), with 0 for two empty views and 1
    for an empty and a non-empty one. That of two forms is the smallest sum over the views among the 24 rotations.

    Parameters
    ----------
    signatures
        One per form, N in all, all with the same views.
    threads
        Number of threads; the result does not depend on it.
    progress
        Called with the number of finished columns, and N, after each block of columns.

    Returns
    -------
    numpy.ndarray
        Shape (N, N), float64 in [0, number of views], symmetric, zero diagonal.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF", Machine Vision and Applications 24, 2013, section 3.
    """
    distances = _match(signatures, signatures, threads, progress, symmetric=True)
    for start in range(0, len(distances), BLOCK):
        # So far only entries above the diagonal are filled.
        square = distances[start : start + BLOCK, start : start + BLOCK]
        square += square.T
        distances[start + BLOCK :, start : start + BLOCK] = distances[start : start + BLOCK, start + BLOCK :].T
    return distances


def match_across(
    first: Sequence[Signature], second: Sequence[Signature], threads: int = 1, progress: Progress | None = None
) -> NDArray[np.float64]:
    """Compute the dissimilarities of :func:`match_all` of each of M forms to each of N others, shape (M, N)."""
    return _match(first, second, threads, progress, symmetric=False)


def _match(
    rows: Sequence[Signature],
    columns: Sequence[Signature],
    threads: int,
    progress: Progress | None,
    *,
    symmetric: bool,
) -> NDArray[np.float64]:
    distances = np.zeros((len(rows), len(columns)))
    if distances.size == 0:
        return distances
    orbits = _orbits_of(len(rows[0].view_offsets) - 1)
    row_sizes = np.array([s.view_sizes for s in rows], dtype=np.int32)
    n_words = 1 + max((int(s.words.max()) for s in (*rows, *columns) if len(s.words)), default=0)
    first_entries = np.concatenate([[0], np.cumsum([len(s.words) for s in rows])[:-1]])
    row_offsets = first_entries[:, None] + np.array([s.view_offsets for s in rows], dtype=np.int64)
    row_counts = np.concatenate([s.counts for s in rows])
    row_groups = np.concatenate([_groups(s, orbits) for s in rows])
    entries = (row_offsets, row_groups, row_counts, row_sizes)
    met = (orbits.of_view, orbits.places_met, orbits.sizes, orbits.starts, orbits.rounding)
    pool = ThreadPoolExecutor(max(threads, 1))
    try:
        for start in range(0, len(columns), BLOCK):
            block = columns[start : start + BLOCK]
            index = _invert(block, n_words, orbits)
            sizes = np.array([s.view_sizes[orbits.by_orbit] for s in block], dtype=np.int32).T.copy()
            last_row = min(len(rows), start + len(block)) if symmetric else len(rows)
            n_tasks = max(threads, 1) * -(-last_row // (max(threads, 1) * ROWS))
            tasks = []
            for task in range(n_tasks):
                own_rows = np.arange(task, last_row, n_tasks)
                first_columns = np.maximum(own_rows + 1 - start, 0) if symmetric else np.zeros_like(own_rows)
                target = distances[:, start : start + len(block)]
                arguments: tuple[Any, ...] = (own_rows, first_columns, *entries, *index, sizes, *met, target)
                tasks.append(pool.submit(_match_rows, *arguments))
            for submitted in tasks:
                submitted.result()
            if progress is not None:
                progress(start + len(block), len(columns))
    finally:
        # After an interrupt, pending tasks never start.
        pool.shutdown(cancel_futures=True)
    return distances


def _groups(signature: Signature, orbits: _Orbits) -> Counts:
    """Return the number of the (word, orbit) group of each entry."""
    return signature.words * np.int32(len(orbits.sizes)) + orbits.of_view[signature.views]


def _invert(
    signatures: Sequence[Signature], n_words: int, orbits: _Orbits
) -> tuple[NDArray[np.int64], Forms, Targets, Counts]:
    """Build the inverted index of a block: postings of each (word, orbit) group, sorted by form.

    Returns the offsets of the groups, and for each posting its form, its target (place of the view in its orbit *
    number of forms + form) and its count.
    """
    forms = np.repeat(np.arange(len(signatures)), [len(s.words) for s in signatures])
    views = np.concatenate([s.views for s in signatures])
    groups = np.concatenate([_groups(s, orbits) for s in signatures])
    counts = np.concatenate([s.counts for s in signatures])
    # Narrow types keep the postings of a block in the second-level cache.
    targets = (orbits.places[views] * len(signatures) + forms).astype(np.uint16)
    index: tuple[NDArray[np.int64], Forms, Targets, Counts] = _sorted_by_group(
        groups, forms.astype(np.int16), targets, counts, n_words * len(orbits.sizes)
    )
    return index


@njit(cache=True, nogil=True)
def _sorted_by_group(
    groups: Counts, forms: Forms, targets: Targets, counts: Counts, n_groups: int
) -> tuple[NDArray[np.int64], Forms, Targets, Counts]:
    """Sort postings by group with a counting sort; postings of a group keep their order."""
    offsets = np.zeros(n_groups + 1, dtype=np.int64)
    for group in groups:
        offsets[group + 1] += 1
    offsets = np.cumsum(offsets)
    place = offsets.copy()
    of_form, of_target, of_count = np.empty_like(forms), np.empty_like(targets), np.empty_like(counts)
    for posting in range(len(groups)):
        to = place[groups[posting]]
        of_form[to], of_target[to], of_count[to] = forms[posting], targets[posting], counts[posting]
        place[groups[posting]] += 1
    return offsets, of_form, of_target, of_count


@njit(cache=True, nogil=True, error_model="numpy")
def _match_rows(
    rows: NDArray[np.int64],
    first_columns: NDArray[np.int64],
    row_offsets: NDArray[np.int64],
    row_groups: Counts,
    row_counts: Counts,
    row_sizes: Counts,
    posting_offsets: NDArray[np.int64],
    posting_forms: Forms,
    posting_targets: Targets,
    posting_counts: Counts,
    column_sizes: Counts,
    orbits: Counts,
    places_met: Counts,
    orbit_sizes: Counts,
    orbit_starts: Counts,
    rounding: float,
    distances: NDArray[np.float64],
) -> None:
    """Fill the given rows, ascending, of one block of columns, from the first column of each row."""
    n_turns, n_views = places_met.shape
    n_columns = column_sizes.shape[1]
    # One number per place in an orbit (the largest has 24) and form.
    shared = np.empty(orbit_sizes.max() * n_columns, dtype=np.int32)
    similarity = np.empty((orbit_sizes.max(), n_columns))
    totals = np.empty((n_turns, n_columns))
    begins = posting_offsets.copy()
    for r in range(len(rows)):
        row, first = rows[r], first_columns[r]
        if first >= n_columns:
            continue
        totals[:] = 0.0
        for view in range(n_views):
            orbit, size = orbits[view], row_sizes[row, view]
            n_places = orbit_sizes[orbit]
            shared[: n_places * n_columns] = 0
            for entry in range(row_offsets[row, view], row_offsets[row, view + 1]):
                group, count = row_groups[entry], row_counts[entry]
                end = posting_offsets[group + 1]
                # The first column never decreases from row to row: skipped postings are never needed again.
                while begins[group] < end and posting_forms[begins[group]] < first:
                    begins[group] += 1
                targets, counts = posting_targets[begins[group] : end], posting_counts[begins[group] : end]
                for posting in range(len(targets)):
                    shared[targets[posting]] += min(count, counts[posting])
            for place in range(n_places):
                others = column_sizes[orbit_starts[orbit] + place, first:]
                own = shared[place * n_columns + first : (place + 1) * n_columns]
                alike = similarity[place, first:]
                for column in range(len(alike)):
                    # Two empty views: 1 / 1.
                    larger = max(size, others[column])
                    ratio = (own[column] + (larger == 0)) / max(larger, 1)
                    alike[column] = (ratio + rounding) - rounding
            for turn in range(n_turns):
                total, alike = totals[turn, first:], similarity[places_met[turn, view], first:]
                for column in range(len(alike)):
                    total[column] += alike[column]
        for column in range(first, n_columns):
            distances[row, column] = n_views - totals[:, column].max()
