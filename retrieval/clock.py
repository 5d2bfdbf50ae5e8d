"""Clock matching: compare two forms over the 24 rotations of one view sphere against the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.machine import in_threads

#: Numbers and occurrences of words and views.
Counts = NDArray[np.int32]

#: Number of rotations of the view sphere onto itself: those of the cube.
N_ROTATIONS = 24

#: Adding and subtracting this rounds a similarity to a multiple of 2^-43: sums over the views are
#: then exact in any order, so that exchanging two forms cannot break a tie.
ROUNDING = 2.0**9

#: Places in arrays, without a sign.
Indices = NDArray[np.uint32]
#: Numbers of occurrences, for products.
Singles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Histograms:
    """Word counts of each view of one form.

    Parameters
    ----------
    words
        Shape (k,), int32: words of view 0 in ascending order, then those of view 1, and so on.
    counts
        Shape (k,), int32: number of occurrences of each, at least 1.
    views
        Shape (k,), int32: view of each.
    view_sizes
        Shape (number of views,), int32: number of keypoints in each view.
    """

    words: Counts
    counts: Counts
    views: Counts
    view_sizes: Counts


def count_words(words: NDArray[np.int32], view_offsets: Counts, n_words: int) -> Histograms:
    """Count how often each word occurs in each view of a form.

    Parameters
    ----------
    words
        Nearest word of each of the k descriptors, view by view, shape (k,).
    view_offsets
        Index of the first descriptor of each view, and finally k; shape (number of views + 1,).
    n_words
        Size of the codebook.
    """
    sizes = np.diff(view_offsets)
    view_of_word = np.repeat(np.arange(len(sizes)), sizes)
    # Combine view and word in one number, so that equal pairs can be counted.
    keys, counts = np.unique(view_of_word * n_words + words, return_counts=True)
    views, distinct = np.divmod(keys, n_words)
    return Histograms(
        words=distinct.astype(np.int32),
        counts=counts.astype(np.int32),
        views=views.astype(np.int32),
        view_sizes=sizes,
    )


def match(
    rows: Sequence[Histograms],
    columns: Sequence[Histograms],
    permutations: NDArray[np.int32],
    n_words: int,
) -> NDArray[np.float64]:
    """Compute the clock-matching dissimilarities of each of M forms to each of N others.

    The dissimilarity of two views is 1 - sum_k min(h1_k, h2_k) / max(sum h1, sum h2), with 0 for
    two empty views and 1 for an empty and a non-empty one. That of two forms is the smallest sum
    over the views among the rotations.

    Parameters
    ----------
    rows, columns
        One per form, all with the same views. If they are the same sequence, each pair is computed
        once.
    permutations
        View that meets each view after each rotation, shape (24, number of views).
    n_words
        Size of the codebook.

    Returns
    -------
    numpy.ndarray
        Shape (M, N), float64 in [0, number of views]; exactly symmetric, with zero diagonal, for
        the same forms.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF", Machine Vision and Applications 24, 2013, section 3.
    """
    n_views = permutations.shape[1]
    orbit, place = _orbits(permutations)
    n_orbits = int(orbit.max()) + 1
    width = int(place.max()) + 1
    # A slot is a view of a column and one of the row that it may meet; no rotation takes a view out
    # of its orbit.
    slots = np.arange(n_views) * width + place[permutations]
    partner = np.full(n_views * width, n_views)
    partner[slots] = permutations
    order = np.argsort(slots, axis=None, kind="stable")
    turns = (order // n_views).astype(np.uint32)
    first_turns = np.searchsorted(slots.ravel()[order], np.arange(n_views * width + 1)).astype(
        np.uint32
    )

    def cells(form: Histograms) -> Indices:
        """Return the cell of each entry: a word in an orbit."""
        return (form.words * np.int32(n_orbits) + orbit[form.views]).astype(np.uint32)

    ends = np.cumsum([0, *(len(form.words) for form in columns)])
    entries = (
        np.concatenate([cells(form) for form in columns]),
        np.concatenate([(form.views * width).astype(np.uint32) for form in columns]),
        np.concatenate([form.counts.astype(np.float32) for form in columns]),
    )
    sizes = np.array([form.view_sizes for form in columns], dtype=np.float64)
    distances = np.zeros((len(rows), len(columns)))

    def compare(index: int) -> None:
        """Compute the distances of one row; if columns are the rows, to those behind it."""
        row = rows[index]
        row_cells = cells(row)
        order = np.argsort(row_cells, kind="stable")
        begins = np.searchsorted(row_cells[order], np.arange(n_words * n_orbits + 1))
        row_entries = (
            begins.astype(np.uint32),
            place[row.views][order].astype(np.uint32),
            row.counts[order].astype(np.float32),
        )
        row_sizes = np.append(row.view_sizes, 0).astype(np.float64)[partner]
        first = index + 1 if rows is columns else 0
        shared = _largest_similarities(
            row_entries, row_sizes, entries, ends[first:], sizes[first:], first_turns, turns
        )
        distances[index, first:] = n_views - shared

    in_threads(compare, range(len(rows)))
    return distances + distances.T if rows is columns else distances


def _orbits(permutations: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the orbit of each view under the rotations, and its place therein, shape (V,) each."""
    smallest = permutations.min(axis=0)
    places = [int((smallest[:view] == orbit).sum()) for view, orbit in enumerate(smallest)]
    _, orbits = np.unique(smallest, return_inverse=True)
    return orbits.astype(np.int32), np.array(places, dtype=np.int32)


@njit(cache=True, nogil=True, error_model="numpy")
def _largest_similarities(
    own: tuple[Indices, Indices, Singles],
    own_sizes: NDArray[np.float64],
    entries: tuple[Indices, Indices, Singles],
    ends: NDArray[np.int64],
    sizes: NDArray[np.float64],
    first_turns: Indices,
    turns: Indices,
) -> NDArray[np.float64]:
    """Return the similarity of one form to each of some others, in the best of all rotations.

    A rotation brings each view of the one form together with a view of the other. The similarity of
    two views is the number of keypoints with a word in common over that of the fuller view; those
    of all views are summed. A *slot* is a pair of views that some rotation brings together,
    numbered by the view of the other form and the place of the own view in the orbit of both under
    the rotations. A *cell* is a word in an orbit.

    Parameters
    ----------
    own
        The one form: index of the first entry of each cell, and place in its orbit and number of
        keypoints of each entry, ordered by cell.
    own_sizes
        Number of keypoints in the own view of each slot, shape (slots,).
    entries
        The others, one after the other: cell, first slot and number of keypoints of each entry.
    ends
        Index of the first entry of each other form, and of the end of the last one, shape (others +
        1,).
    sizes
        Number of keypoints in each view of each other form, shape (others, views).
    first_turns, turns
        The rotations that bring the views of a slot together: those of slot s are
        ``turns[first_turns[s] : first_turns[s + 1]]``.

    Returns
    -------
    numpy.ndarray
        Similarities in [0, number of views], shape (others,).
    """
    begins, places, own_counts = own
    cells, bases, counts = entries
    n_slots = len(own_sizes)
    width = len(own_sizes) // sizes.shape[1]
    # Keypoints of the same word that the two views of each slot share, and the slots with any. One
    # more entry, as a slot is written before it is counted.
    shared = np.zeros(n_slots, dtype=np.float32)
    touched = np.empty(n_slots + 1, dtype=np.uint32)
    largest = np.empty(len(sizes))
    for other in range(len(sizes)):
        # For each entry of the other form, the own entries of the same word in views that meet.
        n_touched = np.uint64(0)
        for entry in range(np.uint64(ends[other]), np.uint64(ends[other + 1])):
            cell = np.uint64(cells[entry])
            base = np.uint64(bases[entry])
            count = counts[entry]
            for mine in range(np.uint64(begins[cell]), np.uint64(begins[cell + np.uint64(1)])):
                slot = base + np.uint64(places[mine])
                before = shared[slot]
                touched[n_touched] = slot
                n_touched += np.uint64(before == 0)
                shared[slot] = before + min(count, own_counts[mine])
        # The similarity of each pair of views counts for the rotations that bring them together.
        totals = np.zeros(N_ROTATIONS)
        for k in range(n_touched):
            slot = np.uint64(touched[k])
            larger = max(own_sizes[slot], sizes[other, slot // np.uint64(width)])
            similarity = (shared[slot] / larger + ROUNDING) - ROUNDING
            shared[slot] = 0
            for turn in range(
                np.uint64(first_turns[slot]), np.uint64(first_turns[slot + np.uint64(1)])
            ):
                totals[turns[turn]] += similarity
        # Two views without keypoints are equal, which no entry says.
        for view in np.flatnonzero(sizes[other] == 0):
            for place in range(width):
                slot = view * width + place
                for turn in range(first_turns[slot], first_turns[slot + 1]):
                    both_are_empty = own_sizes[slot] == 0
                    totals[turns[turn]] += both_are_empty
        largest[other] = totals.max()
    return largest
