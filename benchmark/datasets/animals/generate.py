"""One animal in one pose: body, skin and skeleton put together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.animals.body import Field, surface
from benchmark.datasets.animals.poses import POSES
from benchmark.datasets.animals.relaxation import Relaxation
from benchmark.datasets.animals.skeleton import Pose, Skeleton
from benchmark.datasets.animals.skinning import blend, bone_weights
from benchmark.datasets.animals.species import SPECIES
from benchmark.geometry.mesh import Mesh

N_VERTICES = 9000
"""Vertices that a generated animal has, about."""

RELAXATIONS = 30
"""Local and global steps that spread the strain of the joints."""


@dataclass(frozen=True)
class Animal:
    """A skin in the rest pose with all that moves it."""

    skeleton: Skeleton
    mesh: Mesh
    weights: NDArray[np.float64]
    relaxation: Relaxation

    def posed(self, pose: Pose) -> Mesh:
        """Return the skin in a pose, standing on z = 0 with the middle of its extent above the origin."""
        vertices = np.array(self.mesh.vertices)
        if pose:
            blended = blend(vertices, self.weights, *self.skeleton.transforms(pose))
            vertices = self.relaxation(*blended, RELAXATIONS)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle = 0.5 * (low + high)
        return self.mesh.with_vertices(vertices - [middle[0], middle[1], low[2]])


@lru_cache(maxsize=None)
def animal(name: str) -> Animal:
    """Return the animal of a species, built once per process."""
    species = SPECIES[name]
    skeleton = Skeleton.of(species)
    mesh, owners = surface(Field.of(species, skeleton), N_VERTICES)
    weights = bone_weights(mesh, owners, skeleton)
    return Animal(skeleton, mesh, weights, Relaxation.of(mesh, weights))


def generated_mesh(name: str, pose: int) -> Mesh:
    """Return one of the animals in the pose of this number, in centimetres."""
    return animal(name).posed(list(POSES[name].values())[pose])
