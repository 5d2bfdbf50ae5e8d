"""Losses and schedule, by default those of the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar, Literal

from torch import Tensor

from benchmark.api.contracts import Interval
from benchmark.api.parameters import checked
from learned.training.loop import Plan
from learned.training.machine import Precision

DepthLoss = Literal["all", "masked"]

LOOKS = 25
"""Number of evaluations of the unseen pairs during a training."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Schedule of a training; the defaults are the paper's, section IV.

    Parameters
    ----------
    resolution
        Pixels per side.
    epochs
        Passes over the pairs.
    early_epochs
        Initial epochs with a small weight of the depth; None for the paper's share, a fifth.
    early_alpha, alpha
        Weight of the depth loss during and after the early epochs.
    beta
        Weight of the mask loss.
    learning_rate
        Step size of Adam.
    batch
        Pairs per step.
    depth_loss
        ``"all"``: mean over all pixels, as printed. ``"masked"``: mean over the pixels of the target's mask.
    gradient_clip
        Largest norm of the gradient; 0 for no limit.
    cosine
        Whether the step size falls to zero along half a cosine.
    jitter
        Largest shift of the input in pixels of the 500 x 500 image; the target is not shifted. 0 for none.
    precision
        Arithmetic of the network: ``"auto"`` takes bfloat16 if the hardware supports it.
    compile
        Whether torch compiles the network.
    """

    resolution: Annotated[int, Interval(1)] = 500
    epochs: Annotated[int, Interval(1)] = 500
    early_epochs: Annotated[int, Interval(0)] | None = None
    early_alpha: Annotated[float, Interval(0)] = 0.01
    alpha: Annotated[float, Interval(0)] = 1.0
    beta: Annotated[float, Interval(0)] = 1.0
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 1e-3
    batch: Annotated[int, Interval(1)] = 8
    depth_loss: DepthLoss = "all"
    gradient_clip: Annotated[float, Interval(0)] = 0.0
    cosine: bool = False
    jitter: Annotated[int, Interval(0)] = 0
    precision: Precision = "auto"
    compile: bool = False

    @property
    def n_early(self) -> int:
        """Number of epochs with ``early_alpha``."""
        return round(self.epochs / 5) if self.early_epochs is None else self.early_epochs

    def weight_of_depth(self, epoch: int) -> float:
        """Return alpha of an epoch, counted from 0."""
        return self.early_alpha if epoch < self.n_early else self.alpha

    def step_size(self, epoch: int) -> float:
        """Return the step size of Adam in an epoch, counted from 0."""
        if not self.cosine:
            return self.learning_rate
        return self.learning_rate * 0.5 * (1 + math.cos(math.pi * epoch / self.epochs))

    def over(self, n_pairs: int, batch: int) -> Epochs:
        """Return the plan of the steps over ``n_pairs`` pairs, in batches of ``batch``."""
        return Epochs(
            steps=self.epochs * math.ceil(n_pairs / batch), bodies=batch, gradient_clip=self.gradient_clip,
            precision=self.precision, settings=self,
        )  # fmt: skip

    def non_default_settings(self) -> list[str]:
        """Describe the fields that differ from the paper's schedule, except for arithmetic and compilation."""
        paper = Schedule()
        values = {**asdict(self), "early_epochs": self.n_early}
        printed = {**asdict(paper), "early_epochs": paper.n_early}
        return [
            f"{name} {value} (paper: {printed[name]})"
            for name, value in values.items()
            if name not in ("precision", "compile") and value != printed[name]
        ]

    def in_words(self) -> str:
        """Describe the schedule in one clause."""
        text = f"{self.resolution} x {self.resolution} pixels, {self.epochs} epochs, batch {self.batch}"
        named = {"resolution", "epochs", "batch", *(["early_epochs"] if self.early_epochs is None else [])}
        return ", ".join([text, *(part for part in self.non_default_settings() if part.split()[0] not in named)])


@dataclass(frozen=True, kw_only=True)
class Epochs(Plan):
    """Plan of the steps of a schedule, with progress counted in epochs.

    Parameters
    ----------
    settings
        The schedule.
    """

    settings: Schedule
    counted: ClassVar[str] = "epoch"

    @property
    def unit(self) -> int:
        """Steps per epoch; the last one may have fewer pairs."""
        return self.steps // self.settings.epochs

    @property
    def row(self) -> int:
        """Steps per row of the history."""
        return self.unit

    @property
    def look(self) -> int:
        """Steps between two evaluations of the unseen pairs."""
        return self.unit * max(1, self.settings.epochs // LOOKS)

    def step_size(self, step: int) -> float:
        """Return the step size of Adam in a step, counted from 0."""
        return self.settings.step_size(step // self.unit)


def schedule(defaults: Mapping[str, Any], options: Mapping[str, Any]) -> Schedule:
    """Return the schedule of a configuration with the options of the command line.

    Parameters
    ----------
    defaults
        Fields in which the configuration differs from the paper.
    options
        Values by field, as text or as numbers.

    Raises
    ------
    ConfigurationError
        If a field is unknown or a value does not fit.
    """
    return Schedule(**checked(Schedule, {**defaults, **options}, "the schedule"))


def losses(prediction: Tensor, target: Tensor, depth_loss: DepthLoss) -> tuple[Tensor, Tensor]:
    """Compute the mean squared errors of depth and mask.

    Parameters
    ----------
    prediction, target
        Depth and mask, shape (n, 2, h, w).
    depth_loss
        Pixels over which the error of the depth is averaged.

    Returns
    -------
    depth, mask : torch.Tensor
        Scalars.
    """
    squares = (prediction - target).square()
    depth, mask = squares[:, 0], squares[:, 1]
    if depth_loss == "masked":
        inside = target[:, 1]
        return (depth * inside).sum() / inside.sum().clamp(min=1), mask.mean()
    return depth.mean(), mask.mean()
