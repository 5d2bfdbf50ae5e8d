"""Poses of a human body as joint angles, and the corresponding bone rotations.

The angles follow the conventions of physiotherapy: the direction of a limb and the flexion of a hinge. Poses are
readable without a drawing, elbows and knees bend only the right way, and any mixture of two poses is a valid pose.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

# Directions of the left limbs of the model at rest: x to the body's left, -y to the front, z up. They differ by less
# than three degrees between subjects; with a constant, a pose has the same rotations for all subjects.
_UPPER_ARM = np.array([0.664, -0.021, -0.747])
_FOREARM = np.array([0.512, -0.687, -0.517])
_MIRROR = np.array([1.0, -1.0, -1.0])
"""Signs of a rotation vector under reflection of x."""

_SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
_NECK = ("neck01", "neck02", "neck03", "head")
_CLAVICLE_SHARE = 0.2
"""Fraction of the swing of an arm in the shoulder girdle (about a quarter of a raised arm in anatomy)."""
_THIGH_SHARE = 0.15
"""Fraction of the hip flexion in the second bone of the thigh, which rounds the fold of the groin."""


@dataclass(frozen=True, kw_only=True)
class Arm:
    """Angles of an arm, in degrees.

    Parameters
    ----------
    raised
        Angle between the upper arm and straight down: 90 is horizontal, 180 is up.
    forward
        Direction of a raised arm seen from above: 0 to the side, 90 to the front, larger across the chest, negative to
        the back.
    roll
        Rotation about the upper arm; positive turns the forearm of a horizontal arm upwards.
    bend
        Flexion of the elbow: 0 is straight.
    """

    raised: float = 45.0
    forward: float = 0.0
    roll: float = 0.0
    bend: float = 20.0


@dataclass(frozen=True, kw_only=True)
class Leg:
    """Angles of a leg, in degrees.

    Parameters
    ----------
    flexion
        Thigh to the front; negative to the back.
    abduction
        Thigh to the outside, before flexion.
    roll
        Rotation of the toes to the outside.
    bend
        Flexion of the knee: 0 is straight.
    point
        Ankle: toes down; negative for toes up.
    """

    flexion: float = 0.0
    abduction: float = 5.0
    roll: float = 5.0
    bend: float = 5.0
    point: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Column:
    """Angles of the trunk, the neck, or the whole body, in degrees.

    Parameters
    ----------
    bend
        To the front; negative to the back.
    lean
        To the body's left.
    turn
        To the body's left.
    """

    bend: float = 0.0
    lean: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Pose:
    """A pose of the whole body.

    Parameters
    ----------
    left_arm, right_arm, left_leg, right_leg
        The limbs; left is the body's own left.
    trunk
        The spine relative to the pelvis.
    head
        Neck and head relative to the chest.
    body
        The pelvis relative to the ground.
    """

    left_arm: Arm = Arm()
    right_arm: Arm = Arm()
    left_leg: Leg = Leg()
    right_leg: Leg = Leg()
    trunk: Column = Column()
    head: Column = Column()
    body: Column = Column()

    def mirrored(self) -> Pose:
        """Return the pose with left and right exchanged."""

        def reflect(column: Column) -> Column:
            return replace(column, lean=-column.lean, turn=-column.turn)

        return Pose(
            left_arm=self.right_arm,
            right_arm=self.left_arm,
            left_leg=self.right_leg,
            right_leg=self.left_leg,
            trunk=reflect(self.trunk),
            head=reflect(self.head),
            body=reflect(self.body),
        )

    def angles(self) -> NDArray[np.float64]:
        """Return all angles in the order of the fields, shape (27,), in degrees."""
        # Not `astuple`, which makes deep copies: a sample has tens of thousands of poses.
        return np.array([angle for part in vars(self).values() for angle in vars(part).values()])

    @staticmethod
    def from_angles(angles: NDArray[np.float64]) -> Pose:
        """Invert :meth:`angles`."""
        values = iter(np.asarray(angles, dtype=np.float64).tolist())
        parts = {field.name: getattr(_REST, field.name) for field in fields(Pose)}
        return Pose(
            **{
                name: replace(part, **{angle.name: next(values) for angle in fields(part)})
                for name, part in parts.items()
            }
        )


_REST = Pose()


def _both(arm: Arm | None = None, leg: Leg | None = None, **others: Column) -> Pose:
    arm, leg = arm or Arm(), leg or Leg()
    return Pose(left_arm=arm, right_arm=arm, left_leg=leg, right_leg=leg, **others)


POSES: Mapping[str, Pose] = {
    "standing": _both(Arm(raised=45, bend=20), Leg(abduction=8)),
    "walking": Pose(
        left_arm=Arm(raised=38, forward=-50, bend=15),
        right_arm=Arm(raised=40, forward=60, bend=35),
        left_leg=Leg(flexion=28, bend=8, point=-5),
        right_leg=Leg(flexion=-18, bend=28, point=12),
        trunk=Column(turn=8),
        body=Column(bend=4),
    ),
    "running": Pose(
        left_arm=Arm(raised=55, forward=-60, bend=90),
        right_arm=Arm(raised=50, forward=65, bend=95),
        left_leg=Leg(flexion=70, bend=85, abduction=4),
        right_leg=Leg(flexion=-25, bend=60, abduction=4, point=30),
        trunk=Column(bend=8, turn=12),
        head=Column(bend=-12),
        body=Column(bend=14),
    ),
    "sitting": _both(Arm(raised=40, forward=55, bend=45), Leg(flexion=84, bend=86, abduction=10)),
    "kneeling": Pose(
        left_arm=Arm(raised=50, forward=50, bend=50),
        right_arm=Arm(raised=42, forward=0, bend=20),
        left_leg=Leg(flexion=86, bend=88, abduction=10),
        right_leg=Leg(flexion=-4, bend=92, abduction=6, point=45),
        trunk=Column(bend=8),
    ),
    "arms-up": _both(Arm(raised=160, bend=8), Leg(abduction=6), head=Column(bend=-8)),
    "arms-forward": _both(Arm(raised=88, forward=82, bend=8), Leg(abduction=6)),
    "t-pose": _both(Arm(raised=90, bend=4), Leg(abduction=3, roll=2)),
    "bending": _both(
        Arm(raised=95, forward=78, bend=10),
        Leg(flexion=30, abduction=8, bend=10),
        trunk=Column(bend=62),
        head=Column(bend=-10),
        body=Column(bend=32),
    ),
    "dancing": Pose(
        left_arm=Arm(raised=140, forward=10, bend=60, roll=40),
        right_arm=Arm(raised=75, forward=20, bend=50),
        left_leg=Leg(flexion=50, abduction=40, roll=40, bend=95, point=35),
        right_leg=Leg(abduction=4, roll=20),
        trunk=Column(lean=-14, turn=-10),
        head=Column(lean=10, turn=-15),
    ),
    "lunging": Pose(
        left_arm=Arm(raised=70, forward=0, bend=20),
        right_arm=Arm(raised=70, forward=0, bend=20),
        left_leg=Leg(flexion=78, bend=80, abduction=6),
        right_leg=Leg(flexion=-38, bend=18, abduction=4, point=-15),
        trunk=Column(bend=6),
    ),
    "kicking": Pose(
        left_arm=Arm(raised=75, forward=25, bend=45),
        right_arm=Arm(raised=65, forward=-25, bend=35),
        left_leg=Leg(bend=12, abduction=6, roll=15),
        right_leg=Leg(flexion=82, bend=14, abduction=8, point=25),
        trunk=Column(bend=6, lean=4),
        body=Column(bend=-12),
    ),
    "boxing": Pose(
        left_arm=Arm(raised=82, forward=70, bend=25),
        right_arm=Arm(raised=50, forward=50, bend=118),
        left_leg=Leg(flexion=28, bend=26, abduction=10),
        right_leg=Leg(flexion=-18, bend=22, abduction=14, roll=30),
        trunk=Column(bend=10, turn=-25),
        head=Column(bend=6, turn=18),
    ),
    "squatting": _both(
        Arm(raised=86, forward=75, bend=15),
        Leg(flexion=98, bend=105, abduction=24, roll=18, point=-12),
        trunk=Column(bend=15),
        body=Column(bend=20),
    ),
    "waving": Pose(
        left_arm=Arm(raised=125, forward=5, roll=75, bend=60),
        right_arm=Arm(raised=34, bend=18),
        left_leg=Leg(flexion=35, abduction=6, bend=50),
        right_leg=Leg(abduction=8, roll=12),
        trunk=Column(lean=-10),
        head=Column(lean=8),
    ),
    "thinking": Pose(
        left_arm=Arm(raised=45, forward=75, roll=-15, bend=80),
        right_arm=Arm(raised=60, forward=68, roll=5, bend=118),
        left_leg=Leg(abduction=6),
        right_leg=Leg(flexion=12, abduction=8, roll=20, bend=20),
        trunk=Column(bend=8, lean=-4),
        head=Column(bend=14, turn=-10),
    ),
    "twisting": Pose(
        left_arm=Arm(raised=82, forward=-15, bend=15),
        right_arm=Arm(raised=80, forward=85, bend=50),
        left_leg=Leg(abduction=14, roll=10),
        right_leg=Leg(abduction=14, roll=10),
        trunk=Column(turn=52, bend=4),
        head=Column(turn=30),
    ),
    "crouching": Pose(
        left_arm=Arm(raised=55, forward=62, bend=55),
        right_arm=Arm(raised=68, forward=60, bend=30),
        left_leg=Leg(flexion=88, bend=100, abduction=16, roll=10, point=-12),
        right_leg=Leg(flexion=62, bend=98, abduction=16, roll=10, point=10),
        trunk=Column(bend=32, turn=8),
        head=Column(bend=-25),
        body=Column(bend=22),
    ),
    "star-jump": _both(Arm(raised=130, bend=6), Leg(abduction=34, roll=20, bend=8, point=25), head=Column(bend=-4)),
    "throwing": Pose(
        left_arm=Arm(raised=85, forward=55, bend=20),
        right_arm=Arm(raised=98, forward=-20, roll=70, bend=85),
        left_leg=Leg(flexion=42, bend=30, abduction=10),
        right_leg=Leg(flexion=-20, bend=22, abduction=12, roll=30),
        trunk=Column(bend=-10, lean=-8, turn=-30),
        head=Column(turn=28),
        body=Column(bend=-4),
    ),
}
"""Authored poses; the first is the canonical pose."""


def bone_rotations(pose: Pose) -> dict[str, NDArray[np.float64]]:
    """Return the rotations of the bones relative to their parents, about the axes of the body at rest.

    Parameters
    ----------
    pose
        The joint angles.

    Returns
    -------
    dict of str to numpy.ndarray
        Rotation matrices, shape (3, 3), by bone name of the MakeHuman rig; other bones stay at rest.
    """
    rotations = {"root": _column(pose.body, 1)}
    rotations |= dict.fromkeys(_SPINE, _column(pose.trunk, len(_SPINE)))
    rotations |= dict.fromkeys(_NECK, _column(pose.head, len(_NECK)))
    for side, arm, leg in (("L", pose.left_arm, pose.left_leg), ("R", pose.right_arm, pose.right_leg)):
        for bone, rotation in (_arm(arm) | _leg(leg)).items():
            rotations[f"{bone}.{side}"] = rotation if side == "L" else _reflected(rotation)
    return {bone: rotation.as_matrix() for bone, rotation in rotations.items()}


_JITTER = 6.0
"""Standard deviation of the perturbation of a sampled pose, in degrees."""


def perturbed_pose(random: np.random.Generator) -> Pose:
    """Draw a random mixture of two authored poses, each mirrored at random, and perturb its angles.

    Parameters
    ----------
    random
        Random generator.

    Returns
    -------
    Pose
        Every angle lies within the joint's range over the authored poses, so hinges never bend backwards.
    """
    names = list(POSES)
    ends = [POSES[names[index]] for index in random.integers(len(names), size=2)]
    first, second = ((end.mirrored() if random.random() < 0.5 else end).angles() for end in ends)
    return jittered(Pose.from_angles(first + random.uniform() * (second - first)), _JITTER, random)


def jittered(pose: Pose, deviation: float, random: np.random.Generator) -> Pose:
    """Perturb every angle of a pose.

    Parameters
    ----------
    pose
        Pose to perturb.
    deviation
        Standard deviation in degrees.
    random
        Random generator.

    Returns
    -------
    Pose
        Every angle lies within the joint's range over the authored poses.
    """
    lower, upper = _angle_ranges()
    angles = pose.angles() + random.normal(0.0, deviation, lower.shape)
    return Pose.from_angles(np.clip(angles, lower, upper))


@functools.cache
def _angle_ranges() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    angles = np.stack([end.angles() for pose in POSES.values() for end in (pose, pose.mirrored())])
    return angles.min(axis=0), angles.max(axis=0)


def _column(column: Column, bones: int) -> Rotation:
    return Rotation.from_euler("ZXY", np.array([column.turn, column.bend, column.lean]) / bones, degrees=True)


def _arm(arm: Arm) -> dict[str, Rotation]:
    """Return the rotations of the left arm: a roll of the upper arm, then its shortest swing to the direction."""
    raised, forward = np.radians(arm.raised), np.radians(arm.forward)
    side, front = np.sin(raised) * np.cos(forward), np.sin(raised) * np.sin(forward)
    target = np.array([side, -front, -np.cos(raised)])
    axis = np.cross(_UPPER_ARM, target)
    angle = np.arctan2(np.linalg.norm(axis), _UPPER_ARM @ target)
    swing = axis * (angle / max(float(np.linalg.norm(axis)), 1e-12))
    half_roll = Rotation.from_rotvec(-np.radians(arm.roll) / 2 * _UPPER_ARM)
    hinge = np.cross(_UPPER_ARM, _FOREARM)
    rest_bend = np.arctan2(np.linalg.norm(hinge), _UPPER_ARM @ _FOREARM)
    hinge /= np.linalg.norm(hinge)
    return {
        "clavicle": Rotation.from_rotvec(_CLAVICLE_SHARE * swing),
        "upperarm01": Rotation.from_rotvec((1 - _CLAVICLE_SHARE) * swing) * half_roll,
        "upperarm02": half_roll,
        "lowerarm01": Rotation.from_rotvec((np.radians(arm.bend) - rest_bend) * hinge),
    }


def _leg(leg: Leg) -> dict[str, Rotation]:
    def flexion(share: float) -> Rotation:
        return Rotation.from_euler("x", -share * leg.flexion, degrees=True)

    half_roll = Rotation.from_euler("z", leg.roll / 2, degrees=True)
    abduction = Rotation.from_euler("y", -leg.abduction, degrees=True)
    return {
        "upperleg01": flexion(1 - _THIGH_SHARE) * abduction * half_roll,
        "upperleg02": flexion(_THIGH_SHARE) * half_roll,
        "lowerleg01": Rotation.from_euler("x", leg.bend, degrees=True),
        "foot": Rotation.from_euler("x", leg.point, degrees=True),
    }


def _reflected(rotation: Rotation) -> Rotation:
    return Rotation.from_rotvec(rotation.as_rotvec() * _MIRROR)
