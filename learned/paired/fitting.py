"""From training data to a folder with a finished model: options, pairs, the loop, card and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmark.api.learning import CARD, TrainingData
from learned.paired import pictures
from learned.paired.configuration import Configuration
from learned.paired.configuration import configuration as configuration_named
from learned.paired.gathering import forget, gather_kept
from learned.paired.model import load_model, predict
from learned.paired.pairs import gather
from learned.paired.saving import save_model
from learned.paired.schedule import Schedule, schedule
from learned.paired.training import check_resolution, train
from learned.training.arithmetic import device_named
from learned.training.checkpoint import CHECKPOINT
from learned.training.machine import Machine, machine_among
from learned.training.measures import measures
from learned.training.saving import check_finished
from learned.weights import as_stored

SAMPLES = 60
"""Pairs that are predicted for the pictures and the measures of seen shapes."""


def checked_options(name: str, options: Mapping[str, Any]) -> tuple[Configuration, Schedule, Machine]:
    """The configuration of a name, and its schedule and the machine with options; see :func:`fit`.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or there is no such device here.
    """
    chosen = configuration_named(name)
    machine, others = machine_among(Machine, options)
    plan = schedule(chosen.schedule, others)
    check_resolution(chosen, plan.resolution)
    return chosen, plan, machine


def fit(
    name: str,
    seed: int,
    data: TrainingData,
    folder: Path,
    options: Mapping[str, Any],
    say: Callable[[str], None],
) -> None:
    """Train a model into a folder, or go on where a training was stopped; a finished one is left alone.

    Parameters
    ----------
    name
        Name of the configuration.
    seed
        Seed of the weights and of the order of pairs.
    data
        What to train on.
    folder
        Where the model goes.
    options
        Fields of :class:`learned.paired.schedule.Schedule` and of :class:`learned.training.machine.Machine`.
    say
        Told about progress.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or the folder holds a finished model of another training.
    TrainingError
        If training cannot go on.
    """
    chosen, plan, machine = checked_options(name, options)
    recipe = {
        "configuration": chosen.described(),
        "schedule": {field: getattr(plan, field) for field in Schedule.__dataclass_fields__},
        "data": data.digest,
        "seed": seed,
    }
    if (folder / CARD).is_file():
        check_finished(folder, recipe, plan.in_words())
        say(f"{folder} holds this model already")
        return
    device = device_named(machine.device)
    torch.set_num_threads(machine.cores)
    folder.mkdir(parents=True, exist_ok=True)
    say(f"{data.title}: gathering {data.n_pairs} pairs at {plan.resolution} x {plan.resolution}")
    pairs, unseen = gather_kept(data, plan.resolution, folder, say), gather(data.unseen(), plan.resolution)
    say(f"training '{name}', seed {seed}: {plan.in_words()}, on {device.type}")
    result = train(chosen, plan, pairs, unseen, folder, recipe, seed=seed, device=device, say=say)
    network = result.network.to("cpu").eval()
    as_stored(network)
    title = f"{name}, seed {seed}, {data.name}"
    final = {}
    for kind, of_kind in (("training", pairs), ("unseen", unseen)):
        rows = np.linspace(0, len(of_kind) - 1, min(SAMPLES, len(of_kind))).round().astype(int)
        images, targets = of_kind.images[rows], of_kind.targets[of_kind.target_of[rows]]
        predictions = torch.stack([predict(network, image) for image in images])
        final[kind] = measures(predictions, targets)
        names = [of_kind.identifiers[row] for row in rows]
        picture = folder / f"samples-{kind}.png"
        pictures.draw_samples(names, images, predictions, targets, picture, f"{title}: {kind} pairs")
    pictures.draw_history(result.progress.history, folder / "history.png", title)
    card = save_model(folder, result, data, chosen, plan, seed=seed, n_pairs=len(pairs), final=final, recipe=recipe)
    load_model(folder)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    forget(folder)
    say(
        f"finished in {card['seconds']:.0f} s, {card['images_per_second']:.0f} images a second; unseen mask overlap "
        f"{final['unseen']['mask overlap']:.3f}, depth error {final['unseen']['depth error']:.4f}"
    )
