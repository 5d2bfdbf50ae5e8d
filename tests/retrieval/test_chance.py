from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from retrieval.chance import chance_levels, pose_first_levels
from retrieval.measures import MEASURES
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
POSE_FIRST = {
    (5, 20): (0.000, 0.158, 0.358, 0.220, 0.488),
    (15, 20): (0.000, 0.018, 0.084, 0.047, 0.367),
    (40, 10): (0.000, 0.000, 0.000, 0.000, 0.244),
}


def labels_of(sizes: list[int]) -> NDArray[Any]:
    return np.repeat(np.arange(len(sizes)), sizes)


@pytest.mark.parametrize("name", RANDOM)
def test_table_of_chance_levels(name: str) -> None:
    sizes, expected = RANDOM[name]
    assert tuple(round(chance_levels(labels_of(sizes))[name], 3) for name in COLUMNS) == expected


@pytest.mark.parametrize("size", POSE_FIRST)
def test_table_of_pose_first_levels(size: tuple[int, int]) -> None:
    subjects, poses = size
    labels, pose = np.repeat(np.arange(subjects), poses), np.tile(np.arange(poses), subjects)
    levels = pose_first_levels(labels, pose)
    assert list(levels) == [measure.name for measure in MEASURES]
    assert tuple(round(levels[name], 3) for name in COLUMNS) == POSE_FIRST[size]


def simulate(labels: NDArray[Any], first: NDArray[Any], rounds: int) -> NDArray[Any]:
    rng = np.random.default_rng(0)
    totals = np.zeros(len(MEASURES))
    for _ in range(rounds):
        noise = rng.uniform(1, 2, first.shape)
        scores = evaluate(np.where(first, 0.5 * (noise + noise.T) - 1, 0.5 * (noise + noise.T)), labels)
        totals += list(scores.means.values())
    return totals / rounds


def test_simulation_agrees() -> None:
    labels = labels_of([3, 4, 8, 15])
    levels = chance_levels(labels)
    np.testing.assert_allclose(simulate(labels, np.zeros((30, 30), bool), 300), list(levels.values()), atol=0.01)


def test_simulation_of_pose_first_agrees() -> None:
    labels, pose = np.repeat(np.arange(5), 6), np.tile([0, 1, 2, 3, 3, 4], 5)
    first = (pose[:, None] == pose) & (labels[:, None] != labels)
    levels = pose_first_levels(labels, pose)
    np.testing.assert_allclose(simulate(labels, first, 300), list(levels.values()), atol=0.01)


def test_an_all_tied_matrix_is_at_chance_exactly() -> None:
    labels = labels_of([2, 5, 9])
    scores = evaluate(np.ones((16, 16)), labels)
    levels = list(scores.means.values())
    np.testing.assert_allclose(levels, list(chance_levels(labels).values()))


def test_poses_of_their_own_leave_plain_chance() -> None:
    labels = labels_of([4, 5])
    assert pose_first_levels(labels, np.arange(9)) == chance_levels(labels)


def test_lone_shapes_count_in_the_list_but_not_in_the_mean() -> None:
    # Two relevant pairs in a list of 4 others.
    assert chance_levels(["a", "a", "b", "b", "c"])["NN"] == pytest.approx(1 / 4)


def test_faults_are_named() -> None:
    with pytest.raises(ConfigurationError, match="two members"):
        chance_levels([0, 1, 2])
    with pytest.raises(ConfigurationError, match="poses"):
        pose_first_levels([0, 0], [1])
