"""Fresh bodies as a streamed network sees them: a batch is a function of its number alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmark.streaming import Fresh, MakesFresh
from learned.streamed.configuration import Streamed
from learned.streamed.crop import seen_by

OVERSAMPLING = {"varied": 2.0, "wide": 1.5}
"""Pixels rendered for each side of a pixel that the network sees, by stream."""


@dataclass(frozen=True, eq=False)
class ImageBatch:
    """Pairs to train on; the images of one body are neighbours.

    Parameters
    ----------
    number
        Place in the stream.
    identifiers
        Names of the bodies.
    images
        Depth, shape (bodies * k, 1, r, r).
    targets
        Depth of each side, then the mask, shape (bodies * k, sides + 1, r, r).
    poses
        Images of each body, k.
    drawn_again
        How often something was drawn again, by reason.
    """

    number: int
    identifiers: tuple[str, ...]
    images: Tensor
    targets: Tensor
    poses: int
    drawn_again: Mapping[str, int]


@dataclass(frozen=True)
class MakesImages:
    """Makes batches of images; can be sent to another process.

    Parameters
    ----------
    make
        Makes fresh bodies.
    configuration
        What the network sees of them.
    bodies
        Bodies of each batch.
    """

    make: MakesFresh
    configuration: Streamed
    bodies: int

    def __call__(self, number: int) -> ImageBatch:
        """Make one batch."""
        size = round(OVERSAMPLING[self.configuration.stream] * self.configuration.resolution)
        fresh = self.make(number, self.bodies, size)
        return batch_of(fresh, number, self.configuration)


def batch_of(fresh: Fresh, number: int, configuration: Streamed) -> ImageBatch:
    """Fresh bodies at the resolution of a network, without their frame if it does without."""
    poses = fresh.images.shape[1]
    images = [seen_by(configuration, image[None]) for of_body in fresh.images for image in of_body]
    targets = []
    for front, back in zip(fresh.fronts, fresh.backs, strict=True):
        sides = seen_by(configuration, np.stack([front, back][: configuration.sides]))
        targets.append(np.concatenate([sides, (sides[:1] > 0).astype(np.float32)]))
    repeated = torch.from_numpy(np.stack(targets)).repeat_interleave(poses, dim=0)
    return ImageBatch(
        number, fresh.identifiers, torch.from_numpy(np.stack(images)), repeated, poses, dict(fresh.drawn_again)
    )
