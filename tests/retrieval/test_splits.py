"""Galleries scored all at once, against the scorer of a single one."""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from retrieval.measures import PRINTED
from retrieval.metrics import evaluate
from retrieval.splits import all_splits, ranges, scores_of_splits


def distances_of(n: int, seed: int, ties: bool) -> NDArray[Any]:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 4, (n, 2)) if ties else rng.normal(size=(n, 2))
    return np.linalg.norm(points[:, None] - points[None], axis=2)


@pytest.mark.parametrize("missing", [[], [2, 7, 8, 11, 15]])
@pytest.mark.parametrize("ties", [False, True])
def test_each_split_scores_as_its_own_matrix_does(ties: bool, missing: list[int]) -> None:
    # Classes of all sizes in any order; one of them has a single member.
    labels = np.random.default_rng(5).permutation(np.repeat(list("abcdef"), [7, 5, 6, 1, 4, 9])).tolist()
    answered = np.setdiff1d(np.arange(len(labels)), missing)
    distances = distances_of(len(labels), 3, ties)[np.ix_(answered, answered)]
    splits = all_splits("abcdef", 3)
    scores = scores_of_splits(distances, labels, splits, answered=answered)
    for row, split in enumerate(splits):
        inside = [place for place, label in enumerate(labels) if label in split]
        rows = [row for row, place in enumerate(answered) if place in inside]
        places = [inside.index(answered[row]) for row in rows]
        single = evaluate(distances[np.ix_(rows, rows)], [labels[place] for place in inside], answered=places).means
        assert {name: scores[name][row] for name in PRINTED} == pytest.approx({name: single[name] for name in PRINTED})
    assert missing or ties == (evaluate(distances, labels).tied_queries > 0)


def test_all_ways_to_take_five_of_fifteen() -> None:
    kinds = {f"{kind}-{k}": kind for kind in ("man", "woman", "child") for k in range(5)}
    everything = all_splits(kinds, 5)
    assert len(everything) == len(set(everything)) == comb(15, 5) == 3003
    mixed = all_splits(kinds, 5, kinds, {"man": 2, "woman": 2, "child": 1})
    assert len(mixed) == comb(5, 2) * comb(5, 2) * 5 == 500
    assert set(mixed) <= set(everything)
    assert all(sum(name.startswith("woman") for name in split) == 2 for split in mixed)
    with pytest.raises(ConfigurationError, match="no 5 of 3 subjects can be taken so"):
        all_splits("abc", 5)


def test_ranges_by_hand() -> None:
    (quantiles,) = ranges({"NN": np.linspace(0, 1, 101)}).values()
    assert (quantiles.low, quantiles.median, quantiles.high) == pytest.approx((0.05, 0.5, 0.95))


@pytest.mark.parametrize(
    ("splits", "message"),
    [
        ([("a", "x")], "a split names the class 'x', which no shape has"),
        ([("a", "a")], r"the split \('a', 'a'\) names a class twice"),
        ([("a", "b"), ("c",)], "a split has no class with two members"),
    ],
)
def test_what_is_no_split_is_named(splits: list[tuple[str, ...]], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        scores_of_splits(distances_of(5, 0, ties=False), list("aabbc"), splits)


def test_a_matrix_that_does_not_fit_is_named() -> None:
    with pytest.raises(ConfigurationError, match="5 rows of distances but labels of shape"):
        scores_of_splits(distances_of(5, 0, ties=False), list("aabb"), [("a", "b")])
