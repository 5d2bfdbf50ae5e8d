"""Bones of a body, and their transforms in a pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmark.datasets.animals.anatomy import Species

Aim = float | tuple[float, float] | None
"""Direction of a bone: the sagittal angle, with or without the outward angle; None to follow the parent bone."""

Pose = Mapping[str, Sequence[Aim] | None]
"""Aims along the chain of each part; None keeps the directions of the rest pose in any pose of the parent."""


@dataclass(frozen=True)
class Bone:
    """A rigid segment: its name, the index of its parent (-1 for the root), its joint and its far end, shape (3,)."""

    name: str
    parent: int
    joint: NDArray[np.float64]
    end: NDArray[np.float64]

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector from the joint to the far end in the rest pose, shape (3,)."""
        span = self.end - self.joint
        return np.asarray(span / np.linalg.norm(span))


@dataclass(frozen=True)
class Skeleton:
    """Bones, parents before children, and the bones of each part in order."""

    bones: tuple[Bone, ...]
    chains: Mapping[str, tuple[int, ...]]

    @classmethod
    def of(cls, species: Species) -> Skeleton:
        """Create the skeleton from the sections of a species."""
        bones: list[Bone] = []
        index: dict[str, int] = {"": -1}
        chains: dict[str, tuple[int, ...]] = {}
        for part in species.parts():
            joints = [section for section in part.sections if section.bone]
            if not joints:
                continue
            parent = index[part.parent]
            for joint, end in pairwise([*joints, part.sections[-1]]):
                bones.append(Bone(joint.bone, parent, joint.position, end.position))
                parent = index[joint.bone] = len(bones) - 1
            chains[part.part] = tuple(index[joint.bone] for joint in joints)
        return cls(tuple(bones), chains)

    def index(self, name: str) -> int:
        """Return the index of a bone by name."""
        return [bone.name for bone in self.bones].index(name)

    def transforms(self, pose: Pose) -> tuple[Rotation, NDArray[np.float64]]:
        """Return the transforms of all bones in a pose.

        After following its parent, a bone rotates by the smallest angle to its aim. Aims are directions in the world,
        so that a leg stays planted when the back bends.

        Parameters
        ----------
        pose
            Aims by part; ``"hind"`` is for both sides, ``"hind.left"`` for one side with precedence over ``"hind"``.

        Returns
        -------
        Rotation, numpy.ndarray
            One rotation per bone, and translations of shape (bones, 3): a point p on bone b moves to R_b p + t_b.
        """
        aims = self._aims(pose)
        rotations: list[Rotation] = []
        translations = np.zeros((len(self.bones), 3))
        for k, bone in enumerate(self.bones):
            carried = rotations[bone.parent] if bone.parent >= 0 else Rotation.identity()
            target = aims.get(k)
            turned = carried if target is None else smallest_rotation(carried.apply(bone.direction), target) * carried
            joint = carried.apply(bone.joint) + translations[bone.parent] if bone.parent >= 0 else bone.joint
            rotations.append(turned)
            translations[k] = joint - turned.apply(bone.joint)
        return Rotation.concatenate(rotations), translations

    def _aims(self, pose: Pose) -> dict[int, NDArray[np.float64]]:
        aims: dict[int, NDArray[np.float64]] = {}
        for part in sorted(pose, key=lambda name: "." in name):
            for chain in [self.chains[name] for name in self.chains if name == part or name.startswith(f"{part}.")]:
                directions = pose[part]
                if directions is None:
                    aims.update({k: self.bones[k].direction for k in chain})
                    continue
                outward = -1.0 if self.bones[chain[0]].name.endswith(".right") else 1.0
                for k, aim in zip(chain, directions, strict=False):
                    aims.pop(k, None)
                    if aim is not None:
                        aims[k] = direction(aim, outward)
        return aims


def direction(aim: float | tuple[float, float], outward: float = 1.0) -> NDArray[np.float64]:
    """Return the unit vector of an aim, shape (3,).

    Parameters
    ----------
    aim
        Sagittal angle in degrees (0 forward, 90 up, 180 backward, -90 down), or a pair with the outward angle in
        degrees (0 in the sagittal plane, 90 straight out to the side).
    outward
        1 for the left side and the midline, with +x as outward; -1 for the right side.
    """
    sagittal, side = np.radians(aim if isinstance(aim, tuple) else (aim, 0.0))
    return np.array([outward * np.sin(side), -np.cos(side) * np.cos(sagittal), np.cos(side) * np.sin(sagittal)])


def smallest_rotation(start: NDArray[np.float64], end: NDArray[np.float64]) -> Rotation:
    """Return the rotation by the smallest angle from one unit vector to another, both of shape (3,).

    Opposite vectors rotate about the x axis, so they must lie in the sagittal plane.
    """
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    axis = axis / sine if sine > 1e-9 else np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(np.arctan2(sine, float(start @ end)) * axis)
