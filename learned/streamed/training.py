"""Training of a streamed network on the canonical depth of fresh bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from benchmark.api.streaming import MakesFresh
from learned.streamed.configuration import Streamed
from learned.streamed.images import ImageBatch, MakesImages
from learned.streamed.losses import NAMES, losses, weighted
from learned.streamed.network import StreamedNetwork, build_streamed
from learned.training.loop import Objective, Plan, Trained, TrainingLoop, TrainingRun, fresh_bodies, measures

LOOKED_AT = 32
"""Number of validation bodies."""


def train_streamed(
    configuration: Streamed,
    plan: Plan,
    make: MakesFresh,
    validation: MakesFresh | None,
    run: TrainingRun,
) -> Trained[StreamedNetwork]:
    """Train a network, resuming from a checkpoint if there is one; see :class:`learned.training.loop.TrainingLoop`.

    Parameters
    ----------
    configuration, plan
        Configuration and training plan.
    make
        Maker of the bodies.
    validation
        Maker of bodies for validation curves; None for no curves.
    run
        Folder and device, and the seed of the weights.

    Raises
    ------
    TrainingError
        If a body cannot be made, a loss is not finite, or the checkpoint does not fit. A checkpoint of the last
        completed step remains, unless a loss is not finite.
    """
    network = build_streamed(configuration, run.seed).to(run.device, memory_format=torch.channels_last)
    unseen = MakesImages(validation, configuration, LOOKED_AT)(0) if validation else None
    objective = _Objective(network, configuration, run.device, unseen)
    images = MakesImages(make, configuration, plan.bodies)
    progress, precision = TrainingLoop(network, objective, images, plan, run).train()
    return Trained(network, progress, precision, fresh_bodies(plan, progress))


@dataclass
class _Objective(Objective[ImageBatch]):
    network: StreamedNetwork
    configuration: Streamed
    device: torch.device
    unseen: ImageBatch | None
    terms = NAMES
    watched = "mask overlap"

    def losses(self, batch: ImageBatch, half: bool) -> Tensor:
        return batch_losses(self.network, self.configuration, batch, self.device, half)

    def total(self, losses: Tensor, batch: ImageBatch) -> Tensor:
        return weighted(losses, self.configuration)

    def measured(self, half: bool) -> Mapping[str, float]:
        if self.unseen is None:
            return {}
        predictions = []
        for images in self.unseen.images.split(16):
            with torch.autocast(self.device.type, torch.bfloat16, enabled=half):
                predictions.append(self.network(self._image(images)).float().cpu())
        depth_and_mask = [0, self.unseen.targets.shape[1] - 1]
        return measures(torch.cat(predictions)[:, depth_and_mask], self.unseen.targets[:, depth_and_mask])

    def _image(self, images: Tensor) -> Tensor:
        return images.to(self.device).contiguous(memory_format=torch.channels_last)


def batch_losses(
    network: StreamedNetwork, configuration: Streamed, batch: ImageBatch, device: torch.device, half: bool
) -> Tensor:
    """Compute all terms of the loss of a batch; see :func:`learned.streamed.losses.losses`.

    Parameters
    ----------
    network, configuration
        The network and its configuration.
    batch
        Training batch.
    device
        Device of the network.
    half
        Whether the network may compute in bfloat16.
    """
    images = batch.images.to(device).contiguous(memory_format=torch.channels_last)
    with torch.autocast(device.type, torch.bfloat16, enabled=half):
        code, places = network.code_and_places(images)
        prediction = network.decoded(code)
        points = network.points(code) if network.points is not None else None
    both = {"places": (places, batch.places), "points": (points, batch.points)}
    beside = {
        name: (predicted.float(), true.to(device))
        for name, (predicted, true) in both.items()
        if predicted is not None and true is not None
    }
    return losses(prediction.float(), batch.targets.to(device), code, batch.poses, configuration, beside)
