"""Pairs that learners are trained on: the shapes of a protocol, rendered as every method is given them.

That no shape to be tested, nor another shape of its subject, is among them is checked each time they are made.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets import humans
from benchmark.datasets.base import Entry
from benchmark.datasets.canonical import canonical_entry
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.human_poses import POSES, Pose
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import camera_coordinates, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.jobs.preparation import Preparation
from benchmark.jobs.recipes import dataset_module, preparation_code, source_code
from benchmark.jobs.varied_pairs import varied_data
from benchmark.learning import TrainingData, TrainingPair
from benchmark.protocols.trainings import SAMPLED, SAMPLED_BODIES, SAMPLED_POSES, VARIED, Training
from benchmark.storage import keys
from benchmark.storage.store import Store

__all__ = ["training_data"]

Say = Callable[[str], None]

_Body = tuple[humans.Subject, Sequence[Pose]]

#: Images of a sampled body: the canonical pose and its own.
_IMAGES = 1 + SAMPLED_POSES


def training_data(
    training: Training, store: Store, data_root: Path | None, say: Say, n_sampled: int = SAMPLED_BODIES
) -> TrainingData:
    """Render the shapes of a protocol and make its pairs.

    Parameters
    ----------
    training
        The protocol.
    store
        Where images are kept.
    data_root
        The folder that holds the official sets.
    say
        Told about shapes that cannot be rendered, and about sampled bodies that are drawn again.
    n_sampled
        Number of bodies where they are sampled.

    Raises
    ------
    DatasetError
        If the set is absent.
    ConfigurationError
        If the training data would hold a subject that its models are tested on, or nothing at all.
    """
    dataset = open_dataset(training.dataset, data_root)
    preparation = Preparation(dataset, "view", store)
    tested = training.tested.of(dataset)
    if training.name == SAMPLED:
        return _sampled(training, preparation, tested, say, n_sampled)
    if training.name == VARIED:
        return _streamed(training, preparation, tested, say)
    pairs = _renderable(training.trained.of(dataset), preparation, say)
    shown = list({entry.identifier: entry for pair in pairs for entry in pair}.values())
    data = TrainingData(
        name=training.name,
        title=f"{dataset.title}, {training.words}",
        digest=keys.digest([[preparation.recipe(entry) for entry in pair] for pair in pairs]),
        subjects=tuple(dict.fromkeys(entry.subject for entry in shown)),
        identifiers=tuple(entry.identifier for entry in shown),
        n_pairs=len(pairs),
        pairs=lambda start=0: _pairs(pairs[start:], preparation),
        unseen=lambda start=0: _pairs(_renderable(tested, preparation, say)[start:], preparation),
    )
    _check_apart(data, tested)
    return data


def _renderable(entries: Iterable[Entry], preparation: Preparation, say: Say) -> list[tuple[Entry, Entry]]:
    """Shapes beside those of the same subject in the canonical pose, without those that cannot be rendered."""
    told: set[str] = set()

    def can_be_rendered(entry: Entry) -> bool:
        try:
            preparation.shape(entry)
        except ShapeError as error:
            if entry.identifier not in told:
                say(f"skipped {entry.identifier}: {error}")
            told.add(entry.identifier)
            return False
        return True

    beside = [(entry, canonical_entry(preparation.dataset, entry.subject)) for entry in entries]
    return [pair for pair in beside if all(can_be_rendered(entry) for entry in pair)]


def _pairs(pairs: Iterable[tuple[Entry, Entry]], preparation: Preparation) -> Iterator[TrainingPair]:
    targets: dict[str, NDArray[np.float32]] = {}
    for entry, target in pairs:
        if target.identifier not in targets:
            targets[target.identifier] = _image(preparation, target)
        yield TrainingPair(
            identifier=entry.identifier,
            subject=entry.subject,
            target_identifier=target.identifier,
            image=_image(preparation, entry),
            target=targets[target.identifier],
        )


def _image(preparation: Preparation, entry: Entry) -> NDArray[np.float32]:
    """The image that methods are given, from the store."""
    image = preparation.shape(entry).depth
    if image is None:
        raise ConfigurationError(f"{entry.identifier} has no depth image", "train on the view input")
    return image


def _check_apart(data: TrainingData, tested: Iterable[Entry]) -> None:
    """Raise ``ConfigurationError`` unless there are pairs and none of them shows a subject to be tested."""
    if not data.n_pairs:
        raise ConfigurationError(f"training '{data.name}' has no pairs", "check the data set with 'data check'")
    both = sorted({entry.subject for entry in tested} & set(data.subjects)) + sorted(
        {entry.identifier for entry in tested} & set(data.identifiers)
    )
    if both:
        raise ConfigurationError(
            f"training '{data.name}' would show what its models are tested on: {', '.join(both[:5])}",
            "keep the subjects of the data set apart",
        )


def _streamed(training: Training, preparation: Preparation, tested: Iterable[Entry], say: Say) -> TrainingData:
    """Bodies beyond the data set without end."""
    data = varied_data(training, lambda start=0: _pairs(_renderable(tested, preparation, say)[start:], preparation))
    _check_apart(data, tested)
    return data


def _sampled(
    training: Training, preparation: Preparation, tested: Iterable[Entry], say: Say, n_bodies: int
) -> TrainingData:
    """Pairs of bodies beyond the data set; they are made as they are read, for they are too many to be kept."""
    bodies = humans.sample_humans(n_bodies, SAMPLED_POSES, seed=0)
    names = [f"sample-{number}" for number in range(n_bodies)]
    recipes = [humans.recipe(body, pose) for body, poses in bodies for pose in (POSES[humans.CANONICAL_POSE], *poses)]
    frame = [repr(FRONT), preparation.half_width, preparation_code("view").digest]
    data = TrainingData(
        name=training.name,
        title=f"{n_bodies} sampled bodies in {SAMPLED_POSES} poses each, none of them in {preparation.dataset.title}",
        digest=keys.digest([recipes, frame, source_code(dataset_module(preparation.dataset)).digest]),
        subjects=tuple(names),
        identifiers=tuple(f"{name}_{number}" for name in names for number in range(_IMAGES)),
        n_pairs=len(recipes),
        pairs=lambda start=0: _sampled_pairs(bodies, preparation.half_width, say, start),
        unseen=lambda start=0: _pairs(_renderable(tested, preparation, say)[start:], preparation),
    )
    _check_apart(data, tested)
    return data


def _sampled_pairs(bodies: Sequence[_Body], half_width: float, say: Say, start: int) -> Iterator[TrainingPair]:
    first, skipped = divmod(start, _IMAGES)
    drawn_again = 0
    meshes = _in_all_poses(bodies[first:])
    for number in range(first, len(bodies)):
        name = f"sample-{number}"
        of_body = list(itertools.islice(meshes, _IMAGES))
        draw = 0
        while any(_leaves_frame(mesh, half_width) for mesh in of_body):
            draw, drawn_again = draw + 1, drawn_again + 1
            say(f"{name} leaves the frame and is drawn again ({drawn_again} so far)")
            of_body = list(_in_all_poses([humans.sample_human(number, SAMPLED_POSES, seed=0, draw=draw)]))
        images = [render_depth(mesh, FRONT, half_width) for mesh in of_body]
        for place, image in enumerate(images):
            if place >= skipped:
                yield TrainingPair(
                    identifier=f"{name}_{place}",
                    subject=name,
                    target_identifier=f"{name}_0",
                    image=image,
                    target=images[0],
                )
        skipped = 0


def _in_all_poses(bodies: Iterable[_Body]) -> Iterator[Mesh]:
    """Each body in the canonical pose, then in its own."""
    canonical = POSES[humans.CANONICAL_POSE]
    return humans.human_meshes((body, pose) for body, poses in bodies for pose in (canonical, *poses))


def _leaves_frame(mesh: Mesh, half_width: float) -> bool:
    return bool(np.abs(camera_coordinates(mesh, FRONT) / half_width).max() >= 1)
