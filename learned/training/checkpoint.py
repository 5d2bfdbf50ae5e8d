"""Checkpoints of a training (weights, their average, state of Adam, losses) in safetensors, never pickle."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from benchmark.errors import TrainingError
from benchmark.files import write_atomically


class Average:
    """Exponential moving average of the weights of a network.

    Parameters
    ----------
    network
        Network with its initial weights.
    """

    def __init__(self, network: nn.Module) -> None:
        self._network = network
        self.weights: dict[str, Tensor] = {
            name: parameter.detach().clone() for name, parameter in network.named_parameters()
        }

    def add(self, kept: float, step: int) -> None:
        """Update the average with the weights after a step.

        Parameters
        ----------
        kept
            Decay of the average; smaller in the first steps, so that the initial weights are soon forgotten.
        step
            Index of the step, counted from 0.
        """
        share = 1 - min(kept, (1 + step) / (10 + step))
        newest = [parameter.detach() for parameter in self._network.parameters()]
        torch._foreach_lerp_(list(self.weights.values()), newest, share)

    def swap(self) -> None:
        """Exchange the weights of the network and the average."""
        with torch.no_grad():
            for name, parameter in self._network.named_parameters():
                newest = parameter.clone()
                parameter.copy_(self.weights[name])
                self.weights[name].copy_(newest)

    @contextmanager
    def used(self) -> Iterator[None]:
        """Give the network the averaged weights inside a ``with`` block."""
        self.swap()
        try:
            yield
        finally:
            self.swap()


CHECKPOINT = "checkpoint.safetensors"

SNAPSHOTS = "snapshots"
"""Folder of snapshots of the weights after several numbers of bodies."""

VERSION = str(torch.__version__)
"""Version of torch; arithmetic differs between versions."""

_MOMENTS = ("exp_avg", "exp_avg_sq")


@dataclass(frozen=True)
class Progress:
    """Content of a checkpoint other than tensors.

    Parameters
    ----------
    epoch
        Number of completed epochs or steps.
    batch
        Pairs or bodies per step, halved if memory ran out.
    seconds
        Time spent so far.
    history
        Rows of the history so far.
    """

    epoch: int
    batch: int
    seconds: float
    history: tuple[Mapping[str, float], ...]


def write(path: Path, content: bytes) -> None:
    """Write a file atomically, or raise ``TrainingError`` if it cannot be written."""
    try:
        write_atomically(path, lambda file: file.write(content), durable=True)
    except OSError as error:
        raise TrainingError(
            f"cannot write {path}: {error.strerror}",
            "free some space and start again: it goes on from the last checkpoint",
        ) from error


@dataclass(frozen=True)
class Checkpoint:
    """The file in a folder from which a training resumes.

    Parameters
    ----------
    folder
        Folder of the file.
    network, optimiser
        The network, and the Adam that trains it.
    average
        Averaged weights, if any.
    """

    folder: Path
    network: nn.Module
    optimiser: torch.optim.Optimizer
    average: Average | None = None

    def keep(self, progress: Progress, recipe: Mapping[str, Any]) -> None:
        """Write the checkpoint.

        Parameters
        ----------
        progress
            Progress of the training.
        recipe
            Everything that determines the result; :meth:`resume` refuses another one.
        """
        tensors: dict[str, Tensor] = {}
        for name, parameter in self.network.named_parameters():
            tensors[f"weights.{name}"] = parameter.detach().cpu().contiguous()
            state = self.optimiser.state.get(parameter, {})
            for moment in _MOMENTS:
                if moment in state:
                    tensors[f"{moment}.{name}"] = state[moment].detach().cpu().contiguous()
            if "step" in state:
                tensors[f"step.{name}"] = torch.as_tensor(state["step"]).detach().cpu().reshape(1)
            if self.average is not None:
                tensors[f"average.{name}"] = self.average.weights[name].cpu().contiguous()
        metadata = {
            "recipe": json.dumps(recipe, sort_keys=True),
            "torch": VERSION,
            "epoch": str(progress.epoch),
            "batch": str(progress.batch),
            "seconds": str(progress.seconds),
            "history": json.dumps(list(progress.history)),
        }
        write(self.folder / CHECKPOINT, save(tensors, metadata))

    def resume(self, recipe: Mapping[str, Any]) -> Progress | None:
        """Restore network, optimiser and average, and return the progress; None if there is no checkpoint.

        Raises
        ------
        TrainingError
            If the checkpoint is damaged, or was made with other options or data, or another torch.
        """
        path = self.folder / CHECKPOINT
        if not path.is_file():
            return None
        try:
            with safe_open(str(path), framework="pt") as file:
                metadata = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            before, epoch, batch = json.loads(metadata["recipe"]), int(metadata["epoch"]), int(metadata["batch"])
            history, seconds = tuple(json.loads(metadata["history"])), float(metadata["seconds"])
            version = metadata.get("torch", "")
        except (SafetensorError, OSError, KeyError, ValueError) as error:
            raise TrainingError(f"checkpoint {path} is damaged: {error}", "delete it and train again") from error
        if changed := _differences(before, recipe):
            raise TrainingError(
                f"checkpoint {path} was made with another {', '.join(changed)}",
                "train with the same options, or delete the folder to begin anew",
            )
        if _release(version) != _release(VERSION):
            raise TrainingError(
                f"checkpoint {path} was made with torch {version or 'of an unknown version'}, not {VERSION}",
                "install that version, or delete the checkpoint to begin anew",
            )
        with torch.no_grad():
            for name, parameter in self.network.named_parameters():
                parameter.copy_(tensors[f"weights.{name}"])
                if f"step.{name}" in tensors:
                    # Moments get the memory layout of their parameter, so that a resumed run computes the same bits.
                    moments = {
                        moment: torch.zeros_like(parameter).copy_(tensors[f"{moment}.{name}"]) for moment in _MOMENTS
                    }
                    self.optimiser.state[parameter] = {"step": tensors[f"step.{name}"].reshape(()), **moments}
                if self.average is not None:
                    self.average.weights[name].copy_(tensors[f"average.{name}"])
        return Progress(epoch, batch, seconds, history)


def keep_snapshot(folder: Path, weights: Mapping[str, Tensor], bodies: int, recipe: Mapping[str, Any]) -> None:
    """Save weights, rounded to half precision, under the number of bodies seen."""
    metadata = {"recipe": json.dumps(recipe, sort_keys=True), "bodies": str(bodies)}
    halves = {name: tensor.detach().cpu().half().contiguous() for name, tensor in weights.items()}
    write(folder / SNAPSHOTS / f"{bodies:010}.safetensors", save(halves, metadata))


def newest_snapshot(folder: Path) -> tuple[int, dict[str, Any], dict[str, Tensor]] | None:
    """Return bodies, recipe and weights of the snapshot with the most bodies; None if there is none.

    Raises
    ------
    TrainingError
        If the snapshot is damaged.
    """
    kept = sorted((folder / SNAPSHOTS).glob("*.safetensors"))
    if not kept:
        return None
    try:
        with safe_open(str(kept[-1]), framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
        return int(metadata["bodies"]), json.loads(metadata["recipe"]), tensors
    except (SafetensorError, OSError, KeyError, ValueError) as error:
        raise TrainingError(f"snapshot {kept[-1]} is damaged: {error}", "delete it") from error


def stands_at(folder: Path) -> tuple[int, int]:
    """Return the completed epochs or steps, and the batch; 0 and 0 if there is no readable checkpoint."""
    try:
        with safe_open(str(folder / CHECKPOINT), framework="pt") as file:
            metadata = file.metadata() or {}
        return int(metadata["epoch"]), int(metadata["batch"])
    except (SafetensorError, OSError, KeyError, ValueError):
        return 0, 0


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the names of the entries that differ."""
    return sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))


def _release(version: str) -> str:
    """Return the version without the kind of build, because a training may resume on another device."""
    return version.partition("+")[0]
