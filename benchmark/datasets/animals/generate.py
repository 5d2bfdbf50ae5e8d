"""Animals in poses, from body, skin and skeleton."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.animals.apes import GORILLA
from benchmark.datasets.animals.carnivores import CAT, DOG, WOLF
from benchmark.datasets.animals.hoofed import CENTAUR, HORSE
from benchmark.datasets.animals.poses import POSES
from benchmark.datasets.animals.skeleton import Pose, Skeleton
from benchmark.datasets.animals.skinning import blend, bone_weights
from benchmark.geometry.mesh import Mesh

if TYPE_CHECKING:
    from benchmark.datasets.animals.relaxation import Relaxation

SPECIES = {species.name: species for species in (CAT, CENTAUR, DOG, GORILLA, HORSE, WOLF)}
"""Generated bodies by class name.

The numbers are original, based on general knowledge of each animal's build and set by eye. Only the overall size
follows TOSCA (Bronstein, Bronstein and Kimmel, 2008), so that the stand-in has the same scale. Each row of a tube is
(bone, forward, up, side, depth, breadth) in centimetres; see :mod:`.anatomy`.
"""

N_VERTICES = 9000
"""Approximate number of vertices of a generated animal."""

RELAXATIONS = 50
"""Number of relaxation steps, which distribute the strain at the joints."""


@dataclass(frozen=True)
class Animal:
    """A skin in the rest pose with skeleton, weights and relaxation."""

    skeleton: Skeleton
    mesh: Mesh
    weights: NDArray[np.float64]
    relaxation: Relaxation

    @classmethod
    def of(cls, name: str) -> Animal:
        """Build the animal of a species."""
        from benchmark.datasets.animals.body import Field, surface  # imports numba
        from benchmark.datasets.animals.relaxation import Relaxation

        species = SPECIES[name]
        skeleton = Skeleton.of(species)
        mesh, owners = surface(Field.of(species, skeleton), N_VERTICES)
        weights = bone_weights(mesh, owners, skeleton)
        return cls(skeleton, mesh, weights, Relaxation.of(mesh, weights))

    def posed(self, pose: Pose) -> Mesh:
        """Return the skin in a pose."""
        vertices = np.array(self.mesh.vertices)
        if pose:
            blended = blend(vertices, self.weights, *self.skeleton.transforms(pose))
            vertices = self.relaxation(*blended, RELAXATIONS)
        return self.mesh.with_vertices(vertices)


@cache
def animal(name: str) -> Animal:
    """Return the animal of a species, built once per process."""
    return Animal.of(name)


def generated_mesh(name: str, pose: str) -> Mesh:
    """Generate an animal in one of its poses, in centimetres."""
    return animal(name).posed(POSES[name][pose])


def generated_recipe(name: str, pose: str) -> str:
    """Return a digest of the proportions and pose angles that determine a mesh."""
    parts = repr((SPECIES[name], sorted(POSES[name][pose].items())))
    return f"animal {hashlib.sha256(parts.encode()).hexdigest()}"
