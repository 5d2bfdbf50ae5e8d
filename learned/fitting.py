"""Training of a model from training data into a folder: options, pairs, network and card."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import torch
from torch import nn

from benchmark.api.contracts import Interval
from benchmark.api.learning import CARD, TrainingData
from benchmark.api.parameters import checked
from benchmark.errors import ConfigurationError
from benchmark.machine import available_cores, describe_machine
from learned.images import DepthScale
from learned.models import CONFIGURATIONS, load, save
from learned.pairs import Pairs, gather
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

TRAINABLE_AT = "4868b8b9"
"""Last commit that trains the networks of generated bodies."""

SAMPLES = 60
"""Pairs of each kind that are predicted for measures at the end."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Device and threads of a training."""

    device: Device = "auto"
    threads: Annotated[int, Interval(1)] | None = None


def train(
    name: str,
    seed: int,
    data: TrainingData,
    folder: Path,
    options: Mapping[str, Any],
    say: Callable[[str], None],
) -> None:
    """Train a model into a folder; see :meth:`learned.methods.TrainedNetwork.train`."""
    configuration = CONFIGURATIONS[name]
    if configuration.architecture != "progressive":
        raise ConfigurationError(
            f"network '{name}' comes trained", f"train it at commit {TRAINABLE_AT}"
        )
    own = {key: value for key, value in options.items() if key in Machine.__dataclass_fields__}
    machine = Machine(**checked(Machine, own, "the training"))
    device = device_named(machine.device)
    settings = {key: value for key, value in options.items() if key not in own}
    settings = ({"early_epochs": 0} if name == "without_weighting" else {}) | settings
    schedule = resolved(Schedule(**checked(Schedule, settings, "the schedule")), device)
    if schedule.resolution not in RESOLUTIONS:
        hint = f"pass -o resolution=N, {RESOLUTIONS[0]} to {RESOLUTIONS[-1]}"
        raise ConfigurationError(f"the network has no resolution {schedule.resolution}", hint)
    words, network = schedule.in_words(), configuration.build(seed)
    recipe = asdict(schedule) | {"seed": seed, "shapes": list(data.identifiers)}
    _check_finished(folder, recipe)
    torch.set_num_threads(machine.threads or available_cores())
    say(f"training '{name}', seed {seed}: {words}; {data.title}")
    pairs = gather(data.pairs(), data.n_pairs, schedule.resolution, configuration.crop)
    pairs = pairs.scaled(DepthScale.of(pairs.targets)) if schedule.stretch_depth else pairs
    recipe["images"] = pairs.digest()
    if _check_finished(folder, recipe):
        say(f"{folder} holds this model already")
        return
    unseen = gather(
        data.validation(), data.n_validation, schedule.resolution, configuration.crop
    ).scaled(pairs.scale)
    folder.mkdir(parents=True, exist_ok=True)
    history = fit(network, pairs, unseen, schedule, folder, seed=seed, device=device, log=say)
    network = network.cpu().eval()
    facts = {
        "seed": seed,
        "data_digest": recipe["images"],
        "depth_scale": msgspec.to_builtins(pairs.scale),
        "schedule_in_words": f"{words}, {describe_machine()}",
        "training_measures": _measured(network, pairs),
        "validation_measures": _measured(network, unseen),
    }
    save(network, configuration, data, schedule, history, folder, facts)
    load(folder)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    say(f"finished; the losses of the last epoch are {json.dumps(history[-1])}")


def _check_finished(folder: Path, recipe: Mapping[str, Any]) -> bool:
    """Return whether a folder holds a finished model; raise ``ConfigurationError`` if it is of another recipe."""
    if not (folder / CARD).is_file():
        return False
    card = json.loads((folder / CARD).read_bytes())
    facts = {"seed": "seed", "shapes": "identifiers", "images": "data_digest"}
    known = {name: card.get(fact) for name, fact in facts.items() if name in recipe}
    if changed := differences((card.get("schedule") or {}) | known, recipe):
        problem = f"{folder} holds a finished model of another training, with another {changed}"
        raise ConfigurationError(
            problem, "delete the folder to train anew, or name other --results"
        )
    return True


@torch.inference_mode()
def _measured(network: nn.Module, pairs: Pairs) -> dict[str, float]:
    """Return the measures of some predictions of the finished network."""
    rows = torch.from_numpy(
        np.linspace(0, len(pairs) - 1, min(SAMPLES, len(pairs))).round().astype(np.int64)
    )
    images, targets = pairs[rows]
    return measures(
        torch.cat([network(image[None]) for image in images]), targets, pairs.scale.factor
    )
