"""The wide stream: no authored pose and no tested subject, poses and bones as the body model has them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.datasets.human_poses import POSES, bone_rotations
from benchmark.datasets.human_subjects import CLEARANCE, clearance
from benchmark.datasets.varied import wide
from benchmark.datasets.varied.bodies import AWAY_FROM, Body, varied_body
from benchmark.datasets.varied.joints import batch_rotations
from benchmark.datasets.varied.poses import free_pose, range_of_motion
from benchmark.datasets.varied.wide import WideSampler
from learned.streamed.configuration import STREAMED

#: The body model with all local changes has a cache of its own, .9 GB that take a minute to build.
needs_the_full_body = pytest.mark.exhaustive

NEAR = 15.0
"""Degrees within which all joints of two poses lie that are the same but for a tremor."""


def test_bones_turn_as_those_of_single_poses_do() -> None:
    random = np.random.default_rng(0)
    poses = [*POSES.values(), *(free_pose(random) for _ in range(20))]
    together = batch_rotations(np.stack([pose.angles() for pose in poses]))
    for place, pose in enumerate(poses):
        alone = bone_rotations(pose)
        assert alone.keys() == together.keys()
        for bone, rotation in alone.items():
            np.testing.assert_allclose(together[bone][place], rotation, atol=1e-12)


def test_no_authored_pose_enters_training() -> None:
    sampler, random = WideSampler(seed=0), np.random.default_rng(0)
    drawn = np.stack([sampler.angles(random) for _ in range(3000)])
    lower, upper = range_of_motion()
    assert (drawn >= lower).all()
    assert (drawn <= upper).all()
    authored = np.stack([one.angles() for pose in POSES.values() for one in (pose, pose.mirrored())])
    # The last angle is the turn of the whole body, which a view draws by itself.
    farthest = np.abs(drawn[:, None, :-1] - authored[None, :, :-1]).max(axis=2)
    assert farthest.min() > NEAR
    recipes = {"perturbed_pose", "varied_pose", "POSES", "SUBJECTS", "FRONT", "scan"}
    assert not recipes & vars(wide).keys()
    assert STREAMED["people"].stream == "wide"


@needs_the_full_body
def test_no_subject_of_a_set_enters_training(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Body] = []

    def noted(random: np.random.Generator) -> Body:
        drawn.append(varied_body(random))
        return drawn[-1]

    monkeypatch.setattr(wide, "varied_body", noted)
    WideSampler(seed=11)(0, 8, 64)
    assert len(drawn) >= 8
    assert min(clearance(body.subject, AWAY_FROM) for body in drawn) >= CLEARANCE
