"""Poses whose angles are drawn independently of each other, within what human joints allow."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.human_poses import POSES, Arm, Column, Leg, Pose, perturbed_pose

Angles = NDArray[np.float64]

AUTHORED_SHARE = 0.25
"""Share of the poses that lie between two authored ones, as in the older sample: what people do on purpose."""

FRONTAL_SHARE, FRONTAL, LARGEST_TURN = 0.5, 20.0, 130.0
"""Half of the bodies face the camera to within 20 degrees; the others turn by up to 130 degrees to either side."""


@dataclass(frozen=True)
class _Limits:
    """A pose at either end of every range."""

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
"""Normal ranges of motion in degrees [American Academy of Orthopaedic Surgeons, "Joint Motion: Method of Measuring and
Recording", 1965], of the left limbs.

Two are narrower: an arm is raised to 170 degrees instead of 180, where its direction seen from above has no meaning,
and a leg is adducted by 10 degrees instead of 30, beyond which it needs the other one out of its way. The body against
the ground has no anatomical limit; 20 to 40 degrees is what balance leaves.
"""


@functools.cache
def joint_limits() -> tuple[Angles, Angles]:
    """Smallest and largest angle of every joint in the order of :meth:`Pose.angles`, each of shape (27,).

    They are normal ranges of motion, wider where an authored pose or its mirror image needs it.
    """
    ends = [end.angles() for pose in POSES.values() for end in (pose, pose.mirrored())]
    lower, upper = range_of_motion()
    return np.min([lower, *ends], axis=0), np.max([upper, *ends], axis=0)


def range_of_motion() -> tuple[Angles, Angles]:
    """Return the smallest and largest angle of every joint by the normal ranges of motion alone, shape (27,) each."""
    return _both_sides(_MOTION.lower).angles(), _both_sides(_MOTION.upper).angles()


def free_pose(random: np.random.Generator) -> Pose:
    """Draw every angle by itself, uniformly within its limits; the body faces the front.

    Parameters
    ----------
    random
        Source of the choice.
    """
    lower, upper = joint_limits()
    return Pose.from_angles(random.uniform(lower, upper))


def varied_pose(random: np.random.Generator) -> Pose:
    """Draw a pose, three times in four by independent angles, else between two authored ones, and turn the body.

    Parameters
    ----------
    random
        Source of the choice.

    Returns
    -------
    Pose
        Within :func:`joint_limits` but for ``body.turn``, the turn about the vertical axis, which is at most
        ``LARGEST_TURN`` to either side.
    """
    pose = perturbed_pose(random) if random.random() < AUTHORED_SHARE else free_pose(random)
    largest = FRONTAL if random.random() < FRONTAL_SHARE else LARGEST_TURN
    angles = pose.angles()
    angles[-1] = random.uniform(-largest, largest)
    return Pose.from_angles(angles)


def _both_sides(pose: Pose) -> Pose:
    """The pose with the right limbs like the left ones."""
    return Pose(
        left_arm=pose.left_arm,
        right_arm=pose.left_arm,
        left_leg=pose.left_leg,
        right_leg=pose.left_leg,
        trunk=pose.trunk,
        head=pose.head,
        body=pose.body,
    )
