"""The varied bodies: none that is tested, none through itself, as free as joints allow, the same everywhere."""

from __future__ import annotations

from dataclasses import astuple, replace

import numpy as np
import pytest
import trimesh

from benchmark.datasets.human_poses import POSES, Arm, Pose
from benchmark.datasets.human_subjects import CLEARANCE, SUBJECTS, adults
from benchmark.datasets.varied.bodies import Body, varied_subject
from benchmark.datasets.varied.model import CANONICAL, body_model
from benchmark.datasets.varied.poses import free_pose, joint_limits
from benchmark.datasets.varied.sampler import LARGEST_DOUBLED, doubled_share
from benchmark.geometry.mesh import Mesh


def varied_mesh(body: Body, pose: Pose) -> Mesh:
    """Mesh of one body in one pose."""
    model = body_model()
    return Mesh(model.vertices([body], [[pose]])[0][0], model.faces)


#: The body model with all local changes has a cache of its own, .9 GB that take a minute to build.
needs_the_full_body = pytest.mark.exhaustive


def test_no_body_is_near_to_a_subject_that_is_tested() -> None:
    random = np.random.default_rng(0)
    drawn = np.array([astuple(varied_subject(random)) for _ in range(400)])
    tested = np.array([astuple(subject) for subject in (*SUBJECTS.values(), *adults().values())])
    assert len(tested) == 55
    assert np.linalg.norm(drawn[:, None] - tested, axis=2).min() >= CLEARANCE == 0.25
    assert drawn.min() >= 0
    assert drawn.max() <= 1
    # As many children as adults, as many men as women.
    assert abs((drawn[:, 1] < 0.5).mean() - 0.5) < 0.15
    assert abs((drawn[:, 0] < 0.5).mean() - 0.5) < 0.1
    assert len(np.unique(drawn, axis=0)) == 400


def test_every_angle_is_free_of_the_others_and_within_its_joint() -> None:
    lower, upper = joint_limits()
    random = np.random.default_rng(0)
    angles = np.stack([free_pose(random).angles() for _ in range(2000)])
    assert (angles >= lower - 1e-9).all()
    assert (angles <= upper + 1e-9).all()
    moving = upper > lower
    assert moving.sum() == 26  # all but the turn of the whole body, which is drawn by itself
    correlations = np.corrcoef(angles[:, moving].T) - np.eye(26)
    assert np.abs(correlations).max() < 0.12
    spread = (angles.max(axis=0) - angles.min(axis=0))[moving] / (upper - lower)[moving]
    assert spread.min() > 0.98
    for pose in POSES.values():
        assert (pose.angles() >= lower).all()
        assert (pose.angles() <= upper).all()
    mirrored = np.stack([Pose.from_angles(end).mirrored().angles() for end in (upper, lower)])
    np.testing.assert_array_equal(np.sort(mirrored, axis=0), np.stack([lower, upper]))


@needs_the_full_body
def test_an_arm_through_the_chest_is_found_and_authored_poses_pass() -> None:
    faces = body_model().faces
    bodies = [Body(SUBJECTS[name]) for name in ("man-2", "child-3", "woman-5")]
    standing = [np.ptp(varied_mesh(body, CANONICAL).vertices[:, 2]) for body in bodies]
    made = body_model().vertices(bodies, [list(POSES.values())] * 3)
    shares = [
        doubled_share(one, faces, height) for of_body, height in zip(made, standing, strict=True) for one in of_body
    ]
    assert np.mean(np.array(shares) <= LARGEST_DOUBLED) > 0.9
    inside = replace(
        CANONICAL, left_arm=Arm(raised=60, forward=110, bend=110), right_arm=Arm(raised=5, bend=5, roll=-60)
    )
    assert doubled_share(varied_mesh(bodies[0], inside).vertices, faces, standing[0]) > 2 * LARGEST_DOUBLED
    # Two tetrahedra that share half of the smaller one, by hand: nothing of one alone lies inside of it twice.
    solid = trimesh.creation.box((1, 1, 1))
    assert doubled_share(solid.vertices, solid.faces.astype(np.int32), 1.0) == 0
    two = trimesh.util.concatenate([solid, solid.copy().apply_translation([0.5, 0, 0])])
    assert doubled_share(two.vertices, two.faces.astype(np.int32), 1.0) == pytest.approx(1 / 3, abs=0.03)
