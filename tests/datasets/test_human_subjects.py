"""Tests of the subjects of the generated sets of people."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import PEOPLE, SUBJECTS, adults, random_subjects
from benchmark.datasets.humans import Humans, recipe
from benchmark.datasets.people import People


@pytest.mark.parametrize("draw", range(3))
def test_the_committed_table_is_what_the_rule_draws(draw: int) -> None:
    assert PEOPLE[draw] == random_subjects(draw)
    names = [f"{kind}-{'abc'[draw]}{n}" for n in range(1, 6) for kind in ("man", "woman", "child")]
    assert list(PEOPLE[draw]) == names


def test_random_subjects_stay_away_from_those_of_the_other_sets() -> None:
    others = np.array([astuple(subject) for subject in (*SUBJECTS.values(), *adults().values())])
    drawn = np.array([astuple(subject) for subjects in PEOPLE for subject in subjects.values()])
    distances = np.linalg.norm(drawn[:, np.newaxis] - others, axis=2)
    assert distances.shape == (45, 55) and distances.min() >= 0.25
    assert np.abs(distances - 0.25).min() > 1e-9, "no draw hangs on the last bits of a distance"


def test_no_two_draws_share_a_name_or_a_frame_other_than_that_of_the_humans() -> None:
    draws = [People(draw) for draw in range(3)]
    assert len({entry.subject for draw in draws for entry in draw.entries}) == 45
    for number, draw in enumerate(draws):
        assert [entry.pose for entry in draw.entries] == [entry.pose for entry in Humans().entries]
        assert draw.half_width == Humans().half_width
        shape = draw.entries[21]
        assert draw.recipe(shape) == recipe(PEOPLE[number][shape.subject], POSES[shape.pose])
