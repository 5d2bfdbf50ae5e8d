"""Sampled animals and people as training data for sets of both, in the frame of the generated one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.api.learning import MakesPairs, TrainingData
from benchmark.datasets.animals import CANONICAL_POSE, Animals
from benchmark.datasets.animals.people import CENTIMETRES
from benchmark.datasets.base import Entry
from benchmark.datasets.varied.bodies import AWAY_FROM
from benchmark.datasets.varied.sampler import Sampler
from benchmark.datasets.varied_animals import AnimalSampler
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT, SIDE, Camera
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.storage.lock import versions_of
from benchmark.protocols.pairs.synthetic import SyntheticTraining
from benchmark.protocols.trainings import ANIMAL_POSES

SEED = 2
"""Of the animals, and of the stream of people: 0 and 1 train and validate learners on people alone."""

TURN = 15.0
"""Standard deviation, in degrees about the vertical axis, of where a body in a pose faces."""

SHORTEST_ADULT = 1.45
"""Height in metres below which a body is a child, of which sets of animals and people have none."""

MOST_DRAWS = 60
"""Bodies of the stream among which there is an adult; every other one is."""

_IMAGES = 1 + ANIMAL_POSES


def sampled_animals(asked: SyntheticTraining, unseen: MakesPairs) -> TrainingData:
    """Pairs of sampled bodies, people and animals by turns.

    Parameters
    ----------
    asked
        How many, and the set that gives the frame.
    unseen
        Makes pairs of the subjects that are tested.
    """
    return asked.data(
        f"{asked.n_bodies} sampled animals and people in {ANIMAL_POSES} poses each, none of them in a set",
        [
            SEED,
            TURN,
            SHORTEST_ADULT,
            _IMAGES,
            asked.n_bodies,
            asked.frame(FRONT, SIDE),
            versions_of(["sampler/animals"]),
        ],
        _IMAGES,
        lambda start=0: asked.pairs(made_body, _IMAGES, start),
        unseen,
        AWAY_FROM,
    )


def made_body(number: int, draw: int) -> tuple[Camera, list[Mesh]]:
    """One body, drawn again so many times: a person where the number is even, else an animal; in centimetres.

    Raises
    ------
    DatasetError
        If no body can be made.
    """
    of_kind = number // 2
    if number % 2:
        species, meshes = AnimalSampler(SEED, ANIMAL_POSES)(of_kind, draw)
        camera = Animals().camera(Entry(species, species, CANONICAL_POSE))
    else:
        camera, meshes = FRONT, _person(of_kind, draw)
    random = np.random.default_rng([SEED, number, draw, len(meshes)])
    standing, *moved = meshes
    return camera, [standing, *(mesh.with_vertices(_turned(mesh.vertices, random)) for mesh in moved)]


def _person(number: int, draw: int) -> list[Mesh]:
    """An adult in the canonical pose, then in others, from a place of the stream that nobody else looks at."""
    stream = Sampler(SEED, poses=ANIMAL_POSES)
    for place in range(MOST_DRAWS):
        # Numbers of batches are free to leave gaps: each body has a run of its own.
        body = stream.surfaces((number * MOST_DRAWS + draw) * MOST_DRAWS + place, 1)
        if np.ptp(body.canonical[0, :, 2]) >= SHORTEST_ADULT:
            return [Mesh(CENTIMETRES * vertices, body.faces) for vertices in (body.canonical[0], *body.posed[0])]
    raise DatasetError(f"none of {MOST_DRAWS} bodies is an adult", "take another seed")


def _turned(vertices: Points, random: np.random.Generator) -> NDArray[np.float64]:
    angle = np.radians(TURN) * random.normal()
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.asarray(vertices @ turn.T)
