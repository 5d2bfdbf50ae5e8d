"""What distances say: nearest shapes, precision over recall, what is confused; and the front of cost and score."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmark.report.rankings import RECALLS, pareto_front, ranking
from retrieval.metrics import evaluate

LABELS = ["a", "a", "a", "b", "b", "c"]


def distances():
    points = np.random.default_rng(0).random((len(LABELS), 2))
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def test_the_nearest_are_those_of_the_scores_and_a_query_is_none_of_its_own():
    matrix = distances()
    found = ranking(matrix, LABELS, 3)
    for query, nearest in enumerate(found.nearest):
        others = sorted((matrix[query, k], k) for k in range(len(LABELS)) if k != query)
        assert nearest.tolist() == [k for _, k in others[:3]]
    hits = [LABELS[nearest[0]] == LABELS[query] for query, nearest in enumerate(found.nearest)]
    assert np.mean(hits[:5]) == pytest.approx(evaluate(matrix, LABELS).means["NN"])


def test_precision_is_interpolated_and_absent_for_the_only_shape_of_its_class():
    """The query "a" finds its class at ranks 1 and 4: precision 1 up to half of them, then 2/4."""
    place = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    labels = ["a", "a", "b", "b", "a"]
    found = ranking(np.abs(place[:, None] - place[None]), labels).precision
    assert found[0][[0, 9]].tolist() == [1.0, 1.0]
    assert found[0][[10, 19]].tolist() == [0.5, 0.5]
    assert len(RECALLS) == found.shape[1] == 20
    lone = ranking(distances(), LABELS).precision
    assert np.isnan(lone[5]).all()
    assert not np.isnan(lone[:5]).any()


@given(st.dictionaries(st.text(max_size=3), st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=8))
def test_nothing_beats_the_front_and_all_else_is_beaten(points):
    front = pareto_front(points)

    def beaten(name):
        cost, score = points[name]
        return any(c <= cost and s >= score and (c, s) != (cost, score) for c, s in points.values())

    assert set(front) == {name for name in points if not beaten(name)}
    assert [points[name] for name in front] == sorted(points[name] for name in front)
