"""Time to compare all pairs of a gallery by clock matching, against the definition in dense numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrieval.clock import Signature, count_words, match_all
from retrieval.views import N_VIEWS, VIEW_PERMUTATIONS
from tools.speed._timing import least_seconds, least_wall_seconds, row

N_WORDS = 1500
N_FORMS = 200
KEYPOINTS_PER_VIEW = 40
CORES = 2
PEER_PAIRS = 4
PAIRS_PER_SECOND = 400_000
REPEATS = 5


def gallery(n_forms: int, seed: int = 0) -> list[Signature]:
    """Signatures with as many keypoints as real ones; words are as unequally frequent (log-normal) as real ones."""
    rng = np.random.default_rng(seed)
    common = rng.normal(size=N_WORDS)
    signatures = []
    for _ in range(n_forms):
        weights = np.exp(common + rng.normal(size=N_WORDS))
        sizes = rng.poisson(KEYPOINTS_PER_VIEW, N_VIEWS)
        words = rng.choice(N_WORDS, sizes.sum(), p=weights / weights.sum()).astype(np.int32)
        signatures.append(count_words(words, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32), N_WORDS))
    return signatures


def dense_distance(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Clock matching of two tables of word counts, each of shape (66, n_words), straight from the definition."""
    larger = np.maximum(first.sum(axis=1)[:, None], second.sum(axis=1))
    shared = np.array([np.minimum(view, second).sum(axis=1) for view in first])
    dissimilarity = 1 - shared / larger
    return float(min(dissimilarity[np.arange(N_VIEWS), turn].sum() for turn in VIEW_PERMUTATIONS))


def measure() -> list[dict[str, Any]]:
    """Time a gallery on two cores, and on one against the definition, which is timed on a few pairs."""
    signatures = gallery(N_FORMS)
    n_pairs = N_FORMS * (N_FORMS - 1) // 2
    together = least_wall_seconds(lambda: match_all(signatures, CORES), REPEATS)
    alone = least_seconds(lambda: match_all(signatures, 1), REPEATS)

    tables = np.zeros((PEER_PAIRS + 1, N_VIEWS, N_WORDS), dtype=np.uint8)
    for table, signature in zip(tables, signatures, strict=False):
        table[signature.views, signature.words] = signature.counts
    dense = least_seconds(lambda: [dense_distance(tables[0], table) for table in tables[1:]], 3) / PEER_PAIRS
    expected = [dense_distance(tables[0], table) for table in tables[1:]]
    miss = float(np.abs(match_all(signatures)[0, 1 : PEER_PAIRS + 1] - expected).max())

    size = f"{N_FORMS} forms, {N_WORDS} words, {KEYPOINTS_PER_VIEW} keypoints per view"
    return [
        row(
            f"clock matching on {CORES} cores, one pair",
            together / n_pairs,
            clock="wall",
            target=f"at least {PAIRS_PER_SECOND} pairs per second",
            met=n_pairs / together >= PAIRS_PER_SECOND,
            detail=f"{n_pairs / together:.0f} pairs per second, {size}",
            pairs_per_second=n_pairs / together,
        ),
        row(
            "clock matching on one core, one pair",
            alone / n_pairs,
            peer="definition in dense numpy",
            peer_seconds=dense,
            target="equal to the definition",
            met=miss <= 1e-12,
            detail=f"{n_pairs / alone:.0f} pairs per second, largest difference {miss:.0e}, {size}",
            pairs_per_second=n_pairs / alone,
        ),
    ]
