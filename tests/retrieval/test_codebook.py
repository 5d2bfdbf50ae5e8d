from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from retrieval.codebook import nearest_words, sample_codebook


def random_descriptors(seed: int, count: int, largest: int = 255) -> NDArray[Any]:
    return np.random.default_rng(seed).integers(0, largest + 1, (count, 128)).astype(np.uint8)


def rows(array: NDArray[Any]) -> set[bytes]:
    return {row.tobytes() for row in array}


def test_the_draw_depends_on_the_seed_but_not_on_the_order_of_shapes() -> None:
    parts = [random_descriptors(seed, 300) for seed in range(4)]
    words = sample_codebook(parts, 100, seed=1)
    np.testing.assert_array_equal(sample_codebook(parts[::-1], 100, seed=1), words)
    assert len(rows(sample_codebook(parts, 100, seed=2)) & rows(words)) < 30


@pytest.mark.parametrize("largest", [2, 60, 255])
def test_nearest_words_are_exact_and_ties_go_to_the_lower_index(largest: int) -> None:
    descriptors, words = random_descriptors(0, 1500, largest), random_descriptors(1, 70, largest)
    words = np.concatenate([words, words[:10], descriptors[:5], 255 - descriptors[:5]])
    squared = ((descriptors[:, None].astype(np.int64) - words[None].astype(np.int64)) ** 2).sum(axis=2)
    np.testing.assert_array_equal(nearest_words(descriptors, words), squared.argmin(axis=1))


def test_extreme_bytes_stay_exact() -> None:
    full = np.full((2, 128), 255, np.uint8)
    nearly = full.copy()
    nearly[0, 0] = 254
    assert nearest_words(full, nearly).tolist() == [1, 1]
    assert nearest_words(np.zeros((1, 128), np.uint8), nearly).tolist() == [0]
    assert nearest_words(np.zeros((0, 128), np.uint8), nearly).shape == (0,)
