"""A training over a stream: each step sees what no other step sees, resumable, with the same result."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, Protocol, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from benchmark.api.contracts import Interval
from benchmark.errors import ConfigurationError, TrainingError
from learned.training import checkpoint
from learned.training.arithmetic import Precision, has_bfloat16, keep_freed_memory
from learned.training.average import Average
from learned.training.checkpoint import SNAPSHOTS, Progress
from learned.training.stream import Batch, batches

CHECKPOINT_SECONDS = 60.0
"""Time between checkpoints: what a crash costs at most, and the steps of a row."""

ROW = 50
"""Steps of a row of the history; checkpoints are written between rows."""

LOOKS = 20
"""How often validation bodies are looked at during a training whose end is known."""

LOOK_STEPS = 2000
"""Steps between two looks of one whose end is not."""

FIRST_SNAPSHOT = 1000
"""Bodies after which the weights of a training of unknown length are kept, and again whenever they have doubled."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of a training.

    Parameters
    ----------
    steps
        Steps of Adam, each on other bodies.
    bodies
        Bodies of each step; the stream says in how many poses.
    learning_rate
        Largest step size of Adam; it rises over the first ``warm_up`` steps.
    warm_up
        Steps of the rise.
    schedule
        ``"cosine"``: the step size falls to zero along half a cosine. ``"constant"``: it stays, so that a training may
        be given more ``steps``, or a ``falling`` end, when it is well under way.
    falling
        Last steps of a constant schedule, along which the step size falls to zero in a line.
    average
        Share of the averaged weights that is kept in each step, the rest being the newest weights; 0 for no average.
        The finished model has the averaged weights.
    gradient_clip
        Largest norm of the gradient; 0 for no limit.
    precision
        Arithmetic of the network: ``"auto"`` takes bfloat16 where the hardware has it.
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

    def __post_init__(self) -> None:
        """Raise ``ConfigurationError`` if the step size is to fall in two ways, or for longer than the training."""
        if self.falling > (self.steps if self.schedule == "constant" else 0):
            raise ConfigurationError(
                f"the step size cannot fall for {self.falling} of {self.steps} steps of schedule '{self.schedule}'",
                "pass -o schedule=constant, and fewer falling steps than steps",
            )

    def step_size(self, step: int) -> float:
        """Step size of Adam in a step, counted from 0."""
        rising = min(1.0, (step + 1) / (self.warm_up + 1))
        if self.schedule == "constant":
            return self.learning_rate * rising * min(1.0, (self.steps - step) / (self.falling + 1))
        return self.learning_rate * rising * 0.5 * (1 + math.cos(math.pi * step / self.steps))


N = TypeVar("N", bound=nn.Module)


@dataclass(frozen=True)
class Trained(Generic[N]):
    """A trained network and how it came about.

    Parameters
    ----------
    network
        The network.
    progress
        Where the training ended.
    device, precision
        What computed it, and how.
    seen
        What it was trained on, in numbers by name, for the card.
    """

    network: N
    progress: Progress
    device: str
    precision: str
    seen: Mapping[str, int]


B = TypeVar("B", bound=Batch)
B_in = TypeVar("B_in", bound=Batch, contravariant=True)


class Teacher(Protocol[B_in]):
    """Objective of a network for a batch."""

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms of the loss, as columns of the history."""
        ...

    @property
    def watched(self) -> str:
        """The measure of :meth:`measured` that is told with the progress."""
        ...

    def losses(self, batch: B_in, half: bool) -> Tensor:
        """Terms of the loss, shape (terms,), with their gradients; ``half`` allows bfloat16 in the network."""
        ...

    def total(self, losses: Tensor) -> Tensor:
        """The loss that is minimised, a scalar."""
        ...

    def measured(self, half: bool) -> Mapping[str, float]:
        """Measures of validation bodies, by name; empty where there are none."""
        ...


@dataclass
class Steps(Generic[B]):
    """A training: what is taught, how, and where it is kept.

    A step's bodies are a matter of its number, so a training that was stopped and resumed on the same machine ends with
    the same weights as one that was not, however many processes made the bodies.

    Parameters
    ----------
    network
        What is trained; it is changed.
    teacher
        What it is taught.
    make
        Makes the batch of a number; can be sent to another process.
    plan
        How it is trained.
    folder
        Where checkpoints go.
    recipe
        Everything that determines the result.
    loop
        Module whose code, with all that it imports, determines the result.
    say
        Told about progress.
    rates
        Step sizes of some modules of the network, by name, as multiples of that of the plan.
    """

    network: nn.Module
    teacher: Teacher[B]
    make: Callable[[int], B]
    plan: Plan
    folder: Path
    recipe: Mapping[str, Any]
    loop: str
    say: Callable[[str], None]
    rates: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin the average at the first weights."""
        self._average = Average(self.network) if self.plan.average else None

    def run(self, device: torch.device, workers: int) -> tuple[Progress, str]:
        """Train, going on from the checkpoint in the folder if there is one.

        Parameters
        ----------
        device
            Where the network is.
        workers
            Processes that make batches.

        Returns
        -------
        Progress
            Where the training ended.
        str
            The precision of the network's arithmetic.

        Raises
        ------
        TrainingError
            If a batch cannot be made, a loss is not a number, or the checkpoint does not fit. The checkpoint then
            stands at the last step that was done, unless a loss of it was not a number.
        """
        optimiser = torch.optim.Adam(self._groups(), lr=self.plan.learning_rate)
        recipe = self._recipe(checkpoint.steps_done(self.folder))
        found = checkpoint.resume(self.folder, self.network, optimiser, recipe, self.loop, self._average)
        found = found or self._from_snapshot()
        if found:
            self.say(f"going on after step {found.epoch} of {self.plan.steps}")
        torch.set_flush_denormal(True)
        keep_freed_memory()
        precision = self.plan.precision
        half = precision == "bfloat16" or (precision == "auto" and has_bfloat16(device))
        progress = self._run(found or Progress(0, self.plan.bodies, 0.0, ()), optimiser, half, workers)
        if self._average is not None:
            self._average.swap()
        return progress, "bfloat16" if half else "float32"

    def _run(self, progress: Progress, optimiser: torch.optim.Adam, half: bool, workers: int) -> Progress:
        plan = self.plan
        stream = batches(self.make, range(progress.epoch, plan.steps), workers, self.say)
        began, kept, processor = time.perf_counter() - progress.seconds, time.perf_counter(), 0.0
        terms: list[Tensor] = []
        again: Counter[str] = Counter()
        look = LOOK_STEPS if plan.schedule == "constant" else max(1, plan.steps // LOOKS)
        try:
            for batch in stream:
                before = time.process_time()
                terms.append(self._step(batch, optimiser, half))
                processor += time.process_time() - before
                again.update(batch.drawn_again)
                step = batch.number + 1
                if plan.schedule == "constant" and doubled(step, plan.bodies):
                    self._snapshot(step)
                if step % ROW and step != plan.steps:
                    continue
                row = self._row(step, terms, again, processor)
                if step % look < ROW or step == plan.steps:
                    row |= {f"validation {name}": value for name, value in self._looked(half).items()}
                history = (*progress.history, row)
                progress = Progress(step, plan.bodies, time.perf_counter() - began, history)
                terms, again, processor = [], Counter(), 0.0
                if time.perf_counter() - kept > CHECKPOINT_SECONDS or step == plan.steps:
                    self._keep(progress, optimiser)
                    kept = time.perf_counter()
                    self.say(self._told(progress))
        except TrainingError:
            done = progress.epoch + len(terms)
            if done and all(bool(torch.isfinite(each).all()) for each in terms):
                self._keep(Progress(done, plan.bodies, time.perf_counter() - began, progress.history), optimiser)
            raise
        finally:
            stream.close()
        return progress

    def _groups(self) -> list[dict[str, Any]]:
        """Parameters by the rate at which they learn."""
        by_rate: dict[float, list[nn.Parameter]] = {}
        for name, parameter in self.network.named_parameters():
            by_rate.setdefault(self.rates.get(name.partition(".")[0], 1.0), []).append(parameter)
        return [{"params": parameters, "rate": rate} for rate, parameters in by_rate.items()]

    def _keep(self, progress: Progress, optimiser: torch.optim.Adam) -> None:
        recipe = self._recipe(progress.epoch)
        checkpoint.keep(self.folder, self.network, optimiser, progress, recipe, self.loop, self._average)

    def _recipe(self, done: int) -> Mapping[str, Any]:
        """Return what determines the weights after so many steps; with a constant step size, not how many come."""
        if self.plan.schedule == "cosine" or done > self.plan.steps - self.plan.falling or "plan" not in self.recipe:
            return self.recipe
        return _without_length(self.recipe)

    def _snapshot(self, step: int) -> None:
        """Keep the weights, rounded to half precision, beside the checkpoint."""
        with self._averaged():
            checkpoint.keep_snapshot(self.folder, self.network.state_dict(), step * self.plan.bodies, self.recipe)

    def _from_snapshot(self) -> Progress | None:
        """Begin with the newest weights that were kept, if the checkpoint is lost, and Adam's state with it."""
        found = checkpoint.newest_snapshot(self.folder)
        if found is None:
            return None
        bodies, before, tensors = found
        step = bodies // self.plan.bodies
        if _without_length(before) != _without_length(self.recipe):
            raise TrainingError(
                f"the weights that are kept in {self.folder / SNAPSHOTS} are of another training",
                "train with the same options, or delete the folder to begin anew",
            )
        self.network.load_state_dict(tensors)
        if self._average is not None:
            self._average = Average(self.network)
        return Progress(step, self.plan.bodies, 0.0, ())

    def _averaged(self) -> AbstractContextManager[None]:
        return nullcontext() if self._average is None else self._average.used()

    def _step(self, batch: B, optimiser: torch.optim.Adam, half: bool) -> Tensor:
        for group in optimiser.param_groups:
            group["lr"] = group["rate"] * self.plan.step_size(batch.number)
        self.network.train()
        found = self.teacher.losses(batch, half)
        optimiser.zero_grad()
        self.teacher.total(found).backward()
        if self.plan.gradient_clip:
            nn.utils.clip_grad_norm_(self.network.parameters(), self.plan.gradient_clip)
        optimiser.step()
        if self._average is not None:
            self._average.add(self.plan.average, batch.number)
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
        told = dict(zip(self.teacher.terms, values.mean(axis=0).tolist(), strict=True))
        return {"step": float(step), **told, "processor seconds": processor, "drawn again": float(sum(again.values()))}

    def _looked(self, half: bool) -> dict[str, float]:
        self.network.eval()
        with torch.no_grad(), self._averaged():
            found = self.teacher.measured(half)
        return {name: value for name, value in found.items() if math.isfinite(value)}

    def _told(self, progress: Progress) -> str:
        row, watched = progress.history[-1], f"validation {self.teacher.watched}"
        looked = next((each[watched] for each in reversed(progress.history) if watched in each), None)
        terms = "  ".join(f"{name} {row[name]:.5f}" for name in self.teacher.terms[:2])
        seen = f", {watched} {looked:.3f}" if looked is not None else ""
        left = progress.seconds / progress.epoch * (self.plan.steps - progress.epoch)
        done = f"step {progress.epoch}/{self.plan.steps}"
        return f"{done}  {terms}{seen}  {progress.seconds:.0f} s, about {left:.0f} s left"


def _without_length(recipe: Mapping[str, Any]) -> dict[str, Any]:
    """A recipe without what tells how many steps there are."""
    plan = {name: value for name, value in recipe.get("plan", {}).items() if name not in ("steps", "falling")}
    return {**recipe, "plan": plan}


def doubled(step: int, bodies: int) -> bool:
    """Return whether the bodies seen pass a power of two times ``FIRST_SNAPSHOT`` in a step, counted from 1."""
    before, after = ((count * bodies // FIRST_SNAPSHOT).bit_length() for count in (step - 1, step))
    return after > before


def fresh_bodies(plan: Plan, progress: Progress) -> dict[str, int]:
    """Return how many bodies a training saw of which none came twice, and how often something was drawn again."""
    again = sum(row["drawn again"] for row in progress.history)
    return {"bodies": plan.steps * plan.bodies, "drawn_again": round(again)}
