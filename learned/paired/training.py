"""Training on a fixed set of pairs in memory, each used once per epoch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from benchmark.errors import ConfigurationError, TrainingError
from benchmark.geometry.depth import SIZE
from learned.paired.configuration import Configuration
from learned.paired.network import RESOLUTIONS, build
from learned.paired.pairs import Pairs
from learned.paired.schedule import Epochs, Schedule, losses
from learned.training.checkpoint import stands_at
from learned.training.loop import Objective, Trained, TrainingLoop, TrainingRun, measures
from learned.training.machine import is_out_of_memory


def check_resolution(configuration: Configuration, resolution: int) -> None:
    """Raise ``ConfigurationError`` if the network does not support this resolution."""
    allowed = RESOLUTIONS[configuration.architecture]
    if resolution not in allowed:
        fits = f"{allowed[0]} to {allowed[-1]}" if len(allowed) > 1 else f"{allowed[0]}"
        raise ConfigurationError(
            f"network '{configuration.name}' has no resolution {resolution}", f"pass --resolution {fits}"
        )


def train(
    configuration: Configuration, schedule: Schedule, pairs: Pairs, unseen: Pairs | None, run: TrainingRun
) -> Trained[nn.Module]:
    """Train a network, resuming from a checkpoint if there is one; see :class:`learned.training.loop.TrainingLoop`.

    If memory does not suffice, training resumes from the last checkpoint with batches of half the size.

    Parameters
    ----------
    configuration, schedule
        Configuration and training schedule.
    pairs
        The training pairs.
    unseen
        Held-out pairs, for curves only.
    run
        Folder and device, and the seed of the weights and of the order of the pairs.

    Raises
    ------
    ConfigurationError
        If the network does not support this resolution.
    TrainingError
        If a loss is not finite, memory does not suffice for half the batch, or the checkpoint does not fit.
    """
    check_resolution(configuration, schedule.resolution)
    pairs, unseen = pairs.to(run.device), unseen.to(run.device) if unseen else None

    def attempt(batch: int) -> Trained[nn.Module] | None:
        """Train with batches of this size; return None if memory does not suffice."""
        network = build(configuration, run.seed).to(run.device, memory_format=torch.channels_last)
        plan = schedule.over(len(pairs), batch)
        # The compiled network shares the parameters of the original.
        forward = torch.compile(network) if schedule.compile else network
        objective = _Objective(forward, schedule, plan, pairs, unseen, run.seed)
        try:
            progress, precision = TrainingLoop(network, objective, objective.batch, plan, run).train()
        except (MemoryError, RuntimeError) as error:
            if not is_out_of_memory(error):
                raise
            return None
        return Trained(network, progress, precision, {"pairs": len(pairs)})

    batch = stands_at(run.folder)[1] or schedule.batch
    if trained := attempt(batch):
        return trained
    if batch < 2:
        raise TrainingError("memory does not suffice for one pair", "lower --resolution")
    run.say(f"out of memory; going on with batches of {batch // 2}")
    if trained := attempt(batch // 2):
        return trained
    raise TrainingError(f"memory does not suffice for batches of {batch // 2}", "lower --resolution or --batch")


@dataclass(frozen=True)
class PairBatch:
    """Rows of the pairs of a step, and its epoch, counted from 0."""

    number: int
    epoch: int
    rows: NDArray[np.int64]
    drawn_again: Mapping[str, int] = field(default_factory=dict)


@dataclass
class _Objective(Objective[PairBatch]):
    forward: nn.Module
    schedule: Schedule
    plan: Epochs
    pairs: Pairs
    unseen: Pairs | None
    seed: int
    terms = ("depth loss", "mask loss")
    watched = "mask overlap"
    held_out = "unseen"

    def batch(self, number: int) -> PairBatch:
        """Return the batch of a number; the order of the pairs depends only on the seed and the epoch."""
        epoch, place = divmod(number, self.plan.unit)
        order = np.random.default_rng([self.seed, epoch]).permutation(len(self.pairs))
        return PairBatch(number, epoch, order[place * self.plan.bodies : (place + 1) * self.plan.bodies])

    def losses(self, batch: PairBatch, half: bool) -> Tensor:
        chosen = torch.from_numpy(batch.rows).to(self.pairs.images.device)
        image, target = self.pairs.images[chosen], self.pairs.targets[self.pairs.target_of[chosen]]
        if self.schedule.jitter:
            random = np.random.default_rng([self.seed, batch.epoch, *batch.rows[:2].tolist()])
            image = _shifted(image, self.schedule.jitter, random)
        return torch.stack(losses(self._predicted(image, half), target, self.schedule.depth_loss))

    def total(self, losses: Tensor, batch: PairBatch) -> Tensor:
        depth, mask = losses
        return self.schedule.weight_of_depth(batch.epoch) * depth + self.schedule.beta * mask

    def measured(self, half: bool) -> Mapping[str, float]:
        if self.unseen is None:
            return {}
        predictions = [self._predicted(images, half) for images in self.unseen.images.split(8)]
        return measures(torch.cat(predictions), self.unseen.targets[self.unseen.target_of])

    def row(self, step: int, losses: NDArray[np.float64], costs: Mapping[str, float]) -> dict[str, float]:
        epoch = step // self.plan.unit
        alpha = self.schedule.weight_of_depth(epoch - 1)
        # The last batch may be smaller; every pair counts the same.
        sizes = [len(self.batch(number).rows) for number in range(step - len(losses), step)]
        depth, mask = np.average(losses, axis=0, weights=sizes).tolist()
        loss = alpha * depth + self.schedule.beta * mask
        return {"epoch": float(epoch), "alpha": alpha, "depth loss": depth, "mask loss": mask, "loss": loss}

    def place(self, step: int) -> str:
        batch = self.batch(step - 1)
        names = ", ".join(self.pairs.identifiers[row] for row in batch.rows)
        return f"epoch {batch.epoch + 1}, batch {(step - 1) % self.plan.unit + 1} ({names})"

    def _predicted(self, images: Tensor, half: bool) -> Tensor:
        with torch.autocast(images.device.type, torch.bfloat16, enabled=half):
            prediction: Tensor = self.forward(images.contiguous(memory_format=torch.channels_last))
        return prediction.float()


def _shifted(images: Tensor, largest: int, random: np.random.Generator) -> Tensor:
    """Shift all images of a batch by the same random number of whole pixels, cropped to the frame."""
    limit = round(largest * images.shape[-1] / SIZE)
    down, right = (int(shift) for shift in random.integers(-limit, limit + 1, size=2))
    height, width = images.shape[-2:]
    result = torch.zeros_like(images)
    result[..., max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)] = images[
        ..., max(-down, 0) : height + min(-down, 0), max(-right, 0) : width + min(-right, 0)
    ]
    return result
