"""Random animals, each in its rest pose and in random poses; an animal depends only on its number."""

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
"""Species by number: animal n has species n modulo their count."""

N_VERTICES = 3500
"""Approximate number of vertices: enough for a depth image, and generated in a second."""

RELAXATIONS = 25
"""Relaxation steps; 50, as in the data set, move vertices by one or two centimetres more, half a pixel of 128."""

MOST_DRAWS = 30
"""Maximum number of draws of a body; about one body in twenty has a handle or a loose piece."""


@dataclass(frozen=True)
class AnimalSampler:
    """Sampler of animals, in centimetres, z up, facing -y.

    Parameters
    ----------
    seed
        Seed of the sample.
    poses
        Number of poses per animal, in addition to the rest pose.
    """

    seed: int
    poses: int

    def __call__(self, number: int, draw: int = 0) -> tuple[str, list[Mesh]]:
        """Generate an animal.

        Parameters
        ----------
        number
            Index in the sample.
        draw
            Number of previous draws at this index; each draw yields another animal of the same species.

        Returns
        -------
        str, list of Mesh
            The species, and the animal in its rest pose, then in the other poses, with the same triangles.

        Raises
        ------
        DatasetError
            If :data:`MOST_DRAWS` draws yield no closed body.
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
