from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from retrieval.chance import chance_levels
from retrieval.metrics import evaluate

TOSCA = {
    "cat": 11,
    "centaur": 6,
    "david": 7,
    "dog": 9,
    "gorilla": 4,
    "horse": 8,
    "michael": 20,
    "victoria": 12,
    "wolf": 3,
}
ANIMALS = ("cat", "centaur", "dog", "gorilla", "horse", "wolf")
QUADRUPEDS = ("cat", "dog", "horse", "wolf")

COLUMNS = ("NN", "FT", "ST", "E", "DCG")
RANDOM = {
    "synthetic 5 x 20": ([20] * 5, (0.192, 0.192, 0.384, 0.241, 0.548)),
    "synthetic 15 x 20": ([20] * 15, (0.064, 0.064, 0.127, 0.080, 0.403)),
    "real 40 x 10": ([10] * 40, (0.023, 0.023, 0.045, 0.035, 0.273)),
    "TOSCA 80": (list(TOSCA.values()), (0.133, 0.133, 0.266, 0.190, 0.440)),
    "TOSCA animals": ([TOSCA[name] for name in ANIMALS], (0.174, 0.174, 0.349, 0.280, 0.475)),
    "TOSCA quadrupeds": ([TOSCA[name] for name in QUADRUPEDS], (0.262, 0.262, 0.525, 0.409, 0.562)),
    "TOSCA cat + horse": ([11, 8], (0.485, 0.485, 0.906, 0.649, 0.729)),
    "SHREC'11": ([20] * 30, (0.032, 0.032, 0.063, 0.040, 0.344)),
    "10 x 10": ([10] * 10, (0.091, 0.091, 0.182, 0.142, 0.397)),
}


def labels_of(sizes: list[int]) -> NDArray[Any]:
    return np.repeat(np.arange(len(sizes)), sizes)


@pytest.mark.parametrize("name", RANDOM)
def test_table_of_chance_levels(name: str) -> None:
    sizes, expected = RANDOM[name]
    assert tuple(round(chance_levels(labels_of(sizes))[name], 3) for name in COLUMNS) == expected


def test_an_all_tied_matrix_is_at_chance_exactly() -> None:
    labels = labels_of([2, 5, 9])
    scores = evaluate(np.ones((16, 16)), labels)
    levels = list(scores.means.values())
    np.testing.assert_allclose(levels, list(chance_levels(labels).values()))


def test_lone_shapes_count_in_the_list_but_not_in_the_mean() -> None:
    # Two relevant pairs in a list of 4 others.
    assert chance_levels(["a", "a", "b", "b", "c"])["NN"] == pytest.approx(1 / 4)


def test_faults_are_named() -> None:
    with pytest.raises(ConfigurationError, match="two members"):
        chance_levels([0, 1, 2])
