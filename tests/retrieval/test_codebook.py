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


def test_words_are_distinct_descriptors_of_the_gallery() -> None:
    parts = [random_descriptors(seed, 300) for seed in range(4)]
    parts.append(parts[0][:200])
    words = sample_codebook(parts, 500, seed=1)
    assert words.shape == (500, 128)
    assert len(rows(words)) == 500
    assert rows(words) <= rows(np.concatenate(parts))


def test_the_draw_depends_on_the_seed_but_not_on_the_order_of_shapes() -> None:
    parts = [random_descriptors(seed, 300) for seed in range(4)]
    words = sample_codebook(parts, 100, seed=1)
    np.testing.assert_array_equal(sample_codebook(parts[::-1], 100, seed=1), words)
    assert len(rows(sample_codebook(parts, 100, seed=2)) & rows(words)) < 30


def test_every_descriptor_has_the_same_chance() -> None:
    # Descriptors that differ in one byte only: a weak hash would favour some.
    pool = np.zeros((256, 128), np.uint8)
    pool[:, 77] = np.arange(256)
    drawn = np.zeros(256)
    for seed in range(400):
        drawn[sample_codebook([pool], 64, seed)[:, 77]] += 1
    # Binomial(400, 1/4): mean 100, standard deviation 8.7.
    assert drawn.mean() == 100
    assert drawn.std() == pytest.approx(8.7, rel=0.25)
    assert np.abs(drawn - 100).max() < 4.5 * 8.7


def test_many_equal_descriptors_do_not_starve_the_codebook() -> None:
    parts = [np.repeat(random_descriptors(0, 20), 500, axis=0), random_descriptors(1, 50)]
    assert len(sample_codebook(parts, 60, seed=0)) == 60


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
