"""The training loop over a stream: each step sees bodies that no other step sees, resumable, with the same result."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from torch import Tensor, nn

from benchmark.contracts import Interval
from benchmark.errors import TrainingError
from benchmark.streaming import MakesFresh
from learned import checkpoint
from learned.checkpoint import Progress
from learned.schedule import Precision
from learned.streamed.configuration import Streamed
from learned.streamed.losses import NAMES, losses, weighted
from learned.streamed.network import StreamedNetwork, build_streamed
from learned.streamed.stream import Batch, batches
from learned.training import _has_bfloat16, _keep_freed_memory, measures

CHECKPOINT_SECONDS = 60.0
"""Time between checkpoints: what a crash costs at most."""

ROW = 50
"""Steps of a row of the history; checkpoints are written between rows."""

LOOKS = 20
"""How often validation bodies are looked at during a training."""

LOOKED_AT = 32
"""Validation bodies that are looked at."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How a model is trained.

    Parameters
    ----------
    steps
        Steps of Adam, each on other bodies.
    bodies
        Bodies of each step; the stream says in how many poses.
    learning_rate
        Largest step size of Adam; it rises over the first ``warm_up`` steps and falls to zero along half a cosine.
    warm_up
        Steps of the rise.
    gradient_clip
        Largest norm of the gradient; 0 for no limit.
    precision
        Arithmetic of the network: ``"auto"`` takes bfloat16 where the hardware has it.
    """

    steps: Annotated[int, Interval(1)] = 30_000
    bodies: Annotated[int, Interval(2)] = 16
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 1e-3
    warm_up: Annotated[int, Interval(0)] = 200
    gradient_clip: Annotated[float, Interval(0)] = 1.0
    precision: Precision = "auto"

    def step_size(self, step: int) -> float:
        """Step size of Adam in a step, counted from 0."""
        rising = min(1.0, (step + 1) / (self.warm_up + 1))
        return self.learning_rate * rising * 0.5 * (1 + math.cos(math.pi * step / self.steps))


@dataclass(frozen=True)
class Trained:
    """A trained network and how it came about; the fields of :class:`learned.training.Result`, and what was drawn."""

    network: StreamedNetwork
    progress: Progress
    device: str
    precision: str


def train_streamed(
    configuration: Streamed,
    plan: Plan,
    make: MakesFresh,
    validation: MakesFresh | None,
    folder: Path,
    recipe: Mapping[str, Any],
    *,
    seed: int,
    device: torch.device,
    workers: int,
    say: Callable[[str], None],
) -> Trained:
    """Train a network, going on from the checkpoint in ``folder`` if there is one.

    A step's bodies are a matter of its number, so a training that was stopped and resumed on the same machine ends with
    the same weights as one that was not, however many processes made the bodies.

    Parameters
    ----------
    configuration, plan
        What is trained, and how.
    make
        Makes the bodies.
    validation
        Makes bodies for the curves; None for no curves.
    folder
        Where checkpoints go.
    recipe
        Everything that determines the result.
    seed
        Seed of the weights.
    device
        Where to compute.
    workers
        Processes that make bodies.
    say
        Told about progress.

    Raises
    ------
    TrainingError
        If a body cannot be made, a loss is not a number, or the checkpoint does not fit. The checkpoint then stands at
        the last step that was done.
    """
    network = build_streamed(configuration, seed).to(device, memory_format=torch.channels_last)
    optimiser = torch.optim.Adam(network.parameters(), lr=plan.learning_rate)
    found = checkpoint.resume(folder, network, optimiser, recipe)
    if found:
        say(f"going on after step {found.epoch} of {plan.steps}")
    torch.set_flush_denormal(True)
    _keep_freed_memory()
    half = plan.precision == "bfloat16" or (plan.precision == "auto" and _has_bfloat16(device))
    seen = _Validation(configuration, validation, device, half) if validation else None
    loop = _Loop(configuration, plan, network, optimiser, folder, recipe, device, half, say)
    progress = loop.run(found or Progress(0, plan.bodies, 0.0, ()), make, seen, workers)
    return Trained(network, progress, device.type, "bfloat16" if half else "float32")


@dataclass
class _Loop:
    configuration: Streamed
    plan: Plan
    network: StreamedNetwork
    optimiser: torch.optim.Optimizer
    folder: Path
    recipe: Mapping[str, Any]
    device: torch.device
    half: bool
    say: Callable[[str], None]

    def run(self, progress: Progress, make: MakesFresh, seen: _Validation | None, workers: int) -> Progress:
        steps = range(progress.epoch, self.plan.steps)
        stream = batches(make, self.configuration, self.plan.bodies, steps, workers, self.say)
        began, kept, processor = time.perf_counter() - progress.seconds, time.perf_counter(), 0.0
        terms: list[Tensor] = []
        again: Counter[str] = Counter()
        look = max(1, self.plan.steps // LOOKS)
        try:
            for batch in stream:
                before = time.process_time()
                terms.append(self._step(batch))
                processor += time.process_time() - before
                again.update(batch.drawn_again)
                step = batch.number + 1
                if step % ROW and step != self.plan.steps:
                    continue
                row = self._row(step, terms, again, processor)
                if seen and (step % look < ROW or step == self.plan.steps):
                    row |= seen.measured(self.network)
                history = (*progress.history, row)
                progress = Progress(step, self.plan.bodies, time.perf_counter() - began, history)
                terms, again, processor = [], Counter(), 0.0
                if time.perf_counter() - kept > CHECKPOINT_SECONDS or step == self.plan.steps:
                    checkpoint.keep(self.folder, self.network, self.optimiser, progress, self.recipe)
                    kept = time.perf_counter()
                    self.say(_told(progress, self.plan.steps))
        except TrainingError:
            done = progress.epoch + len(terms)
            if done and all(bool(torch.isfinite(each).all()) for each in terms):
                at = Progress(done, self.plan.bodies, time.perf_counter() - began, progress.history)
                checkpoint.keep(self.folder, self.network, self.optimiser, at, self.recipe)
            raise
        finally:
            stream.close()  # type: ignore[attr-defined]
        return progress

    def _step(self, batch: Batch) -> Tensor:
        for group in self.optimiser.param_groups:
            group["lr"] = self.plan.step_size(batch.number)
        self.network.train()
        image = batch.images.to(self.device).contiguous(memory_format=torch.channels_last)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.half):
            code = self.network.code(image)
            prediction = self.network.decoded(code)
        found = losses(prediction.float(), batch.targets.to(self.device), code, batch.poses, self.configuration)
        self.optimiser.zero_grad()
        weighted(found, self.configuration).backward()
        if self.plan.gradient_clip:
            nn.utils.clip_grad_norm_(self.network.parameters(), self.plan.gradient_clip)
        self.optimiser.step()
        # Reading a number would make the host wait for the device, so the losses stay there for a row.
        return found.detach()

    def _row(self, step: int, terms: Sequence[Tensor], again: Mapping[str, int], processor: float) -> dict[str, float]:
        values = torch.stack(list(terms)).cpu().numpy().astype(np.float64)
        wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(wrong):
            raise TrainingError(
                f"the loss is not a number in step {step - len(terms) + int(wrong[0]) + 1}",
                "lower the step size with -o learning_rate=3e-4",
            )
        told = dict(zip(NAMES, values.mean(axis=0).tolist(), strict=True))
        return {"step": float(step), **told, "processor seconds": processor, "drawn again": float(sum(again.values()))}


class _Validation:
    """Bodies of another stream, made once."""

    def __init__(self, configuration: Streamed, make: MakesFresh, device: torch.device, half: bool) -> None:
        self._batch = next(iter(batches(make, configuration, LOOKED_AT, range(1), 0, lambda _: None)))
        self._device, self._half = device, half

    @torch.no_grad()
    def measured(self, network: StreamedNetwork) -> dict[str, float]:
        network.eval()
        predictions = []
        for images in self._batch.images.split(16):
            image = images.to(self._device).contiguous(memory_format=torch.channels_last)
            with torch.autocast(self._device.type, torch.bfloat16, enabled=self._half):
                predictions.append(network(image).float().cpu())
        depth_and_mask = [0, self._batch.targets.shape[1] - 1]
        found = measures(torch.cat(predictions)[:, depth_and_mask], self._batch.targets[:, depth_and_mask])
        # Where the masks do not meet there is no depth to compare.
        return {f"validation {name}": value for name, value in found.items() if math.isfinite(value)}


def drawn_again(history: Sequence[Mapping[str, float]]) -> int:
    """How many bodies and poses were drawn again in the rows of a history."""
    return round(sum(row["drawn again"] for row in history))


def _told(progress: Progress, steps: int) -> str:
    row = progress.history[-1]
    looked = next((each for each in reversed(progress.history) if "validation mask overlap" in each), {})
    overlap = f", validation mask overlap {looked['validation mask overlap']:.3f}" if looked else ""
    left = progress.seconds / progress.epoch * (steps - progress.epoch)
    return (
        f"step {progress.epoch}/{steps}  depth {row['depth loss']:.5f}  mask {row['mask loss']:.5f}{overlap}"
        f"  {progress.seconds:.0f} s, about {left:.0f} s left"
    )
