"""Training pairs in memory."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmark.api.learning import TrainingPair
from benchmark.errors import TrainingError
from benchmark.geometry.depth import DepthImage
from learned.images import Floats, checked_image, cropped, shrink


@dataclass(frozen=True, eq=False)
class Pairs:
    """All pairs of a training at its resolution.

    Parameters
    ----------
    identifiers
        Names of the inputs, one per pair.
    images
        Depth, shape (n, 1, r, r).
    targets
        Depth and mask of the distinct targets, shape (t, 2, r, r).
    target_of
        Row of ``targets`` for each pair, shape (n,).
    """

    identifiers: tuple[str, ...]
    images: Tensor
    targets: Tensor
    target_of: Tensor

    def __len__(self) -> int:
        return len(self.identifiers)

    def to(self, device: torch.device) -> Pairs:
        """Return a copy on a device."""
        moved = (tensor.to(device) for tensor in (self.images, self.targets, self.target_of))
        return Pairs(self.identifiers, *moved)


def seen_by(image: DepthImage, resolution: int, crop: bool) -> Floats:
    """Return depth and mask as a network sees them, shape (2, resolution, resolution), cropped if ``crop`` is set."""
    if not crop:
        return shrink(checked_image(image), resolution)
    depth = cropped(checked_image(image)[None], resolution)[0]
    return np.stack([depth, (depth > 0).astype(np.float32)])


def gather(pairs: Iterable[TrainingPair], resolution: int, crop: bool = False) -> Pairs:
    """Load all pairs into memory, downsampled; each distinct target is kept once.

    Parameters
    ----------
    pairs
        Images and targets.
    resolution
        Pixels per side.
    crop
        Whether images and targets are cropped to the body.

    Raises
    ------
    TrainingError
        If there is no pair.
    """
    identifiers: list[str] = []
    images: list[Floats] = []
    targets: list[Floats] = []
    row: dict[str, int] = {}
    target_of: list[int] = []
    for pair in pairs:
        identifiers.append(pair.identifier)
        images.append(seen_by(pair.image, resolution, crop)[:1])
        if pair.target_identifier not in row:
            row[pair.target_identifier] = len(targets)
            targets.append(seen_by(pair.target, resolution, crop))
        target_of.append(row[pair.target_identifier])
    if not identifiers:
        raise TrainingError("there is no pair to train on", "check the data set with `benchmark data check`")
    return Pairs(
        tuple(identifiers),
        torch.from_numpy(np.stack(images)),
        torch.from_numpy(np.stack(targets)),
        torch.tensor(target_of),
    )


def joined(parts: Sequence[Pairs]) -> Pairs:
    """Concatenate parts in their order; a target that two parts share is kept in both."""
    before = itertools.accumulate((len(part.targets) for part in parts[:-1]), initial=0)
    return Pairs(
        tuple(identifier for part in parts for identifier in part.identifiers),
        torch.cat([part.images for part in parts]),
        torch.cat([part.targets for part in parts]),
        torch.cat([part.target_of + first for part, first in zip(parts, before, strict=True)]),
    )
