"""Training of a network on pairs of depth images, with the paper's losses and schedule (sections III-D and IV-A)."""

from __future__ import annotations

import ctypes
import math
import sys
import time
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from benchmark.api.contracts import Interval
from benchmark.errors import ConfigurationError, TrainingError
from learned.images import COVERED
from learned.pairs import AnyPairs, Pairs

CHECKPOINT = "checkpoint.pt"

CHECKPOINT_SECONDS = 60.0
"""Seconds between two checkpoints, which is what an interruption costs."""

VALIDATIONS = 25
"""Number of evaluations of the validation pairs during a training."""

Device = Literal["auto", "cpu", "cuda", "mps"]
History = list[dict[str, float]]


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Schedule of a training; the defaults are the paper's.

    Parameters
    ----------
    resolution
        Pixels per side.
    epochs
        Passes over the pairs.
    early_epochs
        First epochs with a small weight of the depth; None for the paper's share, a fifth.
    early_depth_weight
        Weight of the depth loss in these epochs, alpha; it is 1 later, as is that of the mask loss,
        beta.
    batch
        Pairs per step.
    learning_rate
        Step size of Adam.
    precision
        Arithmetic of the network: ``"auto"`` takes bfloat16 if the hardware supports it.
    stretch_depth
        Whether the depths of targets are stretched to .1 to .9; see
        :class:`learned.images.DepthScale`.
    masked_depth
        Whether the depth loss is the mean over the pixels of the target's body; otherwise, over
        all pixels.
    cosine
        Whether the step size falls to zero along half a cosine, from step to step.
    repeat
        How often each pair occurs in an epoch. With it, trainings on few and on many pairs have
        the same steps.
    """

    resolution: Annotated[int, Interval(1)] = 500
    epochs: Annotated[int, Interval(1)] = 500
    early_epochs: Annotated[int, Interval(0)] | None = None
    early_depth_weight: Annotated[float, Interval(0)] = 0.01
    batch: Annotated[int, Interval(1)] = 8
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 1e-3
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    stretch_depth: bool = False
    masked_depth: bool = False
    cosine: bool = False
    repeat: Annotated[int, Interval(1)] = 1

    def step_size(self, step: int, steps: int) -> float:
        """Return the step size of Adam in a step, counted from 0, of a training of so many steps."""
        if not self.cosine:
            return self.learning_rate
        return self.learning_rate * (1 + math.cos(math.pi * step / steps)) / 2

    def depth_weight(self, epoch: int) -> float:
        """Return the weight of the depth loss in an epoch, counted from 0."""
        early = round(self.epochs / 5) if self.early_epochs is None else self.early_epochs
        return self.early_depth_weight if epoch < early else 1.0

    def in_words(self) -> str:
        """Describe the schedule in one clause, with what differs from the paper's."""
        text = f"{self.resolution} x {self.resolution} pixels, {self.epochs} epochs"
        paper = Schedule(resolution=self.resolution, epochs=self.epochs, precision=self.precision)
        changed = (
            f"{name} {value}"
            for name, value in asdict(self).items()
            if value != getattr(paper, name)
        )
        return ", ".join([text, *changed])


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Name what differs between two trainings, with values that are short; an absent option is False."""
    names = sorted(
        name for name in {*before, *now} if before.get(name, False) != now.get(name, False)
    )
    values = {name: f" ({before.get(name)}, not {now.get(name)})" for name in names}
    return ", ".join(name + values[name] * (len(values[name]) < 40) for name in names)


def losses(prediction: Tensor, target: Tensor, masked_depth: bool = False) -> tuple[Tensor, Tensor]:
    """Return the mean squared errors of depth and mask, both of shape (n, 2, h, w).

    The error of the depth is a mean over all pixels, or over those of the target's mask.
    """
    depth, mask = (prediction - target).square().unbind(1)
    if masked_depth:
        body = target[:, 1]
        return (depth * body).sum() / body.sum().clamp(min=1), mask.mean()
    return depth.mean(), mask.mean()


def measures(predictions: Tensor, targets: Tensor, factor: float = 1.0) -> dict[str, float]:
    """Return mean mask overlap (intersection over union), and mean depth error inside both masks, if any.

    Depths, stretched by a factor, and masks have shape (n, 2, r, r); the error is a share of the
    frame's depth.
    """
    predicted, true = predictions[:, 1] > COVERED, targets[:, 1] > COVERED
    both = predicted & true
    shares = both.sum(dim=(1, 2)) / (predicted | true).sum(dim=(1, 2)).clamp(min=1)
    found = {"mask overlap": float(shares.mean())}
    if both.any():
        found["depth error"] = (
            float((predictions[:, 0] - targets[:, 0]).abs()[both].mean()) / factor
        )
    return found


def device_named(name: Device) -> torch.device:
    """Return the device of this name; ``"auto"`` takes a GPU if there is one.

    Raises
    ------
    ConfigurationError
        If the device is not available.
    """
    present = {
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
        "cpu": True,
    }
    if name == "auto":
        name = next(kind for kind in ("cuda", "mps", "cpu") if present[kind])
    if not present[name]:
        raise ConfigurationError(
            f"this torch has no device '{name}' here", "pass -o device=cpu or -o device=auto"
        )
    return torch.device(name)


def resolved(schedule: Schedule, device: torch.device) -> Schedule:
    """Return the schedule with the arithmetic that ``"auto"`` means on a device."""
    if schedule.precision != "auto":
        return schedule
    # Emulation in software would be slower than float32.
    if device.type == "cuda":
        half = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        half = device.type == "cpu" and bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())
    return replace(schedule, precision="bfloat16" if half else "float32")


class Fitted(NamedTuple):
    """What remains of a training beside the weights.

    Attributes
    ----------
    history
        Losses of each epoch.
    core_seconds
        Processor time of all its runs, without what an interruption lost.
    """

    history: History
    core_seconds: float


def fit(
    network: nn.Module,
    pairs: AnyPairs,
    validation: Pairs | None,
    schedule: Schedule,
    folder: Path,
    *,
    seed: int,
    device: torch.device,
    log: Callable[[str], None],
) -> Fitted:
    """Train a network in place; on the same machine, an interrupted training ends with the same weights.

    Parameters
    ----------
    network
        Network with its initial weights.
    pairs, validation
        Training pairs, and others for curves.
    schedule
        Schedule, with its precision resolved.
    folder
        Folder of the checkpoint.
    seed
        Seed of the order of the pairs.
    device
        Device to compute on.
    log
        Called with a line of progress every 20 seconds.

    Returns
    -------
    Fitted
        Losses of each epoch, and the time that the training took.

    Raises
    ------
    TrainingError
        If a loss is not a number, or the checkpoint belongs to another training.
    """
    _keep_freed_memory()
    torch.set_flush_denormal(True)
    network.to(device, memory_format=torch.channels_last)
    state = _State(
        network,
        torch.optim.Adam(network.parameters(), lr=schedule.learning_rate),
        folder / CHECKPOINT,
    )
    release = torch.__version__.partition("+")[0]  # a training may go on with another build
    state.resume(asdict(schedule) | {"data": pairs.digest(), "seed": seed, "torch": release})
    steps = math.ceil(len(pairs) * schedule.repeat / schedule.batch)
    begun = state.epoch + state.step / steps
    if begun:
        log(f"going on after epoch {round(begun, 2):g} of {schedule.epochs}")
    pairs, validation = pairs.to(device), validation.to(device) if validation else None
    progress = _Progress(schedule.epochs, begun, log)
    for epoch in range(state.epoch, schedule.epochs):
        _train_epoch(state, pairs, schedule, seed, epoch, progress)
        row = state.finished_epoch(len(pairs) * schedule.repeat)
        if validation and (
            (epoch + 1) % max(1, schedule.epochs // VALIDATIONS) == 0
            or epoch + 1 == schedule.epochs
        ):
            row |= {
                f"validation {name}": value
                for name, value in _evaluated(network, validation, schedule).items()
            }
        is_last = epoch + 1 == schedule.epochs
        state.save_if_due(at_once=is_last)
        progress.show(epoch + 1, row, at_once=is_last or epoch == int(begun))
    return Fitted(state.history, state.seconds)


def _train_epoch(
    state: _State,
    pairs: AnyPairs,
    schedule: Schedule,
    seed: int,
    epoch: int,
    progress: _Progress,
) -> None:
    network, optimizer = state.network.train(), state.optimizer
    device = next(network.parameters()).device
    drawn = np.random.default_rng([seed, epoch]).permutation(len(pairs) * schedule.repeat)
    batches = torch.from_numpy(drawn % len(pairs)).split(schedule.batch)
    for rows in batches[state.step :]:
        image, target = pairs[rows.to(device)]
        prediction = _predicted(network, image, schedule)
        depth, mask = losses(prediction, target, schedule.masked_depth)
        step = epoch * len(batches) + state.step
        for group in optimizer.param_groups:
            group["lr"] = schedule.step_size(step, schedule.epochs * len(batches))
        optimizer.zero_grad()
        (schedule.depth_weight(epoch) * depth + mask).backward()
        optimizer.step()
        # Reading a number would make the host wait for the device, so the sums stay there.
        state.sums = state.sums.to(device) + len(rows) * torch.stack([depth, mask]).detach()
        state.step += 1
        state.save_if_due()
        progress.show(epoch + state.step / len(batches))


def _predicted(network: nn.Module, image: Tensor, schedule: Schedule) -> Tensor:
    with torch.autocast(
        image.device.type, torch.bfloat16, enabled=schedule.precision == "bfloat16"
    ):
        prediction: Tensor = network(image.contiguous(memory_format=torch.channels_last))
    return prediction.float()


@torch.no_grad()
def _evaluated(network: nn.Module, pairs: Pairs, schedule: Schedule) -> dict[str, float]:
    network.eval()
    predictions = torch.cat(
        [_predicted(network, images, schedule) for images in pairs.images.split(8)]
    )
    return measures(predictions, pairs.targets[pairs.target_of], pairs.scale.factor)


class _State:
    """Network, optimizer and progress of a training, and their checkpoint.

    Parameters
    ----------
    network, optimizer
        The network, and the optimizer that trains it.
    path
        File of the checkpoint.
    """

    def __init__(self, network: nn.Module, optimizer: torch.optim.Optimizer, path: Path) -> None:
        self.network, self.optimizer, self.path = network, optimizer, path
        self.recipe: Mapping[str, Any] = {}
        self.epoch = self.step = 0
        self.sums = torch.zeros(2)
        self.saved = time.perf_counter()
        self.history: History = []
        self.seconds = 0.0
        self.began = time.process_time()

    def resume(self, recipe: Mapping[str, Any]) -> None:
        """Restore what the checkpoint holds, if there is one; refuse that of another training."""
        self.recipe = recipe
        if not self.path.is_file():
            return
        try:
            with zipfile.ZipFile(self.path) as archive:  # torch does not compare its checksums
                if damaged := archive.testzip():
                    raise ValueError(damaged)
            state = torch.load(self.path, map_location="cpu", weights_only=True)
            if changed := differences({**asdict(Schedule()), **state["recipe"]}, recipe):
                problem = f"{self.path} was made with another {changed}"
                raise TrainingError(
                    problem, "train with the same options, or delete the folder to begin anew"
                )
            self.network.load_state_dict(state["network"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.epoch, self.step = state["epoch"], state["step"]
            self.sums, self.history = state["sums"], state["history"]
            self.seconds = state.get("seconds", 0.0)
        except TrainingError:
            raise
        except Exception as error:  # torch raises errors of many types for a damaged file
            raise TrainingError(
                f"checkpoint {self.path} is damaged", "delete it and train again"
            ) from error

    def finished_epoch(self, n_pairs: int) -> dict[str, float]:
        """Add a row to the history, and return it."""
        depth, mask = (self.sums / n_pairs).tolist()
        self._check_sums()
        self.epoch, self.step, self.sums = self.epoch + 1, 0, torch.zeros(2)
        self.history.append({"epoch": self.epoch, "depth loss": depth, "mask loss": mask})
        return self.history[-1]

    def save_if_due(self, at_once: bool = False) -> None:
        """Write the checkpoint if a minute has passed since the last one."""
        now = time.perf_counter()
        if now - self.saved < CHECKPOINT_SECONDS and not at_once:
            return
        self._check_sums()
        self.saved = now
        self.seconds += time.process_time() - self.began
        self.began = time.process_time()
        state = {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict()}
        state |= {
            name: getattr(self, name)
            for name in ("recipe", "epoch", "step", "sums", "history", "seconds")
        }
        partial = self.path.with_suffix(".tmp")
        try:
            torch.save(state, partial)
            partial.replace(self.path)
        except (OSError, RuntimeError) as error:
            raise TrainingError(
                f"cannot write {self.path}: {error}", "free some space and train again"
            ) from error

    def _check_sums(self) -> None:
        if not torch.isfinite(self.sums).all():
            problem = f"the loss of epoch {self.epoch + 1} is not a number"
            raise TrainingError(problem, "lower the step size: -o learning_rate=3e-4")


class _Progress:
    """A line of progress with the time left, at most every 20 seconds and after the first and the last epoch."""

    def __init__(self, epochs: int, first: float, log: Callable[[str], None]) -> None:
        self.epochs, self.first, self.log = epochs, first, log
        self.began = self.shown = time.perf_counter()

    def show(self, epochs: float, row: Mapping[str, float] = {}, at_once: bool = False) -> None:
        """Show how many epochs are done, a part of the present one included, and the losses of the last."""
        now = time.perf_counter()
        if now - self.shown < 20 and not at_once:
            return
        self.shown = now
        left = (now - self.began) / (epochs - self.first) * (self.epochs - epochs)
        losses = [f"{name} {value:.5f}" for name, value in row.items() if name != "epoch"]
        bar = "#" * round(20 * epochs / self.epochs)
        place = f"epoch {round(epochs, 2):g}/{self.epochs}"
        self.log("  ".join([f"[{bar:20}] {place}", *losses, f"{left:.0f} s left"]))


def _keep_freed_memory() -> None:
    """Make the C library of Linux keep the memory of freed tensors, which saves up to a quarter of the time."""
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        for parameter, value in (
            (-4, 0),
            (-1, -1),
        ):  # M_MMAP_MAX and M_TRIM_THRESHOLD, see mallopt(3)
            library.mallopt(parameter, value)
