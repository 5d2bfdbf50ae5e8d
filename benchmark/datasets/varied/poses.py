"""Random poses with independent angles within human joint limits."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.human_poses import POSES, Arm, Column, Leg, Pose, perturbed_pose

Angles = NDArray[np.float64]

AUTHORED_SHARE = 0.25
"""Fraction of poses mixed from two authored poses, as in the older sample: purposeful movements."""

FRONTAL_SHARE, FRONTAL, LARGEST_TURN = 0.5, 20.0, 130.0
"""Fraction of bodies that face the camera within 20 degrees; the others turn by up to 130 degrees to either side."""


@dataclass(frozen=True)
class _Limits:
    """Poses with the lower and upper limits of all ranges."""

    lower: Pose
    upper: Pose


_MOTION = _Limits(
    lower=Pose(
        left_arm=Arm(raised=0, forward=-60, roll=-70, bend=0),
        left_leg=Leg(flexion=-30, abduction=-10, roll=-45, bend=0, point=-20),
        trunk=Column(bend=-25, lean=-35, turn=-45),
        head=Column(bend=-45, lean=-45, turn=-60),
        body=Column(bend=-20, lean=-20),
    ),
    upper=Pose(
        left_arm=Arm(raised=170, forward=135, roll=90, bend=150),
        left_leg=Leg(flexion=120, abduction=45, roll=45, bend=135, point=50),
        trunk=Column(bend=80, lean=35, turn=45),
        head=Column(bend=45, lean=45, turn=60),
        body=Column(bend=40, lean=20),
    ),
)
"""Normal ranges of motion of the left limbs in degrees [American Academy of Orthopaedic Surgeons, "Joint Motion: Method
of Measuring and Recording", 1965].

Two ranges are narrower: an arm is raised to 170 degrees instead of 180, which has no direction seen from above, and a
leg is adducted by 10 degrees instead of 30, since it would collide with the other leg. The body has no anatomical limit
relative to the ground; balance permits 20 to 40 degrees.
"""


@functools.cache
def joint_limits() -> tuple[Angles, Angles]:
    """Return the minimum and maximum of every angle in the order of :meth:`Pose.angles`, each of shape (27,).

    They are normal ranges of motion, extended to include all authored poses and their mirror images.
    """
    ends = [end.angles() for pose in POSES.values() for end in (pose, pose.mirrored())]
    lower, upper = range_of_motion()
    return np.min([lower, *ends], axis=0), np.max([upper, *ends], axis=0)


def range_of_motion() -> tuple[Angles, Angles]:
    """Return the minimum and maximum of every angle by the normal ranges of motion only, shape (27,) each."""
    return _both_sides(_MOTION.lower).angles(), _both_sides(_MOTION.upper).angles()


def free_pose(random: np.random.Generator) -> Pose:
    """Draw every angle independently and uniformly within its limits; the body faces the front.

    Parameters
    ----------
    random
        Random generator.
    """
    lower, upper = joint_limits()
    return Pose.from_angles(random.uniform(lower, upper))


def varied_pose(random: np.random.Generator) -> Pose:
    """Draw a pose, three in four from independent angles, otherwise a mixture of authored poses, and turn the body.

    Parameters
    ----------
    random
        Random generator.

    Returns
    -------
    Pose
        Within :func:`joint_limits` except for ``body.turn``, the rotation about the vertical axis, which is at most
        ``LARGEST_TURN`` to either side.
    """
    pose = perturbed_pose(random) if random.random() < AUTHORED_SHARE else free_pose(random)
    largest = FRONTAL if random.random() < FRONTAL_SHARE else LARGEST_TURN
    angles = pose.angles()
    angles[-1] = random.uniform(-largest, largest)
    return Pose.from_angles(angles)


def _both_sides(pose: Pose) -> Pose:
    """Return the pose with the angles of the left limbs on both sides."""
    return Pose(
        left_arm=pose.left_arm,
        right_arm=pose.left_arm,
        left_leg=pose.left_leg,
        right_leg=pose.left_leg,
        trunk=pose.trunk,
        head=pose.head,
        body=pose.body,
    )
