"""Time to compare all pairs of a gallery by clock matching, against the definition in dense numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrieval.clock import Signature, count_words, match_all
from retrieval.views import N_VIEWS, VIEW_PERMUTATIONS
from tests.speed.signature import fastest

N_WORDS = 1500
N_FORMS = 200
KEYPOINTS_PER_VIEW = 40
THREADS = 2
PEER_PAIRS = 4


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
    """Time both, as one row for the speed report; the peer is timed on a few pairs."""
    signatures = gallery(N_FORMS)
    n_pairs = N_FORMS * (N_FORMS - 1) // 2
    ours = fastest(lambda: match_all(signatures, THREADS), repeats=3)
    alone = fastest(lambda: match_all(signatures, 1), repeats=3)

    tables = np.zeros((PEER_PAIRS + 1, N_VIEWS, N_WORDS), dtype=np.uint8)
    for table, signature in zip(tables, signatures, strict=False):
        table[signature.views, signature.words] = signature.counts
    distances = match_all(signatures)
    for k in range(PEER_PAIRS):
        if abs(dense_distance(tables[0], tables[k + 1]) - distances[0, k + 1]) > 1e-9:
            raise AssertionError("the two programs disagree")
    peer_pair = fastest(lambda: [dense_distance(tables[0], table) for table in tables[1:]], repeats=3) / PEER_PAIRS
    return [
        {
            "name": "clock matching of a gallery",
            "ours_seconds": ours,
            "peer": "definition in dense numpy, one thread",
            "peer_seconds": peer_pair * n_pairs,
            "ratio": peer_pair * n_pairs / ours,
            "detail": f"{N_FORMS} forms, {N_WORDS} words, {KEYPOINTS_PER_VIEW} keypoints per view, {THREADS} threads; "
            f"one thread {n_pairs / alone:.0f} pairs per second",
            "pairs_per_second": n_pairs / ours,
        }
    ]


if __name__ == "__main__":
    for row in measure():
        print(row)
