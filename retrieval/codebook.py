"""Visual words of a gallery, and the nearest word of each descriptor."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import DatasetError

Descriptors = NDArray[np.uint8]

#: Number of descriptors compared with the codebook at once: 1024 x 1500 single-precision scores stay in the cache.
BLOCK = 1024


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
    words, hashes = np.empty((0, 128), dtype=np.uint8), np.empty(0, dtype=np.uint64)
    for of_form in descriptors:
        rows = np.concatenate([words, of_form])
        hashes, first = np.unique(np.concatenate([hashes, _hash(of_form, seed)]), return_index=True)
        words, hashes = rows[first[:n_words]], hashes[:n_words]
    if not len(words):
        raise DatasetError(
            "no view of any shape of the gallery has a keypoint",
            "check the forms (are they flat or empty?) or lower the peak threshold",
        )
    return words


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
    nearest = np.empty(len(descriptors), dtype=np.int32)
    for start in range(0, len(descriptors), BLOCK):
        scores = descriptors[start : start + BLOCK].astype(np.float32) @ (2.0 * words) - (words * words).sum(axis=0)
        nearest[start : start + BLOCK] = scores.argmax(axis=1)
    return nearest


def _hash(rows: Descriptors, seed: int) -> NDArray[np.uint64]:
    """Hash each row of bytes to 64 bits, with the finaliser of splitmix64 [Steele, Lea, Flood 2014] as the mixer."""
    state = np.full(len(rows), _mix(np.array([seed % 2**64], dtype=np.uint64))[0])
    for column in np.ascontiguousarray(rows).view(np.uint64).T:
        state = _mix(state ^ column)
    return state


def _mix(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = state + np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(state ^ (state >> np.uint64(31)))
