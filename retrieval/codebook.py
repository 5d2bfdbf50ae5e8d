"""Visual words of a gallery, and the nearest word of each descriptor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import DatasetError

Descriptors = NDArray[np.uint8]

#: Number of descriptors compared with the codebook at once: 1024 x 1500 single-precision scores stay in the cache.
BLOCK = 1024

#: Number of descriptors from which words are drawn at once.
POOL = 2**18


def sample_codebook(descriptors: Iterable[Descriptors], n_words: int, seed: int) -> Descriptors:
    """Draw distinct descriptors at random as words, without clustering.

    Every distinct descriptor has the same chance. The draw depends only on the set of descriptors and the seed, not on
    the order of the shapes: the words are the descriptors with the smallest values of a seeded hash.

    Parameters
    ----------
    descriptors
        One array of shape (k, 128), uint8, per form of the gallery; read once.
    n_words
        Size of the codebook. If there are fewer distinct descriptors, all of them become words.
    seed
        Seed of the random draw.

    Returns
    -------
    numpy.ndarray
        Shape (n_words or fewer, 128), uint8.

    Raises
    ------
    DatasetError
        If there are no descriptors.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF", Machine Vision and Applications 24, 2013 (random words are as good as clusters).
    """
    words = np.empty((0, 128), dtype=np.uint8)
    hashes = np.empty(0, dtype=np.uint64)
    for pool in _pooled(descriptors):
        of_pool = _hash(pool, seed)
        if len(words) == n_words:
            below = of_pool <= hashes[-1]  # no others can become words
            pool, of_pool = pool[below], of_pool[below]
        words, hashes = _smallest(np.concatenate([words, pool]), np.concatenate([hashes, of_pool]), n_words)
    if not len(words):
        raise DatasetError(
            "no view of any shape of the gallery has a keypoint",
            "check the forms (are they flat or empty?) or lower the peak threshold",
        )
    return np.ascontiguousarray(words)


def _pooled(descriptors: Iterable[Descriptors]) -> Iterator[Descriptors]:
    """Yield the descriptors of a few forms at a time: those of a large gallery together would need its memory twice."""
    pool: list[Descriptors] = []
    size = 0
    for part in descriptors:
        pool.append(part)
        size += len(part)
        if size >= POOL:
            yield np.concatenate(pool)
            pool, size = [], 0
    if pool:
        yield np.concatenate(pool)


def _smallest(rows: Descriptors, hashes: NDArray[np.uint64], count: int) -> tuple[Descriptors, NDArray[np.uint64]]:
    """Return the distinct rows with the smallest hashes, at most ``count``, sorted by hash and then by bytes."""
    # More than needed, because of duplicates; all rows in the rare case that this is too few.
    for taken in (min(len(rows), 4 * count), len(rows)):
        if taken < len(rows):
            nearest = np.flatnonzero(hashes <= np.partition(hashes, taken - 1)[taken - 1])
        else:
            nearest = np.arange(len(rows))
        order = nearest[np.lexsort((*rows[nearest].T[::-1], hashes[nearest]))]
        candidates = rows[order]
        is_new = np.concatenate([[True], (candidates[1:] != candidates[:-1]).any(axis=1)])[: len(candidates)]
        if is_new.sum() >= count:
            break
    return candidates[is_new][:count], hashes[order][is_new][:count]


def nearest_words(descriptors: Descriptors, codebook: Descriptors) -> NDArray[np.int32]:
    """Return the index of the nearest word of each descriptor in Euclidean distance; the lowest index wins a tie.

    The search is exact and gives the same bits with any BLAS: the nearest word c to x maximises 2 x.c - c.c, and every
    partial sum of this is an integer below 2^24, which single precision holds exactly.

    Parameters
    ----------
    descriptors
        Shape (k, 128), uint8.
    codebook
        Shape (n_words, 128), uint8.

    Returns
    -------
    numpy.ndarray
        Shape (k,), int32.
    """
    words = codebook.astype(np.float32).T
    squares = (words * words).sum(axis=0)
    doubled = 2.0 * words
    nearest = np.empty(len(descriptors), dtype=np.int32)
    for start in range(0, len(descriptors), BLOCK):
        scores = descriptors[start : start + BLOCK].astype(np.float32) @ doubled
        scores -= squares
        nearest[start : start + BLOCK] = scores.argmax(axis=1)
    return nearest


def _hash(rows: Descriptors, seed: int) -> NDArray[np.uint64]:
    """Hash each row of bytes to 64 bits, with the finaliser of splitmix64 [Steele, Lea, Flood 2014] as the mixer."""
    columns = np.ascontiguousarray(rows).view(np.uint64)
    state = np.full(len(rows), _mix(np.array([seed % 2**64], dtype=np.uint64))[0])
    for column in columns.T:
        state = _mix(state ^ column)
    return state


def _mix(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = state + np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(state ^ (state >> np.uint64(31)))
