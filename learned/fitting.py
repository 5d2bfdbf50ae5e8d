"""Training of a model from training data into a folder: options, pairs, network and card."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from torch import nn

from benchmark.api.learning import CARD, FROZEN_AT, TrainingData
from benchmark.api.parameters import checked
from benchmark.errors import ConfigurationError, TrainingError
from benchmark.machine import describe_machine
from learned.code_network import CODE_RESOLUTION
from learned.images import DepthScale
from learned.models import CONFIGURATIONS, Configuration, load_model, save_model
from learned.pairs import AnyPairs, NoPairs, PairsInMemory, gather, keep
from learned.paper_network import RESOLUTIONS
from learned.training import (
    CHECKPOINT,
    Device,
    Schedule,
    device_named,
    differences,
    fit,
    measures,
    resolved,
)

TRAINABLE: Mapping[str, Sequence[int]] = {
    "progressive": RESOLUTIONS,
    "global-code": (CODE_RESOLUTION,),
}
"""Architectures that this code trains, and the pixels per side that each supports."""

DEFAULTS: Mapping[str, Mapping[str, Any]] = {
    "without_weighting": {"early_epochs": 0},
    "wide-extra": {
        "resolution": CODE_RESOLUTION,
        "epochs": 8,
        "early_epochs": 0,
        "batch": 32,
        "stretch_depth": True,
        "masked_depth": True,
        "cosine": True,
    },
}
"""Schedule of a network where it is not the paper's."""

SECONDS_AN_IMAGE: Mapping[str, float] = {"progressive": 0.043, "global-code": 0.021}
"""Seconds of a core for an image of 128 x 128 pixels.

Measured on an Intel Xeon with bfloat16 in hardware (AMX).
"""

SLOWER = 10.0
"""How many times as long it takes in single precision."""

MEASURED_PAIRS = 60
"""Pairs of each kind that are predicted for measures at the end."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Device of a training."""

    device: Device = "auto"


def train(
    name: str,
    seed: int,
    data: TrainingData,
    folder: Path,
    options: Mapping[str, Any],
    say: Callable[[str], None],
) -> None:
    """Train a model into a folder; see :meth:`learned.methods.TrainedNetwork.train`."""
    _check_trainable(name)
    configuration = CONFIGURATIONS[name]
    of_machine = {
        key: value for key, value in options.items() if key in Machine.__dataclass_fields__
    }
    of_schedule = {key: value for key, value in options.items() if key not in of_machine}
    machine = Machine(**checked(Machine, of_machine, "the training"))
    device = device_named(machine.device)
    schedule = resolved(_schedule(name, of_schedule), device)
    resolutions = TRAINABLE[configuration.architecture]
    if schedule.resolution not in resolutions:
        hint = f"pass -o resolution=N, {resolutions[0]} to {resolutions[-1]}"
        raise ConfigurationError(f"the network has no resolution {schedule.resolution}", hint)
    network = configuration.build(seed)
    recipe = asdict(schedule) | {"seed": seed, "shapes": list(data.identifiers)}
    check_finished(folder, recipe)
    torch.set_num_threads(schedule.threads)
    say(f"training '{name}', seed {seed}: {schedule.in_words()}; {data.title}")
    pairs = _pairs(configuration, data, schedule, folder, say)
    recipe["images"] = pairs.digest()
    if check_finished(folder, recipe):
        say(f"{folder} holds this model already")
        return
    unseen = _unseen_pairs(configuration, data, schedule, pairs.scale, say)
    folder.mkdir(parents=True, exist_ok=True)
    history, seconds = fit(
        network, pairs, unseen, schedule, folder, seed=seed, device=device, log=say
    )
    network = network.cpu().eval()
    _round_weights(network)
    facts = {
        "pairs": len(pairs),  # without those of shapes that cannot be rendered
        "seed": seed,
        "data_digest": recipe["images"],
        "depth_scale": msgspec.to_builtins(pairs.scale),
        "schedule_in_words": f"{schedule.in_words()}, {describe_machine()}",
        "extra_data": data.extra_data,
        "machine": describe_machine(),
        "core_seconds": round(seconds),
        "training_measures": _measured(network, pairs),
    }
    if unseen:
        facts["validation_measures"] = _measured(network, unseen)
    save_model(network, configuration, data, schedule, history, folder, facts)
    load_model(folder)  # which checks what was written
    (folder / CHECKPOINT).unlink(missing_ok=True)
    say(f"finished; the losses of the last epoch are {json.dumps(history[-1])}")


def _check_trainable(name: str) -> None:
    """Raise ``ConfigurationError`` if this code cannot train the network of a configuration."""
    if CONFIGURATIONS[name].architecture not in TRAINABLE:
        problem = f"network '{name}' comes trained"
        raise ConfigurationError(problem, f"train it at commit {FROZEN_AT}")


def _schedule(name: str, options: Mapping[str, Any]) -> Schedule:
    """Return the schedule of a network with the options of a training."""
    return Schedule(**checked(Schedule, {**DEFAULTS.get(name, {}), **options}, "the schedule"))


def estimated_seconds(name: str, n_pairs: int, options: Mapping[str, Any]) -> float:
    """Return about how many seconds a core of this machine takes for a training.

    What makes its images is not included.

    Raises
    ------
    ConfigurationError
        If this code cannot train the network.
    """
    _check_trainable(name)
    schedule = resolved(_schedule(name, options), torch.device("cpu"))
    pixels = (schedule.resolution / CODE_RESOLUTION) ** 2
    seconds = SECONDS_AN_IMAGE[CONFIGURATIONS[name].architecture] * pixels
    if schedule.precision == "float32":
        seconds *= SLOWER
    return seconds * n_pairs * schedule.repeat * schedule.epochs


def _pairs(
    configuration: Configuration,
    data: TrainingData,
    schedule: Schedule,
    folder: Path,
    say: Callable[[str], None],
) -> AnyPairs:
    """Return the pairs of images and targets on which a network is trained.

    Pairs are kept in memory, or on disk beside the model if they are made from many bodies.

    Parameters
    ----------
    configuration
        The network, which decides whether images are cropped.
    data
        The shapes of the training.
    schedule
        Decides on the resolution of the images, and whether depths are stretched.
    folder
        Folder of the model.
    say
        Called with a line of progress.
    """
    resolution = schedule.resolution
    crop = configuration.crop
    pairs: AnyPairs
    if data.bodies is None:
        pairs = gather(data.pairs(), data.n_pairs, resolution, crop)
    else:
        suffix = "-cropped" if crop else ""
        kept = folder.parent / f"pairs-{resolution}{suffix}"
        pairs = keep(data.bodies, resolution, crop, kept, say)
    return pairs.stretched() if schedule.stretch_depth else pairs


def _unseen_pairs(
    configuration: Configuration,
    data: TrainingData,
    schedule: Schedule,
    scale: DepthScale,
    say: Callable[[str], None],
) -> PairsInMemory | None:
    """Return the pairs of other subjects, on which a network is measured; None if there are none.

    Parameters
    ----------
    configuration, data, schedule, say
        As for :func:`_pairs`.
    scale
        Map of the depths of the training.
    """
    try:
        unseen = gather(
            data.validation(), data.n_validation, schedule.resolution, configuration.crop
        )
    except NoPairs:
        say("no shape of another subject can be rendered, so that there is no validation")
        return None
    return unseen.scaled(scale)


def check_finished(folder: Path, recipe: Mapping[str, Any]) -> bool:
    """Check the model in a folder, and return whether it is the finished one of this training.

    Parameters
    ----------
    folder
        Folder of the model.
    recipe
        Options of the training, and the digests of what it is trained on.

    Raises
    ------
    ConfigurationError
        If the folder holds the model of another training, or one that is damaged.
    """
    if not (folder / CARD).is_file():
        return False
    card = json.loads((folder / CARD).read_bytes())
    # An option that did not exist when the card was written had its default.
    stored = {**asdict(Schedule()), **(card.get("schedule") or {})}
    # The other parts of the recipe have other names in a card.
    facts = {"seed": "seed", "shapes": "identifiers", "images": "data_digest"}
    for name, fact in facts.items():
        if name in recipe:
            stored[name] = card.get(fact)
    changed = differences(stored, recipe)
    if changed:
        problem = f"{folder} holds a finished model of another training, with another {changed}"
        hint = "delete the folder to train anew, or name other --results"
        raise ConfigurationError(problem, hint)
    try:
        load_model(folder)
    except ConfigurationError as error:
        raise ConfigurationError(error.problem, "delete the folder to train anew") from error
    return True


@torch.no_grad()
def _round_weights(network: nn.Module) -> None:
    """Round the weights of a network in place to half precision, in which they are stored.

    What is measured on it is then true of the model that others load.

    Raises
    ------
    TrainingError
        If a weight is no number, or too large for half precision.
    """
    for name, parameter in network.named_parameters():
        parameter.copy_(parameter.half())
        if not parameter.isfinite().all():
            problem = f"the training diverged: {name} holds a weight that is not finite"
            raise TrainingError(problem, "train anew with a smaller step size: -o learning_rate")


@torch.inference_mode()
def _measured(network: nn.Module, pairs: AnyPairs) -> dict[str, float]:
    """Return the measures of some predictions of the finished network."""
    numbers = np.linspace(0, len(pairs) - 1, min(MEASURED_PAIRS, len(pairs)))
    rows = torch.from_numpy(numbers.round().astype(np.int64))
    images, targets = pairs[rows]
    predictions = torch.cat([network(image[None]) for image in images])
    return measures(predictions, targets, pairs.scale.factor)
