"""Sampled people as training data: bodies that are none of a set's, in poses between two authored ones."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

from benchmark.api.learning import MakesPairs, TrainingData, TrainingPair
from benchmark.datasets import humans
from benchmark.datasets.human_poses import POSES, Pose
from benchmark.datasets.human_subjects import TESTED
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.lock import versions_of
from benchmark.protocols.pairs.synthetic import SyntheticTraining
from benchmark.protocols.trainings import SAMPLED_POSES

_Body = tuple[humans.Subject, Sequence[Pose]]

_IMAGES = 1 + SAMPLED_POSES
"""Images of a body: the canonical pose and its own."""


def sampled_people(asked: SyntheticTraining, unseen: MakesPairs) -> TrainingData:
    """Pairs of sampled people.

    Parameters
    ----------
    asked
        How many, and the set that they are none of.
    unseen
        Makes pairs of the subjects that are tested.
    """
    bodies = humans.sample_humans(asked.n_bodies, SAMPLED_POSES, seed=0)
    recipes = [humans.recipe(body, pose) for body, poses in bodies for pose in (POSES[humans.CANONICAL_POSE], *poses)]
    return asked.data(
        f"{asked.n_bodies} sampled bodies in {SAMPLED_POSES} poses each, none of them in {asked.dataset.title}",
        [recipes, asked.frame(FRONT), versions_of(["sampler/people"])],
        _IMAGES,
        lambda start=0: _pairs(bodies, asked, start),
        unseen,
        TESTED,
    )


def _pairs(bodies: Sequence[_Body], asked: SyntheticTraining, start: int) -> Iterator[TrainingPair]:
    # Bodies in a row are posed together, which is faster.
    in_turn = _in_all_poses(bodies[start // _IMAGES :])

    def made(number: int, draw: int) -> tuple[Camera, list[Mesh]]:
        again = [humans.sample_human(number, SAMPLED_POSES, seed=0, draw=draw)]
        return FRONT, list(itertools.islice(_in_all_poses(again) if draw else in_turn, _IMAGES))

    return asked.pairs(made, _IMAGES, start)


def _in_all_poses(bodies: Iterable[_Body]) -> Iterator[Mesh]:
    """Each body in the canonical pose, then in its own."""
    canonical = POSES[humans.CANONICAL_POSE]
    return humans.human_meshes((body, pose) for body, poses in bodies for pose in (canonical, *poses))
