"""Training batches of fresh bodies for streamed networks, each determined by its number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmark.api.streaming import Fresh, MakesFresh
from learned.images import Floats, cropped, shrunk, window
from learned.streamed.configuration import Streamed

OVERSAMPLING = {"varied": 2.0, "wide": 1.5}
"""Rendered pixels per network pixel, along each side, by stream."""


CELL = 8
"""Pixels per side of the coarse pixels whose canonical positions are predicted."""


def seen_by(configuration: Streamed, images: Floats) -> Floats:
    """Return depth images with the same mask as a network of this configuration sees them, shape (k, r, r)."""
    return (cropped if configuration.crop else shrunk)(images, configuration.resolution)


@dataclass(frozen=True, eq=False)
class ImageBatch:
    """Pairs to train on; the images of a body are adjacent.

    Parameters
    ----------
    number
        Index in the stream.
    identifiers
        Names of the bodies.
    images
        Depth, shape (bodies * k, 1, r, r).
    targets
        Depth of each side, then the mask, shape (bodies * k, sides + 1, r, r).
    poses
        Images per body, k.
    drawn_again
        Number of redraws, by reason.
    places
        Mean canonical position of the body points in each coarse pixel, and whether it contains any of these points.
        Shape (bodies * k, 4, r / CELL, r / CELL); None if no loss uses them.
    points
        Standardised positions of points of the body, shape (bodies * k, p); None if no loss uses them.
    """

    number: int
    identifiers: tuple[str, ...]
    images: Tensor
    targets: Tensor
    poses: int
    drawn_again: Mapping[str, int]
    places: Tensor | None = None
    points: Tensor | None = None


@dataclass(frozen=True)
class MakesImages:
    """Maker of batches of images; can be sent to another process.

    Parameters
    ----------
    make
        Maker of fresh bodies.
    configuration
        Configuration of the network.
    bodies
        Bodies per batch.
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
    """Resample fresh bodies to a batch for a network, cropped if its configuration says so."""
    poses = fresh.images.shape[1]
    images = [seen_by(configuration, image[None]) for of_body in fresh.images for image in of_body]
    targets = []
    for front, back in zip(fresh.fronts, fresh.backs, strict=True):
        sides = seen_by(configuration, np.stack([front, back][: configuration.sides]))
        targets.append(np.concatenate([sides, (sides[:1] > 0).astype(np.float32)]))
    repeated = torch.from_numpy(np.stack(targets)).repeat_interleave(poses, dim=0)
    inputs = torch.from_numpy(np.stack(images))
    places = _places(fresh, configuration.resolution // CELL) if configuration.places else None
    points = None
    if configuration.points and fresh.points is not None:
        points = torch.from_numpy(fresh.points).repeat_interleave(poses, dim=0)
    return ImageBatch(number, fresh.identifiers, inputs, repeated, poses, dict(fresh.drawn_again), places, points)


def _places(fresh: Fresh, cells: int) -> Tensor | None:
    """Return the mean canonical position of the points in each coarse pixel, and whether there are any."""
    if fresh.pixels is None or fresh.places is None:
        return None
    cell_places = np.zeros((*fresh.images.shape[:2], 4, cells, cells), dtype=np.float32)
    for of_body, images, pixels, places in zip(cell_places, fresh.images, fresh.pixels, fresh.places, strict=True):
        for cell, image, pixel in zip(of_body, images, pixels, strict=True):
            starts, length = window(image)
            shown = ~np.isnan(pixel[:, 0])
            at = (cells / length * (pixel[shown] - starts)).astype(np.int64).clip(0, cells - 1)
            flat = at[:, 0] * cells + at[:, 1]
            count = np.bincount(flat, minlength=cells * cells)
            for axis in range(3):
                sums = np.bincount(flat, places[shown, axis], minlength=cells * cells)
                cell[axis] = (sums / np.maximum(count, 1)).reshape(cells, cells)
            cell[3] = (count > 0).reshape(cells, cells)
    return torch.from_numpy(cell_places.reshape(-1, 4, cells, cells))
