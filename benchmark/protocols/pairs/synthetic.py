"""Training data that is made, not read: what is asked for, and how bodies become pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.api.learning import MakesPairs, TrainingData, TrainingPair
from benchmark.datasets.base import Dataset
from benchmark.datasets.human_subjects import CLEARANCE
from benchmark.geometry.camera import Camera
from benchmark.geometry.depth import camera_coordinates, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.lock import versions_of
from benchmark.protocols.trainings import Training

Say = Callable[[str], None]

MakesImages = Callable[[int, int], tuple[Camera, list[Mesh]]]
"""Makes the body of a number, drawn again so many times: a camera, and the body in the canonical pose, then others."""


@dataclass(frozen=True)
class SyntheticTraining:
    """Bodies that are asked for.

    Parameters
    ----------
    training
        The protocol.
    dataset
        The set whose frame the bodies are rendered in; none of its shapes is among them.
    half_width
        Half of the side of that frame.
    n_bodies
        How many.
    say
        Told about bodies that are drawn again.
    """

    training: Training
    dataset: Dataset
    half_width: float
    n_bodies: int
    say: Say

    def frame(self, *cameras: Camera) -> list[object]:
        """Return what determines the images of given meshes, for a digest."""
        return [*map(repr, cameras), self.half_width, versions_of(["preparation/view"])]

    def data(
        self,
        title: str,
        recipe: list[object],
        images: int,
        pairs: MakesPairs,
        unseen: MakesPairs,
        away_from: Iterable[str],
    ) -> TrainingData:
        """The bodies as training data; they are made as they are read, for they are too many to be kept.

        Parameters
        ----------
        title
            What they are, in words.
        recipe
            What determines their images.
        images
            Images of a body: the canonical pose and its own.
        pairs
            Makes the pairs.
        unseen
            Makes pairs of the subjects that are tested.
        away_from
            Generated sets of people from whose subjects the bodies keep ``CLEARANCE``.
        """
        names = [_body_name(number) for number in range(self.n_bodies)]
        return TrainingData(
            name=self.training.name,
            title=title,
            digest=keys.digest(recipe),
            subjects=tuple(names),
            identifiers=tuple(f"{name}_{place}" for name in names for place in range(images)),
            n_pairs=self.n_bodies * images,
            pairs=pairs,
            unseen=unseen,
            clearance=dict.fromkeys(away_from, CLEARANCE),
        )

    def pairs(self, made: MakesImages, images: int, start: int) -> Iterator[TrainingPair]:
        """Pairs of body after body, each rendered in the canonical pose and in its others.

        Parameters
        ----------
        made
            Makes a body.
        images
            How many meshes of a body it makes.
        start
            The first pair to make.
        """
        first, skipped = divmod(start, images)
        drawn_again = 0
        for number in range(first, self.n_bodies):
            name, draw = _body_name(number), 0
            camera, meshes = made(number, draw)
            while any(_leaves_frame(mesh, camera, self.half_width) for mesh in meshes):
                draw, drawn_again = draw + 1, drawn_again + 1
                self.say(f"{name} leaves the frame and is drawn again ({drawn_again} so far)")
                camera, meshes = made(number, draw)
            rendered: list[NDArray[np.float32]] = [render_depth(mesh, camera, self.half_width) for mesh in meshes]
            for place in range(skipped, images):
                yield TrainingPair(
                    identifier=f"{name}_{place}",
                    subject=name,
                    target_identifier=f"{name}_0",
                    image=rendered[place],
                    target=rendered[0],
                )
            skipped = 0


def _body_name(number: int) -> str:
    return f"sample-{number}"


def _leaves_frame(mesh: Mesh, camera: Camera, half_width: float) -> bool:
    return bool(np.abs(camera_coordinates(mesh, camera) / half_width).max() >= 1)
