"""Training data outside the data sets: sampled people, sampled animals and people, and streams of new people.

Bodies are generated while they are read, because they are too many to store.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmark.api.learning import MakesPairs, TrainingData, TrainingPair
from benchmark.api.streaming import ScannedData, StreamedAndScannedData, StreamedData
from benchmark.datasets import humans
from benchmark.datasets.animals import CANONICAL_POSE, Animals
from benchmark.datasets.animals.dataset import CENTIMETRES
from benchmark.datasets.base import Entry
from benchmark.datasets.human_poses import POSES, Pose
from benchmark.datasets.human_subjects import CLEARANCE, TESTED
from benchmark.datasets.scans.sampler import ScanSampler
from benchmark.datasets.varied.bodies import AWAY_FROM
from benchmark.datasets.varied.sampler import Sampler
from benchmark.datasets.varied.wide import WideSampler
from benchmark.datasets.varied_animals import AnimalSampler
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT, SIDE, Camera
from benchmark.geometry.depth import SIZE, camera_coordinates, render_depth
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.method_run import Preparation
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.lock import versions_of
from benchmark.protocols.trainings import ANIMAL_POSES, SAMPLED, SAMPLED_POSES, Training

MakesBody = Callable[[int, int], tuple[Camera, list[Mesh]]]
"""Makes the body of a number, drawn again so many times: a camera, and the body in the canonical pose, then others."""

SEED = 2
"""Of the animals, and of the stream of people: 0 and 1 train and validate learners on people alone."""

TURN = 15.0
"""Standard deviation, in degrees about the vertical axis, of where a body beside animals faces in a pose."""

SHORTEST_ADULT = 1.45
"""Height in metres below which a body is a child, of which sets of animals and people have none."""

MOST_DRAWS = 60
"""Bodies of the stream among which there is an adult; every other one is."""

TRAINED, VALIDATED = 0, 1
"""Seeds of the streams."""

VIEWS = 2
"""Images of each pose in the wide stream."""

SAMPLE = 1024
"""Pairs of a stream for a learner that keeps all of its pairs in memory."""


# Sampled bodies ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Sample:
    """Bodies to render.

    Parameters
    ----------
    title
        Description of the bodies.
    recipe
        Recipe of their images.
    n_images
        Number of images of a body: the canonical pose and its own poses.
    away_from
        Generated data sets of people whose subjects they avoid by ``CLEARANCE``.
    maker
        Returns an iterator over the bodies from a given one on.
    """

    title: str
    recipe: list[object]
    n_images: int
    away_from: Iterable[str]
    maker: Callable[[int], MakesBody]


def sampled_data(
    training: Training, n_bodies: int, preparation: Preparation, unseen: MakesPairs, say: Callable[[str], None]
) -> TrainingData:
    """Return pairs of sampled bodies, rendered in the frame of a data set to which they do not belong.

    Parameters
    ----------
    training
        The protocol.
    n_bodies
        Number of bodies.
    preparation
        Preparation of the data set.
    unseen
        Returns pairs of the test subjects.
    say
        Callback for messages about bodies that are drawn again.
    """
    sample = _people(n_bodies, preparation) if training.name == SAMPLED else _animals(n_bodies, preparation)
    n_images = sample.n_images

    def pairs(start: int = 0) -> Iterator[TrainingPair]:
        first = start // n_images
        bodies = _rendered(sample.maker(first), range(first, n_bodies), preparation.half_width, say)
        return itertools.islice(bodies, start % n_images, None)

    names = [_name(number) for number in range(n_bodies)]
    return TrainingData(
        name=training.name,
        title=sample.title,
        digest=keys.digest(sample.recipe),
        subjects=tuple(names),
        identifiers=tuple(f"{name}_{place}" for name in names for place in range(n_images)),
        n_pairs=n_bodies * n_images,
        pairs=pairs,
        unseen=unseen,
        clearance=dict.fromkeys(sample.away_from, CLEARANCE),
    )


def _name(number: int) -> str:
    return f"sample-{number}"


def _rendered(
    make: MakesBody, numbers: Iterable[int], half_width: float, say: Callable[[str], None]
) -> Iterator[TrainingPair]:
    """Yield the pairs of one body after the other; a body that leaves the frame is drawn again."""
    drawn_again = 0
    for number in numbers:
        name, draw = _name(number), 0
        camera, meshes = make(number, draw)
        while any(_leaves_frame(mesh, camera, half_width) for mesh in meshes):
            draw, drawn_again = draw + 1, drawn_again + 1
            say(f"{name} leaves the frame and is drawn again ({drawn_again} so far)")
            camera, meshes = make(number, draw)
        images = [render_depth(mesh, camera, half_width) for mesh in meshes]
        for place, image in enumerate(images):
            yield TrainingPair(
                identifier=f"{name}_{place}",
                subject=name,
                target_identifier=f"{name}_0",
                image=image,
                target=images[0],
            )


def _leaves_frame(mesh: Mesh, camera: Camera, half_width: float) -> bool:
    return bool(np.abs(camera_coordinates(mesh, camera) / half_width).max() >= 1)


def _frame(preparation: Preparation, *cameras: Camera) -> list[object]:
    """Return the recipe of the images of given meshes."""
    return [*map(repr, cameras), preparation.half_width, versions_of(["preparation/view"])]


def _people(n_bodies: int, preparation: Preparation) -> _Sample:
    """Return people outside a data set, in poses between two authored ones."""
    bodies = humans.sample_humans(n_bodies, SAMPLED_POSES, seed=0)
    n_images = 1 + SAMPLED_POSES

    def maker(first: int) -> MakesBody:
        # Consecutive bodies are posed together, which is faster.
        in_turn = humans.human_meshes(_in_all_poses(bodies[first:]))

        def make(number: int, draw: int) -> tuple[Camera, list[Mesh]]:
            if not draw:
                return FRONT, list(itertools.islice(in_turn, n_images))
            redrawn = humans.sample_human(number, SAMPLED_POSES, seed=0, draw=draw)
            return FRONT, list(humans.human_meshes(_in_all_poses([redrawn])))

        return make

    recipes = [humans.recipe(body, pose) for body, pose in _in_all_poses(bodies)]
    return _Sample(
        f"{n_bodies} sampled bodies in {SAMPLED_POSES} poses each, none of them in {preparation.dataset.title}",
        [recipes, _frame(preparation, FRONT), versions_of(["sampler/people"])],
        n_images,
        TESTED,
        maker,
    )


def _in_all_poses(bodies: Iterable[tuple[humans.Subject, Sequence[Pose]]]) -> Iterator[tuple[humans.Subject, Pose]]:
    """Yield each body in the canonical pose, then in its own poses."""
    return ((body, pose) for body, poses in bodies for pose in (POSES[humans.CANONICAL_POSE], *poses))


def _animals(n_bodies: int, preparation: Preparation) -> _Sample:
    """Return people and animals in turn."""
    n_images = 1 + ANIMAL_POSES
    frame, versions = _frame(preparation, FRONT, SIDE), versions_of(["sampler/animals"])
    return _Sample(
        f"{n_bodies} sampled animals and people in {ANIMAL_POSES} poses each, none of them in a set",
        [SEED, TURN, SHORTEST_ADULT, n_images, n_bodies, frame, versions],
        n_images,
        AWAY_FROM,
        lambda _: person_or_animal,
    )


def person_or_animal(number: int, draw: int) -> tuple[Camera, list[Mesh]]:
    """Return a body after some redraws: a person if the number is even, else an animal; in centimetres.

    Raises
    ------
    DatasetError
        If no body can be generated.
    """
    of_kind = number // 2
    if number % 2:
        species, meshes = AnimalSampler(SEED, ANIMAL_POSES)(of_kind, draw)
        camera = Animals().camera(Entry(species, species, CANONICAL_POSE))
    else:
        camera, meshes = FRONT, _adult(of_kind, draw)
    random = np.random.default_rng([SEED, number, draw, len(meshes)])
    standing, *moved = meshes
    return camera, [standing, *(mesh.with_vertices(_turned(mesh.vertices, random)) for mesh in moved)]


def _adult(number: int, draw: int) -> list[Mesh]:
    """Return an adult in the canonical pose, then in others, from a part of the stream that is used nowhere else."""
    stream = Sampler(SEED, poses=ANIMAL_POSES)
    for place in range(MOST_DRAWS):
        # Each body has its own range of batch numbers; gaps do no harm.
        body = stream.surfaces((number * MOST_DRAWS + draw) * MOST_DRAWS + place, 1)
        if np.ptp(body.canonical[0, :, 2]) >= SHORTEST_ADULT:
            return [Mesh(CENTIMETRES * vertices, body.faces) for vertices in (body.canonical[0], *body.posed[0])]
    raise DatasetError(f"none of {MOST_DRAWS} bodies is an adult", "take another seed")


def _turned(vertices: Points, random: np.random.Generator) -> Points:
    angle = np.radians(TURN) * random.normal()
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.asarray(vertices @ turn.T)


# Streams of fresh bodies ---------------------------------------------------------------------------------------------


def varied_data(training: Training, unseen: MakesPairs) -> StreamedAndScannedData:
    """Return the streams of new people, each for training and for validation, without common bodies.

    Parameters
    ----------
    training
        The protocol.
    unseen
        Returns pairs of the test subjects.
    """
    fresh, validation = Sampler(TRAINED), Sampler(VALIDATED)
    common: dict[str, Any] = {
        "name": training.name,
        "n_pairs": SAMPLE,
        "pairs": lambda start=0: _fresh_pairs(fresh, start),
        "unseen": unseen,
        "clearance": dict.fromkeys(AWAY_FROM, CLEARANCE),
    }
    plain = StreamedData(
        **common,
        **_names("varied"),
        title="fresh bodies in free poses, none of them a subject of a generated set of people",
        digest=keys.digest([repr(fresh), repr(validation), SAMPLE, versions_of(["sampler/varied"])]),
        fresh=fresh,
        validation=validation,
        surfaces=fresh.surfaces,
        validation_surfaces=validation.surfaces,
    )
    wide = WideSampler(seed=TRAINED, views=VIEWS)
    wide_stream = replace(
        plain,
        **_names("wide"),
        title="fresh bodies in free poses from several sides, no subject and no authored pose of a generated set",
        digest=keys.digest([repr(wide), repr(validation), SAMPLE, versions_of(["sampler/wide"])]),
        fresh=wide,
    )
    scans, validation_scans = ScanSampler(seed=TRAINED), ScanSampler(seed=VALIDATED)
    scanned = ScannedData(
        **common,  # the pairs of the plain stream, which training on scans ignores
        **_names("scanned"),
        title="fresh bodies as scanners leave them, no subject, no authored pose and no scan of a generated set",
        digest=keys.digest([repr(scans), repr(validation_scans), versions_of(["sampler/scans"])]),
        scans=scans,
        validation=validation_scans,
    )
    return StreamedAndScannedData(**vars(plain) | {"wide": wide_stream, "scanned": scanned})


def _names(prefix: str) -> dict[str, Any]:
    names = (f"{prefix}-{TRAINED}-0-0 and all that follow",)
    return {"subjects": names, "identifiers": names}


def _fresh_pairs(sampler: Sampler, start: int) -> Iterator[TrainingPair]:
    first, skipped = divmod(start, sampler.poses)
    bodies = (sampler(number, 1, SIZE) for number in range(first, SAMPLE // sampler.poses))
    pairs = (
        TrainingPair(
            identifier=f"{body.identifiers[0]}_{place}",
            subject=body.identifiers[0],
            target_identifier=body.identifiers[0],
            image=image,
            target=body.fronts[0],
        )
        for body in bodies
        for place, image in enumerate(body.images[0])
    )
    return itertools.islice(pairs, skipped, None)
