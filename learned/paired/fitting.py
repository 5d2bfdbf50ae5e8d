"""Training of a model on pairs, into a folder: options, pairs, training, pictures and entries of the card."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from benchmark.api.learning import TrainingData
from learned.paired import pictures, training
from learned.paired.configuration import Configuration
from learned.paired.configuration import configuration as configuration_named
from learned.paired.gathering import forget, gather_kept
from learned.paired.model import load_model, predict
from learned.paired.pairs import Pairs, gather
from learned.paired.schedule import Schedule, schedule
from learned.training.fitting import Fitting
from learned.training.loop import Trained, TrainingRun, measures
from learned.training.machine import Machine, machine_among
from learned.weights import as_stored

SAMPLES = 60
"""Pairs of each kind, training and unseen, that are predicted for the pictures and measures at the end."""


def checked_options(name: str, options: Mapping[str, Any]) -> tuple[Configuration, Schedule, Machine]:
    """Return the configuration of this name, and the schedule and machine that the options describe; see :func:`fit`.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or the device is not available.
    """
    chosen = configuration_named(name)
    machine, others = machine_among(Machine, options)
    plan = schedule(chosen.schedule, others)
    training.check_resolution(chosen, plan.resolution)
    return chosen, plan, machine


def fit(
    name: str,
    seed: int,
    data: TrainingData,
    folder: Path,
    options: Mapping[str, Any],
    say: Callable[[str], None],
) -> None:
    """Train a model into a folder, with pictures; see :meth:`learned.training.fitting.Fitting.into`.

    Parameters
    ----------
    name
        Name of the configuration.
    seed
        Seed of the weights and of the order of pairs.
    data
        Training data.
    folder
        Folder of the model.
    options
        Fields of :class:`learned.paired.schedule.Schedule` and of :class:`learned.training.machine.Machine`.
    say
        Called with each progress message.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or the folder holds a finished model of another training.
    TrainingError
        If training cannot continue.
    """
    chosen, plan, machine = checked_options(name, options)

    def train(run: TrainingRun) -> Trained[nn.Module]:
        run.say(f"gathering {data.n_pairs} pairs at {plan.resolution} x {plan.resolution}")
        pairs = gather_kept(data, plan.resolution, chosen.crop, run.folder, run.say)
        unseen = gather(data.unseen(), plan.resolution, chosen.crop)
        trained = training.train(chosen, plan, pairs, unseen, run)
        as_stored(trained.network.to("cpu").eval())
        title = f"{name}, seed {seed}, {data.name}"
        pictures.draw_history(trained.progress.history, run.folder / "history.png", title)
        final = {
            kind: _looked_at(trained.network, of_kind, run.folder / f"samples-{kind}.png", f"{title}: {kind} pairs")
            for kind, of_kind in (("training", pairs), ("unseen", unseen))
        }
        return replace(trained, details=_card_details(chosen, plan, trained) | {"final": final})

    fitting = Fitting(
        kind="configuration",
        name=name,
        described=chosen.described(),
        plan=plan,
        planned="schedule",
        words=plan.in_words(),
        training_data=data,
        seed=seed,
        train=train,
        load=load_model,
    )
    fitting.into(folder, machine, say)
    forget(folder)


def _looked_at(network: nn.Module, pairs: Pairs, picture: Path, title: str) -> dict[str, float | None]:
    """Draw some predictions of the finished network, and return their measures."""
    rows = np.linspace(0, len(pairs) - 1, min(SAMPLES, len(pairs))).round().astype(int)
    images, targets = pairs.images[rows], pairs.targets[pairs.target_of[rows]]
    predictions = torch.stack([predict(network, image) for image in images])
    names = [pairs.identifiers[row] for row in rows]
    pictures.draw_samples(names, images, predictions, targets, picture, title)
    # Masks that do not overlap have no depth error: null in JSON.
    return {name: value if isfinite(value) else None for name, value in measures(predictions, targets).items()}


def _card_details(chosen: Configuration, plan: Schedule, trained: Trained[nn.Module]) -> dict[str, Any]:
    """Return the card entries that are specific to these networks; see :mod:`learned.paired.card`."""
    progress = trained.progress
    images = trained.seen["pairs"] * plan.epochs / progress.seconds if progress.seconds else 0.0
    settings = {name: value for name, value in asdict(plan).items() if name != "compile"}
    return {
        "extra_data": chosen.extra_data,
        "schedule": settings | {"early_epochs": plan.n_early, "batch_at_the_end": progress.batch},
        "departures_from_the_paper": plan.non_default_settings(),
        "images_per_second": round(images, 1),
        "final_losses": dict(progress.history[-1]),
    }
