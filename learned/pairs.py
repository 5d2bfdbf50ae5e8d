"""Training pairs in memory."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from benchmark.api.learning import TrainingPair
from benchmark.errors import TrainingError
from learned.images import DepthScale, Floats, checked_image, resampled


@dataclass(frozen=True, eq=False)
class Pairs:
    """All pairs of a training at its resolution.

    Parameters
    ----------
    names
        Names of the inputs, one per pair.
    images
        Depth, shape (n, 1, r, r).
    targets
        Depth and mask of the distinct targets, shape (t, 2, r, r).
    target_of
        Row of ``targets`` for each pair, shape (n,).
    scale
        Map that made the depths of ``targets``.
    """

    names: tuple[str, ...]
    images: Tensor
    targets: Tensor
    target_of: Tensor
    scale: DepthScale = field(default_factory=DepthScale)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return images and targets of some pairs."""
        return self.images[rows], self.targets[self.target_of[rows]]

    def to(self, device: torch.device) -> Pairs:
        """Return a copy on a device."""
        places = {
            name: getattr(self, name).to(device) for name in ("images", "targets", "target_of")
        }
        return replace(self, **places)

    def scaled(self, scale: DepthScale) -> Pairs:
        """Return the pairs with the depths of targets mapped."""
        return replace(self, targets=scale.apply(self.targets), scale=scale)

    def digest(self) -> str:
        """Return the digest of names and pixels, 64 hexadecimal digits."""
        digest = hashlib.sha256("\0".join(self.names).encode())
        for tensor in (self.images, self.targets, self.target_of):
            digest.update(tensor.numpy().data)
        return digest.hexdigest()


def gather(
    pairs: Iterable[TrainingPair], n_pairs: int, resolution: int, crop: bool = False
) -> Pairs:
    """Load all pairs into memory, at the resolution of the network; each distinct target is kept once.

    Parameters
    ----------
    pairs
        Images and targets.
    n_pairs
        The largest number of them.
    resolution
        Pixels per side.
    crop
        Whether images and targets are cropped to the body.

    Raises
    ------
    TrainingError
        If there is no pair.
    """
    images = np.empty((n_pairs, 1, resolution, resolution), dtype=np.float32)
    names: list[str] = []
    targets: list[Floats] = []
    row: dict[str, int] = {}
    target_of: list[int] = []
    for pair in pairs:
        images[len(names)] = resampled(checked_image(pair.image), resolution, crop)[:1]
        names.append(pair.identifier)
        target_of.append(row.setdefault(pair.target_identifier, len(targets)))
        if target_of[-1] == len(targets):
            targets.append(resampled(checked_image(pair.target), resolution, crop))
    if not names:
        raise TrainingError("there is no pair to train on", "check the data set with 'data check'")
    tensors = (
        torch.from_numpy(images[: len(names)]),
        torch.from_numpy(np.stack(targets)),
        torch.tensor(target_of),
    )
    return Pairs(tuple(names), *tensors)
