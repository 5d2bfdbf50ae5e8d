"""Random poses of an animal: mixtures of two authored poses of its species per chain, with random perturbations."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmark.datasets.animals.poses import POSES
from benchmark.datasets.animals.skeleton import Pose, Skeleton

JITTER = 7.0
"""Standard deviation of the random rotation of a joint about each axis, in degrees."""

APART = 0.25
"""Standard deviation of the mixing weight between chains, which puts legs out of step."""

_SHARED = ("trunk", "fore", "hind", "tail")
"""Chains shared by a horse and the lower body of a centaur."""

_UPRIGHT: Pose = {"torso": None, "neck": None, "head": None}


def _of_the_other(poses: Mapping[str, Pose], rest: Pose) -> list[Pose]:
    """Return the four-legged part of horse poses for the centaur, or of centaur poses for the horse."""
    shared = [
        {name: aims for name, aims in pose.items() if name.partition(".")[0] in _SHARED} for pose in poses.values()
    ]
    return [{**rest, **pose} for pose in shared if pose]


_CARNIVORES = [pose for name in ("cat", "dog", "wolf") for pose in POSES[name].values()]

LIBRARY: Mapping[str, tuple[Pose, ...]] = {
    **dict.fromkeys(("cat", "dog", "wolf"), tuple(_CARNIVORES)),
    "horse": (*POSES["horse"].values(), *_of_the_other(POSES["centaur"], {})),
    "centaur": (*POSES["centaur"].values(), *_of_the_other(POSES["horse"], _UPRIGHT)),
    "gorilla": tuple(POSES["gorilla"].values()),
}
"""Authored poses available to each species: those of all species with the same bones."""


def drawn_motion(skeleton: Skeleton, species: str, random: np.random.Generator) -> tuple[Rotation, NDArray[np.float64]]:
    """Draw a pose.

    Parameters
    ----------
    skeleton
        The bones in the rest pose.
    species
        Species with the poses to mix.
    random
        Random generator.

    Returns
    -------
    Rotation, numpy.ndarray
        One rotation per bone, and translations of shape (bones, 3); see :meth:`Skeleton.transforms`.
    """
    library = LIBRARY[species]
    first, second = (_joint_turns(skeleton, library[random.integers(len(library))]) for _ in range(2))
    common = random.uniform()
    shares = np.zeros(len(skeleton.bones))
    for chain in skeleton.chains.values():
        shares[list(chain)] = np.clip(common + APART * random.normal(), 0.0, 1.0)
    between = first * Rotation.from_rotvec(shares[:, None] * (first.inv() * second).as_rotvec())
    shaken = between * Rotation.from_rotvec(np.radians(JITTER) * random.normal(size=(len(shares), 3)))
    return _carried(skeleton, shaken)


def _joint_turns(skeleton: Skeleton, pose: Pose) -> Rotation:
    """Return the rotation of each bone relative to its parent."""
    rotations, _ = skeleton.transforms(pose)
    parents = [bone.parent for bone in skeleton.bones]
    of_parents = Rotation.from_matrix(
        [np.eye(3) if parent < 0 else rotations[parent].as_matrix() for parent in parents]
    )
    return of_parents.inv() * rotations


def _carried(skeleton: Skeleton, turns: Rotation) -> tuple[Rotation, NDArray[np.float64]]:
    """Return world rotations and translations of bones from rotations relative to their parents."""
    local = turns.as_matrix()
    rotations, translations = np.empty_like(local), np.zeros((len(local), 3))
    for k, bone in enumerate(skeleton.bones):
        if bone.parent < 0:
            rotations[k], joint = local[k], bone.joint
        else:
            rotations[k] = rotations[bone.parent] @ local[k]
            joint = rotations[bone.parent] @ bone.joint + translations[bone.parent]
        translations[k] = joint - rotations[k] @ bone.joint
    return Rotation.from_matrix(rotations), translations
