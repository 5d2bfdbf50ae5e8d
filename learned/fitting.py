"""Training of a model from training data into a folder: options, pairs, network, pictures and card."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from torch import nn

from benchmark.api.contracts import Interval
from benchmark.api.learning import CARD, TrainingData
from benchmark.api.parameters import checked
from benchmark.errors import ConfigurationError
from benchmark.machine import available_cores
from learned import pictures
from learned.methods import TRAINABLE_AT
from learned.models import CONFIGURATIONS, Configuration, hardware, load, save
from learned.pairs import Pairs, gather
from learned.paper_network import RESOLUTIONS
from learned.training import CHECKPOINT, Device, Schedule, device_named, differences, fit, measures, resolved

SAMPLES = 60
"""Pairs of each kind that are predicted for pictures and measures at the end."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Device and threads of a training, and the folder of a model whose weights it begins with."""

    device: Device = "auto"
    threads: Annotated[int, Interval(1)] | None = None
    init: str = ""


def train(
    name: str, seed: int, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]
) -> None:
    """Train a model into a folder; see :meth:`learned.methods.TrainedNetwork.train`."""
    configuration = CONFIGURATIONS[name]
    if configuration.architecture != "progressive":
        raise ConfigurationError(f"network '{name}' comes trained", f"train it at commit {TRAINABLE_AT}")
    own = {key: value for key, value in options.items() if key in Machine.__dataclass_fields__}
    machine = Machine(**checked(Machine, own, "the training"))
    device = device_named(machine.device)
    settings = {key: value for key, value in options.items() if key not in own}
    settings = ({"early_epochs": 0} if name == "without_weighting" else {}) | settings
    schedule = resolved(Schedule(**checked(Schedule, settings, "the schedule")), device)
    if schedule.resolution not in RESOLUTIONS:
        hint = f"pass -o resolution=N, {RESOLUTIONS[0]} to {RESOLUTIONS[-1]}"
        raise ConfigurationError(f"the network has no resolution {schedule.resolution}", hint)
    words = schedule.in_words() + (f", from {machine.init}" if machine.init else "")
    network, init = _initial(configuration, seed, machine.init)
    recipe = asdict(schedule) | {"seed": seed, "init": init, "shapes": list(data.identifiers)}
    _check_finished(folder, recipe)
    torch.set_num_threads(machine.threads or available_cores())
    say(f"training '{name}', seed {seed}: {words}; {data.title}")
    pairs = gather(data.pairs(), data.n_pairs, schedule.resolution, configuration.crop)
    recipe["images"] = pairs.digest()
    if _check_finished(folder, recipe):
        say(f"{folder} holds this model already")
        return
    unseen = gather(data.validation(), data.n_validation, schedule.resolution, configuration.crop)
    folder.mkdir(parents=True, exist_ok=True)
    history = fit(network, pairs, unseen, schedule, folder, seed=seed, init=init, device=device, log=say)
    network = network.cpu().eval()
    title = f"{name}, seed {seed}, {data.name}"
    facts = {
        "seed": seed,
        "init": init,
        "data_digest": recipe["images"],
        "schedule_in_words": f"{words}, {hardware(device)}",
        "training_measures": _sampled(network, pairs, folder / "samples-training.png", f"{title}: training pairs"),
        "validation_measures": _sampled(network, unseen, folder / "samples-validation.png", f"{title}: validation"),
    }
    save(network, configuration, data, schedule, history, folder, facts)
    load(folder)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    say(f"finished; the losses of the last epoch are {json.dumps(history[-1])}")


def _initial(configuration: Configuration, seed: int, folder: str) -> tuple[nn.Module, str]:
    """Return the network with random weights or those of the model in a folder, and the digest of the latter."""
    network = configuration.build(seed)
    if not folder:
        return network, ""
    trained, card = load(Path(folder))
    try:
        network.load_state_dict(trained.state_dict())
    except RuntimeError as error:
        problem = f"the model in {folder} is of network '{card.configuration.name}', not '{configuration.name}'"
        raise ConfigurationError(problem, "begin with a model of the same network") from error
    return network, card.digest


def _check_finished(folder: Path, recipe: Mapping[str, Any]) -> bool:
    """Return whether a folder holds a finished model; raise ``ConfigurationError`` if it is of another recipe."""
    if not (folder / CARD).is_file():
        return False
    card = {"init": ""} | json.loads((folder / CARD).read_bytes())
    facts = {"seed": "seed", "init": "init", "shapes": "identifiers", "images": "data_digest"}
    known = {name: card.get(fact) for name, fact in facts.items() if name in recipe}
    if changed := differences((card.get("schedule") or {}) | known, recipe):
        problem = f"{folder} holds a finished model of another training, with another {changed}"
        raise ConfigurationError(problem, "delete the folder to train anew, or name other --results")
    return True


@torch.inference_mode()
def _sampled(network: nn.Module, pairs: Pairs, picture: Path, title: str) -> dict[str, float]:
    """Draw some predictions of the finished network, and return their measures."""
    rows = torch.from_numpy(np.linspace(0, len(pairs) - 1, min(SAMPLES, len(pairs))).round().astype(np.int64))
    images, targets = pairs[rows]
    predictions = torch.cat([network(image[None]) for image in images])
    pictures.draw_samples([pairs.names[row] for row in rows], images, predictions, targets, picture, title)
    return measures(predictions, targets)
