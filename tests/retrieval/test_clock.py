from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from retrieval.clock import BLOCK, Signature, count_words, match_across, match_all
from retrieval.views import view_sphere

pytestmark = pytest.mark.kernels

N_VIEWS = 66


def random_signature(
    rng: np.random.Generator, n_words: int, keypoints: float = 12, empty: float = 0.1, n_views: int = N_VIEWS
) -> Signature:
    sizes = rng.poisson(keypoints, n_views) * (rng.uniform(size=n_views) > empty)
    # Words as unequal as real ones.
    words = (n_words * rng.beta(0.4, 1.0, sizes.sum())).astype(np.int32)
    return count_words(words, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32), n_words)


def histograms(signature: Signature, n_words: int) -> NDArray[Any]:
    dense = np.zeros((len(signature.view_offsets) - 1, n_words), dtype=np.int64)
    dense[signature.views, signature.words] = signature.counts
    return dense


def dense_distance(first: NDArray[Any], second: NDArray[Any], subdivisions: int = 2, bits: int = 45) -> float:
    """The definition, with the documented rounding of each ratio to multiples of 2^-45."""
    shared = np.minimum(first[:, None], second[None]).sum(axis=2)
    larger = np.maximum(first.sum(axis=1)[:, None], second.sum(axis=1))
    ratio = np.where(larger == 0, 1.0, shared / np.maximum(larger, 1))
    dissimilarity = 1 - np.round(ratio * 2.0**bits) / 2.0**bits
    return min(dissimilarity[np.arange(len(first)), turn].sum() for turn in view_sphere(subdivisions).permutations)


def test_equals_the_dense_definition_exactly() -> None:
    rng = np.random.default_rng(0)
    signatures = [random_signature(rng, 60) for _ in range(9)]
    dense = [histograms(s, 60) for s in signatures]
    expected = np.array([[dense_distance(a, b) for b in dense] for a in dense])
    np.testing.assert_array_equal(match_all(signatures), expected)
    np.testing.assert_array_equal(match_across(signatures[:3], signatures), expected[:3])


@pytest.mark.parametrize("count", [1, BLOCK, 2 * BLOCK + 7])
def test_blocks_threads_and_order_change_nothing(count: int) -> None:
    rng = np.random.default_rng(count)
    signatures = [random_signature(rng, 40, keypoints=3) for _ in range(count)]
    alone = match_all(signatures)
    assert alone.shape == (count, count)
    np.testing.assert_array_equal(match_all(signatures, threads=3), alone)
    np.testing.assert_array_equal(
        match_across(signatures, signatures, threads=2)[np.triu_indices(count, 1)], alone[np.triu_indices(count, 1)]
    )
    order = rng.permutation(count)
    np.testing.assert_array_equal(match_all([signatures[i] for i in order]), alone[np.ix_(order, order)])


def test_progress_is_told_block_by_block_and_an_interrupt_ends_the_work() -> None:
    rng = np.random.default_rng(6)
    signatures = [random_signature(rng, 40, keypoints=3) for _ in range(2 * BLOCK + 7)]
    progress_calls: list[tuple[int, int]] = []
    match_all(signatures, threads=2, progress=lambda done, total: progress_calls.append((done, total)))
    assert progress_calls == [
        (BLOCK, len(signatures)),
        (2 * BLOCK, len(signatures)),
        (len(signatures), len(signatures)),
    ]

    def interrupt(done: int, total: int) -> None:
        progress_calls.append((done, total))
        raise KeyboardInterrupt

    progress_calls.clear()
    threads_before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        match_all(signatures, threads=2, progress=interrupt)
    assert progress_calls == [(BLOCK, len(signatures))]
    assert threading.active_count() == threads_before


def test_empty_views() -> None:
    nothing = Signature(*(np.zeros(0, np.int32),) * 2, np.zeros(N_VIEWS + 1, np.int32))
    offsets = np.arange(N_VIEWS + 1, dtype=np.int32)
    everything = Signature(np.zeros(N_VIEWS, np.int32), np.ones(N_VIEWS, np.int32), offsets)
    one_view = Signature(np.zeros(1, np.int32), np.ones(1, np.int32), np.minimum(offsets, 1))
    # Both empty: 0. One empty: 1 for each such view.
    expected = [[0, 0, 66, 1], [0, 0, 66, 1], [66, 66, 0, 65], [1, 1, 65, 0]]
    np.testing.assert_array_equal(match_all([nothing, nothing, everything, one_view]), expected)
    assert match_all([]).shape == (0, 0)
