from __future__ import annotations

import numpy as np
import pytest

from benchmark.errors import ConfigurationError
from retrieval.chance import chance_levels
from retrieval.metrics import evaluate


def test_an_all_tied_matrix_is_at_chance_exactly() -> None:
    labels = np.repeat([0, 1, 2, 3], [2, 5, 9, 40])  # more than the E-measure sees
    scores = evaluate(np.ones((56, 56)), labels)
    levels = list(scores.means.values())
    np.testing.assert_allclose(levels, list(chance_levels(labels).values()))


def test_lone_shapes_count_in_the_list_but_not_in_the_mean() -> None:
    # Two relevant pairs in a list of 4 others.
    assert chance_levels(["a", "a", "b", "b", "c"])["NN"] == pytest.approx(1 / 4)


def test_faults_are_named() -> None:
    with pytest.raises(ConfigurationError, match="two members"):
        chance_levels([0, 1, 2])
