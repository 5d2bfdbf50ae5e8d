"""Isotonic regression over pairs of vertices that are sorted only once."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from baselines._kernels.smacof import lossless_single
from benchmark.api.contracts import FloatArray


@dataclass(frozen=True, eq=False)
class RankedPairs:
    """All pairs of vertices in the order of their dissimilarity.

    Parameters
    ----------
    first, second
        Vertices of each pair, shape (n (n - 1) / 2,).
    tie_ends
        For each group of equal dissimilarities, the position after its last pair, ascending.
    """

    first: NDArray[np.int32]
    second: NDArray[np.int32]
    tie_ends: NDArray[np.int64]

    @classmethod
    def of(cls, dissimilarities: FloatArray) -> RankedPairs:
        """Sort the pairs of a symmetric matrix, shape (n, n)."""
        narrow = lossless_single(dissimilarities) + np.float32(0)  # turns -0 into 0
        # Geodesic distances are stored in single precision. Positive floats have the order of their bits, so a radix
        # sort applies, in a tenth of the time of a comparison sort.
        if narrow.dtype == np.float32 and len(narrow) <= MOST_IN_A_BYTE_PAIR and not np.signbit(narrow).any():
            return cls(*_dealt(narrow.view(np.uint32)))
        first, second = (part.astype(np.int32) for part in np.triu_indices(len(dissimilarities), 1))
        values = dissimilarities[first, second]
        order = values.argsort()
        values = values[order]
        last = np.append(np.flatnonzero(values[1:] > values[:-1]), len(values) - 1)
        return cls(first[order], second[order], last + 1)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the Euclidean distance of each pair, for positions of shape (n, 3)."""
        result = np.empty(len(self.first))
        _fill_distances(points, self.first, self.second, result)
        return result

    def attractions(self, points: FloatArray, distances: FloatArray, targets: FloatArray) -> FloatArray:
        r"""Return :math:`\sum_j (t_{ij} / d_{ij}) (x_i - x_j)` for each vertex i, shape (n, 3).

        Parameters
        ----------
        points
            Positions x, shape (n, 3).
        distances, targets
            Distances d and targets t of each pair; coincident points contribute nothing.
        """
        sums = np.zeros_like(points)
        _add_attractions(points, self.first, self.second, distances, targets, sums)
        return sums


def isotonic_regression(values: FloatArray, tie_ends: NDArray[np.int64]) -> FloatArray:
    """Return the non-decreasing sequence nearest to the values in the least-squares sense.

    Pool adjacent violators (Kruskal 1964; Barlow et al. 1972). Tied values share one fitted value (Kruskal's secondary
    approach), so the result does not depend on the order within a tie.

    Parameters
    ----------
    values
        Sequence to fit, shape (m,).
    tie_ends
        For each group of ties, the position after its last value, ascending and ending with m.

    Returns
    -------
    numpy.ndarray
        Fitted values, shape (m,).
    """
    fitted = np.empty_like(values)
    _pool_adjacent_violators(values, tie_ends, fitted)
    return fitted


MOST_IN_A_BYTE_PAIR = 2**16
_DIGIT = 11
_DIGITS = 3
"""Bits per digit, and number of digits in 32 bits."""


@numba.njit(cache=True, nogil=True)
def _dealt(bits):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Radix-sort the pairs by 32-bit keys, least digit first, and return the fields of :class:`RankedPairs`."""
    n = bits.shape[0]
    count = n * (n - 1) // 2
    keys, names = np.empty(count, np.uint32), np.empty(count, np.uint32)
    radix = 1 << _DIGIT
    # The counts of each digit add up to the number of pairs, so a place is always below it.
    places = np.zeros((_DIGITS, radix), np.int64)
    at = 0
    for i in range(n):
        for j in range(i + 1, n):
            key = bits[i, j]
            keys[at], names[at] = key, np.uint32(i << 16 | j)
            at += 1
            for digit in range(_DIGITS):
                places[digit, (key >> np.uint32(_DIGIT * digit)) & np.uint32(radix - 1)] += 1
    other_keys, other_names = np.empty_like(keys), np.empty_like(names)
    for digit in range(_DIGITS):
        place = np.cumsum(places[digit]) - places[digit]
        shift = np.uint32(_DIGIT * digit)
        for at in range(count):
            key = keys[at]
            value = (key >> shift) & np.uint32(radix - 1)
            other_keys[place[value]], other_names[place[value]] = key, names[at]
            place[value] += 1
        keys, other_keys, names, other_names = other_keys, keys, other_names, names
    first, second, ends = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.int64)
    groups = 0
    for at in range(count):
        first[at], second[at] = names[at] >> np.uint32(16), names[at] & np.uint32(0xFFFF)
        if at + 1 == count or keys[at + 1] != keys[at]:
            ends[groups] = at + 1
            groups += 1
    return first, second, ends[:groups].copy()


_CHUNK = 64
"""Groups per chunk of the first, coarse regression; the result does not depend on it, and the time hardly."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _append_block(sums, ends, blocks, total, end):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Push a block onto the stack, pool it with its predecessors while the means fall, return the new stack height."""
    begin = ends[blocks - 1] if blocks > 0 else 0
    while blocks > 0:
        before = ends[blocks - 2] if blocks > 1 else 0
        if sums[blocks - 1] * (end - begin) < total * (begin - before):
            break
        blocks -= 1
        total += sums[blocks]
        begin = before
    sums[blocks] = total
    ends[blocks] = end
    return blocks + 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _pool_adjacent_violators(values, tie_ends, fitted):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    # The fit is the slope of the greatest convex minorant of the cumulative sum, and a block can only end where the
    # sum touches the minorant. The minorant over chunks lies nowhere below it, so no block ends where the sum exceeds
    # the chunks' minorant: one cheap pass excludes all but a few per cent of the places.
    groups = len(tie_ends)
    chunks = (groups + _CHUNK - 1) // _CHUNK
    # Each chunk, and later each group, enters its stack at most once; pooled blocks leave it.
    chunk_sums, chunk_ends = np.empty(chunks), np.empty(chunks, np.int64)
    chunk_blocks = 0
    begin = 0
    for chunk in range(chunks):
        end = tie_ends[min((chunk + 1) * _CHUNK, groups) - 1]
        chunk_blocks = _append_block(chunk_sums, chunk_ends, chunk_blocks, values[begin:end].sum(), end)
        begin = end

    sums, ends = np.empty(groups), np.empty(groups, np.int64)
    blocks = 0
    group = 0
    begin = 0
    for chunk_block in range(chunk_blocks):
        stop = chunk_ends[chunk_block]
        slope = chunk_sums[chunk_block] / (stop - begin)
        excess = total = 0.0
        while begin < stop:
            end = tie_ends[group]
            group += 1
            for place in range(begin, end):
                total += values[place]
                excess += values[place] - slope
            begin = end
            if excess <= 0.0 or begin == stop:
                blocks = _append_block(sums, ends, blocks, total, end)
                total = 0.0

    begin = 0
    for block in range(blocks):
        fitted[begin : ends[block]] = sums[block] / (ends[block] - begin)
        begin = ends[block]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fill_distances(points, first, second, distances):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for pair in range(len(first)):
        i, j = first[pair], second[pair]
        dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
        distances[pair] = np.sqrt(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_attractions(points, first, second, distances, targets, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for pair in range(len(first)):
        if distances[pair] > 0.0:
            i, j = first[pair], second[pair]
            ratio = targets[pair] / distances[pair]
            for axis in range(3):
                pull = ratio * (points[i, axis] - points[j, axis])
                sums[i, axis] += pull
                sums[j, axis] -= pull
