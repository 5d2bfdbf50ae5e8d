"""The training loop: epochs of Adam over pairs in memory, resumable, the same result however often it was stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from benchmark.errors import ConfigurationError, TrainingError
from benchmark.geometry.depth import SIZE
from learned.paired.configuration import Configuration
from learned.paired.network import RESOLUTIONS, build
from learned.paired.pairs import Pairs
from learned.paired.schedule import Schedule, losses, step_size
from learned.training import checkpoint
from learned.training.arithmetic import has_bfloat16, keep_freed_memory
from learned.training.checkpoint import Progress
from learned.training.measures import measures

CHECKPOINT_SECONDS = 60.0
"""Time between checkpoints: what a crash costs at most, besides the epoch that runs."""

LOOKS = 25
"""How often the unseen pairs are looked at during a training."""


@dataclass(frozen=True)
class Result:
    """A trained network and how it came about."""

    network: nn.Module
    progress: Progress
    device: str
    precision: str


def check_resolution(configuration: Configuration, resolution: int) -> None:
    """Raise ``ConfigurationError`` if the network cannot have this resolution."""
    allowed = RESOLUTIONS[configuration.architecture]
    if resolution not in allowed:
        fits = f"{allowed[0]} to {allowed[-1]}" if len(allowed) > 1 else f"{allowed[0]}"
        raise ConfigurationError(
            f"network '{configuration.name}' has no resolution {resolution}", f"pass --resolution {fits}"
        )


def train(
    configuration: Configuration,
    plan: Schedule,
    pairs: Pairs,
    unseen: Pairs | None,
    folder: Path,
    recipe: Mapping[str, Any],
    *,
    seed: int,
    device: torch.device,
    say: Callable[[str], None],
) -> Result:
    """Train a network, going on from the checkpoint in ``folder`` if there is one.

    The order of the pairs depends on the seed and the epoch alone, so a training that was stopped and resumed on the
    same machine ends with the same weights as one that was not.

    Parameters
    ----------
    configuration, plan
        What is trained, and how.
    pairs
        The training pairs.
    unseen
        Pairs for curves only.
    folder
        Where checkpoints go.
    recipe
        Everything that determines the result.
    seed
        Seed of the weights and the order.
    device
        Where to compute.
    say
        Told about progress.

    Raises
    ------
    ConfigurationError
        If the network cannot have this resolution.
    TrainingError
        If a loss is not a number, memory does not suffice for half the batch, or the checkpoint does not fit.
    """
    check_resolution(configuration, plan.resolution)
    loop = _Loop(
        configuration, plan, pairs.to(device), unseen.to(device) if unseen else None, folder, recipe, seed, device, say
    )
    torch.set_flush_denormal(True)
    keep_freed_memory()
    try:
        return loop.run()
    except _OutOfMemory:
        loop.halve_batch()
        say(f"out of memory; going on with batches of {loop.batch}")
    try:
        return loop.run()
    except _OutOfMemory as error:
        raise TrainingError(
            f"memory does not suffice for batches of {loop.batch}", "lower --resolution or --batch"
        ) from error


class _OutOfMemory(Exception):
    """An allocation failed."""


@dataclass
class _Loop:
    """One training; the fields are the parameters of :func:`train`, with the pairs on the device."""

    configuration: Configuration
    plan: Schedule
    pairs: Pairs
    unseen: Pairs | None
    folder: Path
    recipe: Mapping[str, Any]
    seed: int
    device: torch.device
    say: Callable[[str], None]

    def __post_init__(self) -> None:
        self.batch = self.plan.batch
        self.halved = False
        self.half_precision = self.plan.precision == "bfloat16" or (
            self.plan.precision == "auto" and has_bfloat16(self.device)
        )

    def halve_batch(self) -> None:
        if self.batch < 2:
            raise TrainingError("memory does not suffice for one pair", "lower --resolution")
        self.batch //= 2
        self.halved = True

    def run(self) -> Result:
        network = build(self.configuration, self.seed).to(self.device, memory_format=torch.channels_last)
        optimiser = torch.optim.Adam(network.parameters(), lr=self.plan.learning_rate)
        found = checkpoint.resume(self.folder, network, optimiser, self.recipe, __name__)
        progress = found or Progress(0, self.batch, 0.0, ())
        if self.halved:
            progress = replace(progress, batch=self.batch)
        self.batch = progress.batch
        if found:
            self.say(f"going on after epoch {progress.epoch} of {self.plan.epochs}")
        # Compiled or not, the same parameters are trained.
        forward = torch.compile(network) if self.plan.compile else network
        began, kept = time.perf_counter() - progress.seconds, time.perf_counter()
        history = list(progress.history)
        for epoch in range(progress.epoch, self.plan.epochs):
            row = self._epoch(epoch, forward, optimiser)
            if self.unseen is not None and _is_look(epoch, self.plan.epochs):
                row |= {f"unseen {name}": value for name, value in self.measure(forward, self.unseen).items()}
            history.append(row)
            progress = Progress(epoch + 1, self.batch, time.perf_counter() - began, tuple(history))
            if time.perf_counter() - kept > CHECKPOINT_SECONDS or epoch + 1 == self.plan.epochs:
                checkpoint.keep(self.folder, network, optimiser, progress, self.recipe, __name__)
                kept = time.perf_counter()
                self.say(_told(row, progress, self.plan.epochs))
        return Result(network, progress, self.device.type, "bfloat16" if self.half_precision else "float32")

    def _epoch(self, epoch: int, forward: nn.Module, optimiser: torch.optim.Optimizer) -> dict[str, float]:
        for group in optimiser.param_groups:
            group["lr"] = step_size(self.plan, epoch)
        alpha, beta = self.plan.weight_of_depth(epoch), self.plan.beta
        forward.train()
        told: list[Tensor] = []
        batches = list(self._batches(epoch))
        try:
            for rows in batches:
                image, target = self._load(rows, epoch)
                with torch.autocast(self.device.type, torch.bfloat16, enabled=self.half_precision):
                    prediction = forward(image)
                depth, mask = losses(prediction.float(), target, self.plan.depth_loss)
                optimiser.zero_grad()
                (alpha * depth + beta * mask).backward()
                if self.plan.gradient_clip:
                    nn.utils.clip_grad_norm_(forward.parameters(), self.plan.gradient_clip)
                optimiser.step()
                # Reading a number would make the host wait for the device, so the losses stay there for the epoch.
                told.append(torch.stack([depth, mask]).detach())
        except (torch.OutOfMemoryError, MemoryError) as error:
            raise _OutOfMemory from error
        except RuntimeError as error:
            if "allocate memory" in str(error) or "out of memory" in str(error):
                raise _OutOfMemory from error
            raise
        values = torch.stack(told).cpu().numpy().astype(np.float64)
        self._check(values, epoch, batches)
        # The last batch may be smaller; every pair counts the same.
        depth, mask = np.average(values, axis=0, weights=[len(rows) for rows in batches])
        return {
            "epoch": float(epoch + 1),
            "alpha": alpha,
            "depth loss": float(depth),
            "mask loss": float(mask),
            "loss": float(alpha * depth + beta * mask),
        }

    def _batches(self, epoch: int) -> Iterator[np.ndarray[Any, np.dtype[np.int64]]]:
        order = np.random.default_rng([self.seed, epoch]).permutation(len(self.pairs))
        for start in range(0, len(order), self.batch):
            yield order[start : start + self.batch]

    def _load(self, rows: np.ndarray[Any, np.dtype[np.int64]], epoch: int) -> tuple[Tensor, Tensor]:
        chosen = torch.from_numpy(rows).to(self.device)
        image = self.pairs.images[chosen]
        if self.plan.jitter:
            image = _shifted(image, self.plan.jitter, np.random.default_rng([self.seed, epoch, *rows[:2].tolist()]))
        return image.contiguous(memory_format=torch.channels_last), self.pairs.targets[self.pairs.target_of[chosen]]

    def _check(self, values: np.ndarray[Any, Any], epoch: int, batches: list[np.ndarray[Any, Any]]) -> None:
        wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(wrong):
            names = ", ".join(self.pairs.identifiers[row] for row in batches[wrong[0]])
            raise TrainingError(
                f"the loss is not a number in epoch {epoch + 1}, batch {wrong[0] + 1} ({names})",
                "look at these images, or lower the step size with -o learning_rate=3e-4",
            )

    @torch.no_grad()
    def measure(self, forward: nn.Module, pairs: Pairs) -> dict[str, float]:
        """Overlap of masks and error of depths on pairs that are not trained on."""
        forward.eval()
        predictions = []
        for start in range(0, len(pairs), 8):
            image = pairs.images[start : start + 8].contiguous(memory_format=torch.channels_last)
            with torch.autocast(self.device.type, torch.bfloat16, enabled=self.half_precision):
                predictions.append(forward(image).float())
        return measures(torch.cat(predictions), pairs.targets[pairs.target_of])


def _shifted(images: Tensor, largest: int, generator: np.random.Generator) -> Tensor:
    """Images shifted by whole pixels, the same for all of a batch; what leaves the frame is lost."""
    limit = round(largest * images.shape[-1] / SIZE)
    down, right = (int(shift) for shift in generator.integers(-limit, limit + 1, size=2))
    height, width = images.shape[-2:]
    result = torch.zeros_like(images)
    result[..., max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)] = images[
        ..., max(-down, 0) : height + min(-down, 0), max(-right, 0) : width + min(-right, 0)
    ]
    return result


def _is_look(epoch: int, epochs: int) -> bool:
    return (epoch + 1) % max(1, epochs // LOOKS) == 0 or epoch + 1 == epochs


def _told(row: Mapping[str, float], progress: Progress, epochs: int) -> str:
    left = progress.seconds / progress.epoch * (epochs - progress.epoch)
    looked = f", unseen mask overlap {row['unseen mask overlap']:.3f}" if "unseen mask overlap" in row else ""
    return (
        f"epoch {progress.epoch}/{epochs}  depth {row['depth loss']:.5f}  mask {row['mask loss']:.5f}{looked}"
        f"  {progress.seconds:.0f} s, about {left:.0f} s left"
    )


__all__ = ["Result", "check_resolution", "train"]
