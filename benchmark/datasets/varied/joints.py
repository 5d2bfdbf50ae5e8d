"""Bone rotations of many poses at once: :func:`benchmark.datasets.human_poses.bone_rotations` for arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets import human_poses as single

Floats = NDArray[np.float64]

_MIRROR = np.diag([-1.0, 1.0, 1.0])
"""Reflection of left and right."""


def batch_rotations(angles: Floats) -> dict[str, Floats]:
    """Return the rotation matrices of every moving bone by name, shape (n, 3, 3) each.

    Parameters
    ----------
    angles
        Angles of n poses in the order of :meth:`benchmark.datasets.human_poses.Pose.angles`, shape (n, 27), in
        degrees.
    """
    left_arm, right_arm, left_leg, right_leg, trunk, head, body = np.split(np.radians(angles), _STARTS, axis=1)
    rotations = {"root": _column(body)}
    rotations |= dict.fromkeys(single._SPINE, _column(trunk / len(single._SPINE)))
    rotations |= dict.fromkeys(single._NECK, _column(head / len(single._NECK)))
    for side, arm, leg in (("L", left_arm, left_leg), ("R", right_arm, right_leg)):
        for bone, matrices in (_arm(arm) | _leg(leg)).items():
            # Conjugation by a reflection converts a rotation to the other side.
            rotations[f"{bone}.{side}"] = matrices if side == "L" else _MIRROR @ matrices @ _MIRROR
    return rotations


_STARTS = (4, 8, 13, 18, 21, 24)
"""Offsets of the second and later parts of a pose in its angles."""


def _column(angles: Floats) -> Floats:
    """Return rotations by (bend, lean, turn) as in ``Rotation.from_euler("ZXY", [turn, bend, lean])``, intrinsic."""
    bend, lean, turn = angles.T
    return _about(turn, 2) @ _about(bend, 0) @ _about(lean, 1)


def _arm(angles: Floats) -> dict[str, Floats]:
    raised, forward, roll, bend = angles.T
    upper, fore = single._UPPER_ARM, single._FOREARM
    target = np.stack([np.sin(raised) * np.cos(forward), -np.sin(raised) * np.sin(forward), -np.cos(raised)], axis=1)
    axis = np.cross(upper, target)
    length = np.linalg.norm(axis, axis=1)
    swing = axis * (np.arctan2(length, target @ upper) / np.maximum(length, 1e-12))[:, None]
    half_roll = _rotation(-roll[:, None] / 2 * upper)
    hinge = np.cross(upper, fore)
    rest_bend = np.arctan2(np.linalg.norm(hinge), upper @ fore)
    return {
        "clavicle": _rotation(single._CLAVICLE_SHARE * swing),
        "upperarm01": _rotation((1 - single._CLAVICLE_SHARE) * swing) @ half_roll,
        "upperarm02": half_roll,
        "lowerarm01": _rotation((bend - rest_bend)[:, None] * (hinge / np.linalg.norm(hinge))),
    }


def _leg(angles: Floats) -> dict[str, Floats]:
    flexion, abduction, roll, bend, point = angles.T
    half_roll = _about(roll / 2, 2)
    share = single._THIGH_SHARE
    return {
        "upperleg01": _about(-(1 - share) * flexion, 0) @ _about(-abduction, 1) @ half_roll,
        "upperleg02": _about(-share * flexion, 0) @ half_roll,
        "lowerleg01": _about(bend, 0),
        "foot": _about(point, 0),
    }


def _about(angle: Floats, axis: int) -> Floats:
    """Return rotation matrices about a coordinate axis, shape (n, 3, 3)."""
    vectors = np.zeros((len(angle), 3))
    vectors[:, axis] = angle
    return _rotation(vectors)


def _rotation(vectors: Floats) -> Floats:
    """Return the rotation matrices of rotation vectors, shape (n, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.maximum(angle, 1e-12)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross))
