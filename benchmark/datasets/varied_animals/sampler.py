"""Fresh animals, each in its rest pose and in poses of its own; an animal is a function of its number alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmark.datasets.animals.anatomy import Species
from benchmark.datasets.animals.body import Field, surface
from benchmark.datasets.animals.generate import SPECIES
from benchmark.datasets.animals.relaxation import Relaxation
from benchmark.datasets.animals.skeleton import Skeleton
from benchmark.datasets.animals.skinning import blend, bone_weights
from benchmark.datasets.varied_animals.motion import drawn_motion
from benchmark.datasets.varied_animals.proportions import drawn_species
from benchmark.errors import DatasetError, InvalidMesh
from benchmark.geometry.mesh import Mesh

SPECIES_IN_TURN = tuple(SPECIES)
"""Animal number n is of species n modulo their number."""

N_VERTICES = 3500
"""Vertices of a fresh animal, about: enough for a depth image, and made in a second."""

RELAXATIONS = 25
"""Steps of the relaxation; fifty, as in the set, move a vertex by one or two centimetres more, half a pixel of 128."""

MOST_DRAWS = 30
"""Draws of a body after which the sample fails; about one body in twenty has a handle or a loose piece."""


@dataclass(frozen=True)
class AnimalSampler:
    """Makes animals, in centimetres, z up, facing -y.

    Parameters
    ----------
    seed
        Seed of the sample.
    poses
        Poses of each animal, beside the rest pose.
    """

    seed: int
    poses: int

    def __call__(self, number: int, draw: int = 0) -> tuple[str, list[Mesh]]:
        """Make one animal.

        Parameters
        ----------
        number
            Place in the sample.
        draw
            How often this place was drawn before; each draw gives another animal of the same species.

        Returns
        -------
        str, list of Mesh
            Its species, and the animal in its rest pose, then in the others, with the same triangles.

        Raises
        ------
        DatasetError
            If no closed body was found in :data:`MOST_DRAWS` draws.
        """
        name = SPECIES_IN_TURN[number % len(SPECIES_IN_TURN)]
        random = np.random.default_rng([self.seed, number, draw])
        for _ in range(MOST_DRAWS):
            try:
                return name, self._posed(drawn_species(SPECIES[name], random), random)
            except InvalidMesh:
                continue
        raise DatasetError(f"animal {number} of sample {self.seed} has no closed body", "take another seed")

    def _posed(self, species: Species, random: np.random.Generator) -> list[Mesh]:
        skeleton = Skeleton.of(species)
        mesh, owners = surface(Field.of(species, skeleton), N_VERTICES)
        weights = bone_weights(mesh, owners, skeleton)
        relaxation = Relaxation.of(mesh, weights)
        rest = np.array(mesh.vertices)
        moved = [
            relaxation(*blend(rest, weights, *drawn_motion(skeleton, species.name, random)), RELAXATIONS)
            for _ in range(self.poses)
        ]
        return [mesh, *(mesh.with_vertices(vertices) for vertices in moved)]
