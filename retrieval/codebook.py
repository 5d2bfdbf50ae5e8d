"""Visual words of a gallery, and the nearest word of each descriptor."""

from __future__ import annotations

import time
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.errors import DatasetError

#: Descriptors of keypoints, shape (k, 128).
Descriptors = NDArray[np.uint8]

#: Number of descriptors compared with the codebook at once: 1024 x 1500 scores stay in the cache.
BLOCK = 1024

#: Least number of descriptors of a gallery for which products of integers pay: torch takes more
#: than a second to load.
MANY = 200_000


def sample_codebook(descriptors: Iterable[Descriptors], n_words: int, seed: int) -> Descriptors:
    """Draw distinct descriptors at random as words, without clustering.

    Every distinct descriptor has the same chance. The draw depends only on the set of descriptors
    and the seed, not on the order of the shapes: the words are the descriptors with the smallest
    values of a seeded hash.

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
    Lian, Godil, Sun, Xiao, "CM-BOF", Machine Vision and Applications 24, 2013 (random words are as
    good as clusters).
    """
    words = np.empty((0, 128), dtype=np.uint8)
    hashes = np.empty(0, dtype=np.uint64)
    for of_form in descriptors:
        # Keep the descriptors with the smallest hashes. Equal ones have equal hashes, and so count
        # once.
        candidates = np.concatenate([words, of_form])
        all_hashes = np.concatenate([hashes, _hash(of_form, seed)])
        sorted_hashes, first = np.unique(all_hashes, return_index=True)
        words = candidates[first[:n_words]]
        hashes = sorted_hashes[:n_words]
    if not len(words):
        raise DatasetError(
            "no view of any shape of the gallery has a keypoint",
            "check the forms (are they flat or empty?) or lower the peak threshold",
        )
    return words


def nearest_words(
    descriptors: Descriptors, codebook: Descriptors, *, by_integers: bool = False
) -> NDArray[np.int32]:
    """Return the index of the nearest word of each descriptor in Euclidean distance.

    The lowest index wins a tie.

    The search is exact and gives the same bits on any processor: the nearest word c to x maximises
    2 x.c - c.c, hence also 2 (x - 128).(c - 128) + 256 sum(c) - c.c. These integers and all partial
    sums stay below 2^24, which single precision holds exactly.

    Parameters
    ----------
    descriptors
        Shape (k, 128), uint8.
    codebook
        Shape (n_words, 128), uint8.
    by_integers
        Whether to multiply bytes; see :func:`integers_pay`.

    Returns
    -------
    numpy.ndarray
        Shape (k,), int32.
    """
    words = codebook.astype(np.int32)
    offsets = (256 * words - words * words).sum(axis=1, dtype=np.int32)
    multiply = _integer_products if by_integers else _single_products
    nearest = np.empty(len(descriptors), dtype=np.int32)
    for start in range(0, len(descriptors), BLOCK):
        _find_best(multiply(descriptors[start : start + BLOCK], codebook), offsets, nearest[start:])
    return nearest


def _single_products(descriptors: Descriptors, words: Descriptors) -> NDArray[np.float32]:
    """Return the products of descriptors and words, both less 128, in single precision."""
    return (descriptors.astype(np.float32) - 128) @ (words.astype(np.float32) - 128).T


def _integer_products(descriptors: Descriptors, words: Descriptors) -> NDArray[np.int32]:
    """Return the products of descriptors and words, both less 128, of signed bytes."""
    import torch  # lazy: it takes a second

    left = torch.from_numpy((descriptors ^ 128).view(np.int8))
    right = torch.from_numpy((words ^ 128).view(np.int8))
    return np.asarray(torch._int_mm(left, right.T).numpy())


@cache
def integers_pay() -> bool:
    """Return whether this processor multiplies matrices of bytes exactly, and faster than floats.

    Without the instructions for it (VNNI), sums of products overflow.
    """
    # Try both ways on random descriptors with the least and the largest values.
    random = np.random.default_rng(0)
    extremes = np.array([0, 255], np.uint8)
    descriptors = random.choice(extremes, (BLOCK, 128))
    words = random.choice(extremes, (1500, 128))
    seconds: list[float] = []
    products: list[NDArray[Any]] = []
    for multiply in (_integer_products, _single_products):
        multiply(descriptors, words)  # the first use takes longer
        start = time.perf_counter()
        products.append(multiply(descriptors, words))
        seconds.append(time.perf_counter() - start)
    are_faster = seconds[0] < seconds[1]
    are_exact = np.array_equal(products[0], products[1])
    return are_faster and are_exact


@njit(cache=True, nogil=True)
def _find_best(products: NDArray[Any], offsets: NDArray[np.int32], best: NDArray[np.int32]) -> None:
    """Find the nearest word of each descriptor, the first of equally near ones.

    The squared distance |d - w|^2 is least for the word w with the largest 2 d.w - |w|^2.

    Parameters
    ----------
    products
        Scalar product d.w of each descriptor and each word, shape (descriptors, words).
    offsets
        The number -|w|^2 of each word, shape (words,).
    best
        Overwritten with the index of the nearest word, shape (descriptors,).
    """
    scores = np.empty(len(offsets), dtype=np.int32)
    for row in range(len(products)):
        # Two passes, for the highest score and for its place: the first one vectorises.
        highest = np.int32(-(2**31))
        for word in range(len(offsets)):
            scores[word] = np.int32(2) * np.int32(products[row, word]) + offsets[word]
            highest = max(highest, scores[word])
        word = 0
        while scores[word] != highest:
            word += 1
        best[row] = word


def _hash(rows: Descriptors, seed: int) -> NDArray[np.uint64]:
    """Hash each row of bytes to 64 bits.

    The mixer is the finaliser of splitmix64 [Steele, Lea, Flood 2014].
    """
    state = np.full(len(rows), _mix(np.array([seed % 2**64], dtype=np.uint64))[0])
    for column in np.ascontiguousarray(rows).view(np.uint64).T:
        state = _mix(state ^ column)
    return state


def _mix(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return numbers of 64 bits, of which each bit depends on all bits of the given ones."""
    state = state + np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(state ^ (state >> np.uint64(31)))
