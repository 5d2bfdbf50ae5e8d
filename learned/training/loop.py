"""Training loop of all networks, with Adam; an interrupted training resumes with the same result."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from benchmark.api.contracts import Interval
from benchmark.errors import ConfigurationError, TrainingError
from learned.images import COVERED
from learned.training import checkpoint
from learned.training.checkpoint import SNAPSHOTS, Average, Checkpoint, Progress
from learned.training.machine import Precision, has_bfloat16, keep_freed_memory
from learned.training.stream import Batch, batches


def overlaps(predictions: Tensor, targets: Tensor) -> Tensor:
    """Return the intersection over union of masks, shape (n,), from depths and masks, shape (n, 2, r, r)."""
    predicted, true = predictions[:, 1] > COVERED, targets[:, 1] > COVERED
    return (predicted & true).sum(dim=(1, 2)) / (predicted | true).sum(dim=(1, 2)).clamp(min=1)


def measures(predictions: Tensor, targets: Tensor) -> dict[str, float]:
    """Compute the overlap of masks, and the depth error inside both masks.

    Parameters
    ----------
    predictions, targets
        Depth and mask, shape (n, 2, r, r).

    Returns
    -------
    dict
        ``"mask overlap"``: intersection over union, mean over the images. ``"depth error"``: mean absolute error inside
        both masks, as a share of the depth of the frame.
    """
    both = (predictions[:, 1] > COVERED) & (targets[:, 1] > COVERED)
    error = (predictions[:, 0] - targets[:, 0]).abs()[both]
    overlap = float(overlaps(predictions, targets).mean())
    return {"mask overlap": overlap, "depth error": float(error.mean()) if len(error) else float("nan")}


CHECKPOINT_SECONDS = 60.0
"""Seconds between checkpoints; a crash costs at most this time and the steps of a row."""

ROW = 50
"""Steps per row of the history; checkpoints are written between rows."""

LOOKS = 20
"""Number of validations during a training of known length."""

LOOK_STEPS = 2000
"""Steps between two validations of a training of unknown length."""

FIRST_SNAPSHOT = 1000
"""Bodies after which a training of unknown length saves its weights, and again after each doubling."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of a training.

    Parameters
    ----------
    steps
        Steps of Adam, each on other bodies.
    bodies
        Bodies per step; the stream determines the number of poses.
    learning_rate
        Largest step size of Adam; it rises over the first ``warm_up`` steps.
    warm_up
        Steps over which the step size rises.
    schedule
        ``"cosine"``: the step size falls to zero along half a cosine. ``"constant"``: it stays constant, so that a
        running training can be given more ``steps`` or a ``falling`` end.
    falling
        Last steps of a constant schedule, over which the step size falls linearly to zero.
    average
        Decay of the exponential moving average of the weights; 0 for no average. The finished model has the averaged
        weights.
    gradient_clip
        Largest norm of the gradient; 0 for no limit.
    precision
        Arithmetic of the network: ``"auto"`` takes bfloat16 if the hardware supports it.
    """

    steps: Annotated[int, Interval(1)] = 30_000
    bodies: Annotated[int, Interval(2)] = 16
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 1e-3
    warm_up: Annotated[int, Interval(0)] = 200
    schedule: Literal["cosine", "constant"] = "cosine"
    falling: Annotated[int, Interval(0)] = 0
    average: Annotated[float, Interval(0, 1, closed="left")] = 0.0
    gradient_clip: Annotated[float, Interval(0)] = 1.0
    precision: Precision = "auto"

    counted: ClassVar[str] = "step"
    """Unit in which progress is counted."""

    def __post_init__(self) -> None:
        """Raise ``ConfigurationError`` if ``falling`` exceeds ``steps``, or 0 with a cosine schedule."""
        if self.falling > (self.steps if self.schedule == "constant" else 0):
            raise ConfigurationError(
                f"the step size cannot fall for {self.falling} of {self.steps} steps of schedule '{self.schedule}'",
                "pass -o schedule=constant, and fewer falling steps than steps",
            )

    @property
    def unit(self) -> int:
        """Steps per unit of progress."""
        return 1

    @property
    def row(self) -> int:
        """Steps per row of the history."""
        return ROW

    @property
    def look(self) -> int:
        """Steps between two validations."""
        return LOOK_STEPS if self.schedule == "constant" else max(1, self.steps // LOOKS)

    def step_size(self, step: int) -> float:
        """Return the step size of Adam in a step, counted from 0."""
        rising = min(1.0, (step + 1) / (self.warm_up + 1))
        if self.schedule == "constant":
            return self.learning_rate * rising * min(1.0, (self.steps - step) / (self.falling + 1))
        return self.learning_rate * rising * 0.5 * (1 + math.cos(math.pi * step / self.steps))


N = TypeVar("N", bound=nn.Module)
B = TypeVar("B", bound=Batch)


@dataclass(frozen=True, kw_only=True)
class TrainingRun:
    """One run of a training: folder, seed and hardware.

    Parameters
    ----------
    folder
        Folder of the checkpoints.
    recipe
        Everything that determines the result.
    seed
        Seed of the weights and of all other random draws.
    device
        Device to compute on.
    workers
        Processes that make batches; 0 makes them between the steps.
    say
        Called with each progress message.
    """

    folder: Path
    recipe: Mapping[str, Any]
    seed: int
    device: torch.device
    workers: int = 0
    say: Callable[[str], None]


@dataclass(frozen=True)
class Trained(Generic[N]):
    """A trained network and facts about its training.

    Parameters
    ----------
    network
        The network.
    progress
        Progress at the end of the training.
    precision
        Arithmetic of the network.
    seen
        Counts of the training data by name, for the card.
    details
        Further entries of the card.
    """

    network: N
    progress: Progress
    precision: str
    seen: Mapping[str, int]
    details: Mapping[str, Any] = field(default_factory=dict)


class Objective(ABC, Generic[B]):
    """Loss of a network on a batch, and its measures on held-out bodies."""

    terms: ClassVar[tuple[str, ...]]
    """Names of the terms of the loss, as columns of the history."""
    watched: ClassVar[str]
    """The measure of :meth:`measured` in progress messages."""
    held_out: ClassVar[str] = "validation"
    """Name of the held-out bodies, the prefix of their measures."""

    @abstractmethod
    def losses(self, batch: B, half: bool) -> Tensor:
        """Compute the terms of the loss, shape (terms,), with gradients; ``half`` allows bfloat16 in the network."""

    @abstractmethod
    def total(self, losses: Tensor, batch: B) -> Tensor:
        """Return the loss to minimise, a scalar."""

    @abstractmethod
    def measured(self, half: bool) -> Mapping[str, float]:
        """Compute measures of validation bodies, by name; empty if there are none."""

    def row(self, step: int, losses: NDArray[np.float64], costs: Mapping[str, float]) -> dict[str, float]:
        """Return the history row that ends with a step: means of ``losses``, shape (steps, terms), and costs."""
        return {"step": float(step), **dict(zip(self.terms, losses.mean(axis=0).tolist(), strict=True)), **costs}

    def place(self, step: int) -> str:
        """Return the name of a step, counted from 1, for messages."""
        return f"step {step}"


@dataclass
class TrainingLoop(Generic[B]):
    """Training of a network, with checkpoints.

    A batch depends only on its number, so a training that is interrupted and resumed on the same machine ends with the
    same weights as an uninterrupted one, whatever the number of workers.

    Parameters
    ----------
    network
        Network to train, modified in place.
    objective
        Loss and measures; the code of its module, with all that it imports, determines the result.
    make
        Maker of the batch of a number; can be sent to another process.
    plan
        Training plan.
    run
        Folder, seed and hardware.
    rates
        Step sizes of individual modules, by name, as multiples of that of the plan.
    """

    network: nn.Module
    objective: Objective[B]
    make: Callable[[int], B]
    plan: Plan
    run: TrainingRun
    rates: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start the average at the initial weights, and create the optimiser."""
        self._average = Average(self.network) if self.plan.average else None
        self._optimiser = torch.optim.Adam(self._groups(), lr=self.plan.learning_rate)

    @property
    def _checkpoint(self) -> Checkpoint:
        return Checkpoint(self.run.folder, self.network, self._optimiser, self._average)

    def train(self) -> tuple[Progress, str]:
        """Train, resuming from the checkpoint in the folder if there is one.

        Returns
        -------
        Progress
            Progress at the end of the training.
        str
            Precision of the network's arithmetic.

        Raises
        ------
        TrainingError
            If a batch cannot be made, a loss is not finite, or the checkpoint does not fit. A checkpoint of the last
            completed step remains, unless a loss is not finite or an epoch is incomplete.
        """
        plan = self.plan
        done, _ = checkpoint.stands_at(self.run.folder)
        resumed = self._checkpoint.resume(self._recipe(done)) or self._from_snapshot()
        if resumed:
            self.run.say(f"going on after {plan.counted} {resumed.epoch} of {plan.steps // plan.unit}")
        torch.set_flush_denormal(True)
        keep_freed_memory()
        half = plan.precision == "bfloat16" or (plan.precision == "auto" and has_bfloat16(self.run.device))
        progress = self._run(resumed or Progress(0, plan.bodies, 0.0, ()), half)
        if self._average is not None:
            self._average.swap()
        return progress, "bfloat16" if half else "float32"

    def _run(self, progress: Progress, half: bool) -> Progress:
        plan = self.plan
        stream = batches(self.make, range(progress.epoch * plan.unit, plan.steps), self.run.workers, self.run.say)
        start = progress
        began, kept, processor = time.perf_counter() - progress.seconds, time.perf_counter(), 0.0
        terms: list[Tensor] = []
        redrawn: Counter[str] = Counter()
        try:
            for batch in stream:
                before = time.process_time()
                terms.append(self._step(batch, half))
                processor += time.process_time() - before
                redrawn.update(batch.drawn_again)
                step = batch.number + 1
                if plan.schedule == "constant" and doubled(step, plan.bodies):
                    self._snapshot(step)
                if step % plan.row and step != plan.steps:
                    continue
                row = self._row(step, terms, {"processor seconds": processor, "drawn again": float(redrawn.total())})
                if step % plan.look < plan.row or step == plan.steps:
                    row |= self._looked(half)
                history = (*progress.history, row)
                progress = Progress(step // plan.unit, plan.bodies, time.perf_counter() - began, history)
                terms, redrawn, processor = [], Counter(), 0.0
                if time.perf_counter() - kept > CHECKPOINT_SECONDS or step == plan.steps:
                    self._keep(progress)
                    kept = time.perf_counter()
                    self.run.say(self._progress_line(progress, start))
        except TrainingError:
            done, partial = divmod(len(terms), plan.unit)
            done += progress.epoch
            if done and not partial and all(bool(torch.isfinite(term).all()) for term in terms):
                self._keep(Progress(done, plan.bodies, time.perf_counter() - began, progress.history))
            raise
        finally:
            stream.close()
        return progress

    def _groups(self) -> list[dict[str, Any]]:
        """Group the parameters by step size."""
        by_rate: dict[float, list[nn.Parameter]] = {}
        for name, parameter in self.network.named_parameters():
            by_rate.setdefault(self.rates.get(name.partition(".")[0], 1.0), []).append(parameter)
        return [{"params": parameters, "rate": rate} for rate, parameters in by_rate.items()]

    def _keep(self, progress: Progress) -> None:
        self._checkpoint.keep(progress, self._recipe(progress.epoch))

    def _recipe(self, done: int) -> Mapping[str, Any]:
        """Return the recipe of the weights so far; it omits the length while the step size is constant."""
        plan, recipe = self.plan, self.run.recipe
        if plan.schedule == "cosine" or done > plan.steps - plan.falling or "plan" not in recipe:
            return recipe
        return _without_length(recipe)

    def _snapshot(self, step: int) -> None:
        """Save the weights, rounded to half precision, in addition to the checkpoint."""
        bodies = step * self.plan.bodies
        with self._averaged():
            checkpoint.keep_snapshot(self.run.folder, self.network.state_dict(), bodies, self.run.recipe)

    def _from_snapshot(self) -> Progress | None:
        """Start from the newest snapshot of the weights, without the state of Adam, if the checkpoint is lost."""
        newest = checkpoint.newest_snapshot(self.run.folder)
        if newest is None:
            return None
        bodies, before, tensors = newest
        step = bodies // self.plan.bodies
        if _without_length(before) != _without_length(self.run.recipe):
            raise TrainingError(
                f"the weights that are kept in {self.run.folder / SNAPSHOTS} are of another training",
                "train with the same options, or delete the folder to begin anew",
            )
        self.network.load_state_dict(tensors)
        if self._average is not None:
            self._average = Average(self.network)
        return Progress(step, self.plan.bodies, 0.0, ())

    def _averaged(self) -> AbstractContextManager[None]:
        return nullcontext() if self._average is None else self._average.used()

    def _step(self, batch: B, half: bool) -> Tensor:
        for group in self._optimiser.param_groups:
            group["lr"] = group["rate"] * self.plan.step_size(batch.number)
        self.network.train()
        losses = self.objective.losses(batch, half)
        self._optimiser.zero_grad()
        self.objective.total(losses, batch).backward()
        if self.plan.gradient_clip:
            nn.utils.clip_grad_norm_(self.network.parameters(), self.plan.gradient_clip)
        self._optimiser.step()
        if self._average is not None:
            self._average.add(self.plan.average, batch.number)
        # Reading a number would make the host wait for the device, so the losses stay there until the end of a row.
        return losses.detach()

    def _row(self, step: int, terms: Sequence[Tensor], costs: Mapping[str, float]) -> dict[str, float]:
        values = torch.stack(list(terms)).cpu().numpy().astype(np.float64)
        wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(wrong):
            raise TrainingError(
                f"the loss is not a number in {self.objective.place(step - len(terms) + int(wrong[0]) + 1)}",
                "lower the step size with -o learning_rate=3e-4",
            )
        return self.objective.row(step, values, costs)

    def _looked(self, half: bool) -> dict[str, float]:
        self.network.eval()
        with torch.no_grad(), self._averaged():
            measures = self.objective.measured(half)
        return {f"{self.objective.held_out} {name}": value for name, value in measures.items() if math.isfinite(value)}

    def _progress_line(self, progress: Progress, start: Progress) -> str:
        row, watched = progress.history[-1], f"{self.objective.held_out} {self.objective.watched}"
        measure = next((earlier[watched] for earlier in reversed(progress.history) if watched in earlier), None)
        terms = "  ".join(f"{name} {row[name]:.5f}" for name in self.objective.terms[:2])
        seen = f", {watched} {measure:.3f}" if measure is not None else ""
        count = self.plan.steps // self.plan.unit
        left = (progress.seconds - start.seconds) / (progress.epoch - start.epoch) * (count - progress.epoch)
        done = f"{self.plan.counted} {progress.epoch}/{count}"
        return f"{done}  {terms}{seen}  {progress.seconds:.0f} s, about {left:.0f} s left"


def _without_length(recipe: Mapping[str, Any]) -> dict[str, Any]:
    """Return a recipe without the length of the training."""
    plan = {name: value for name, value in recipe.get("plan", {}).items() if name not in ("steps", "falling")}
    return {**recipe, "plan": plan}


def doubled(step: int, bodies: int) -> bool:
    """Return whether the number of bodies passes ``FIRST_SNAPSHOT`` times a power of two in a step, counted from 1."""
    before, after = ((count * bodies // FIRST_SNAPSHOT).bit_length() for count in (step - 1, step))
    return after > before


def fresh_bodies(plan: Plan, progress: Progress) -> dict[str, int]:
    """Return the number of bodies in a training that uses each once, and the number of redraws."""
    redrawn = sum(row["drawn again"] for row in progress.history)
    return {"bodies": plan.steps * plan.bodies, "drawn_again": round(redrawn)}
