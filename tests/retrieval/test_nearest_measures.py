"""Measures of the nearest shapes: by hand, and those of the whole ranking."""

import numpy as np
import pytest

from benchmark.errors import ConfigurationError
from benchmark.jobs.stages.neighbours import nearest_scores
from retrieval.metrics import evaluate
from retrieval.nearest_measures import evaluate_nearest, printed_of
from retrieval.neighbours import nearest


class Matrix:
    """An index whose candidates are all shapes."""

    def __init__(self, matrix):
        self.matrix = np.asarray(matrix)

    def __len__(self):
        return len(self.matrix)

    def closeness(self, forms):
        return -self.matrix[forms]

    def distances(self, first, second):
        return self.matrix[first, second]


GOLDEN = Matrix(
    [
        [0.0, 1.0, 2.0, 2.0, 9.0],
        [1.0, 0.0, 3.0, 4.0, 5.0],
        [2.0, 3.0, 0.0, 1.0, 1.0],
        [2.0, 4.0, 1.0, 0.0, 6.0],
        [9.0, 5.0, 1.0, 6.0, 0.0],
    ]
)


def test_golden():
    # a0: a1, then c0 and a2 tie: NN 1, of the first two 1 + 1/2 are a: 3/4.   a1: a0, c0, a2: 1, 1/2.
    # c0: a2 and c1 tie: 1/2; of these two 1/2.   a2: c0, then a0: 0, 1/2.   c1: c0, a1: 1, 1/2.
    labels = ["a", "a", "c", "a", "c"]
    found, tied = evaluate_nearest(nearest(GOLDEN, 2), labels, 2)
    assert found["NN"].tolist() == [1.0, 1.0, 0.5, 0.0, 1.0]
    assert found["P@K"].tolist() == [0.75, 0.5, 0.5, 0.5, 0.5]
    assert tied == 2


def test_what_has_no_result_finds_nothing_and_is_found_last():
    # Of a b a b the last has no result. a0 finds b, a; a2 finds b, a; b1 finds a a and then b: 0, and of three 1/3.
    matrix = Matrix([[0.0, 1.0, 2.0], [1.0, 0.0, 1.0], [2.0, 1.0, 0.0]])
    found, _ = evaluate_nearest(nearest(matrix, 3), ["a", "b", "a", "b"], 3, [0, 1, 2])
    assert found["NN"].tolist() == [0.0, 0.0, 0.0, 0.0]
    assert found["P@K"].tolist() == [1 / 3, 1 / 3, 1 / 3, 0.0]


@pytest.mark.parametrize("answered", [None, [0, 2, 3, 5, 6, 7, 8, 9, 11]])
def test_with_all_neighbours_they_are_those_of_the_whole_ranking(answered):
    rng = np.random.default_rng(0)
    labels = [*"aaabbbcccddde"[:11], "d"]
    matrix = rng.integers(0, 4, (12, 12)).astype(float)
    matrix = (matrix + matrix.T)[np.ix_(*[answered or range(12)] * 2)]
    found, _ = evaluate_nearest(nearest(Matrix(matrix), 20), labels, 20, answered)
    whole = evaluate(matrix, labels, answered=answered)
    np.testing.assert_allclose(found["NN"], whole.per_query["NN"], equal_nan=True)
    members = [labels.count(label) - 1 for label in labels]
    is_asked = np.isin(np.arange(12), answered or range(12)) & (np.array(members) > 0)
    np.testing.assert_allclose(found["P@K"][is_asked], np.array(members)[is_asked] / 11)


def test_what_a_record_gets():
    found = nearest_scores([nearest(GOLDEN, 2)] * 2, [*"aacab"], 2)
    assert found["neighbours"] == 2 and found["lone_queries"] == 2
    assert found["per_query"]["NN"][2] is None
    assert printed_of(found["scores"]) == ("NN", "P@K")
    assert found["scores"]["NN"] == pytest.approx(2 / 3)  # the nearest to the third a is c
    with pytest.raises(ConfigurationError, match="no class has two members"):
        nearest_scores([nearest(GOLDEN, 2)], [*"abcde"], 2)
