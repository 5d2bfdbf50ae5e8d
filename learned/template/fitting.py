"""From some bodies of a stream to a folder with a finished model."""

from __future__ import annotations

import datetime
import hashlib
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from benchmark.errors import ConfigurationError
from benchmark.learning import CARD, TrainingData
from benchmark.parameters.values import checked
from benchmark.streaming import StreamedData
from benchmark.threads import available_cores
from learned.arithmetic import device_named
from learned.checkpoint import CHECKPOINT
from learned.machine import Machine, machine_among
from learned.saving import check_finished, hardware, write_model
from learned.steps import Plan
from learned.template.configuration import Template, template
from learned.template.model import load_template
from learned.template.samples import SAMPLES, TOGETHER, collected
from learned.template.training import Trained, train_template
from learned.weights import as_stored, n_parameters, stored

DEFAULTS: Mapping[str, Any] = {"steps": 20_000, "bodies": 8, "learning_rate": 5e-4, "precision": "float32"}
"""What differs from the defaults of :class:`learned.steps.Plan`; ``bodies`` are the shapes of a step."""


def checked_plan(name: str, options: Mapping[str, Any]) -> tuple[Template, Plan, Machine]:
    """The configuration of a name, its plan and the machine with options.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or there is no such device here.
    """
    chosen = template(name)
    if "epochs" in options:
        raise ConfigurationError("a template has no epochs", "pass -o steps=N")
    if options.get("precision", "float32") != "float32":
        raise ConfigurationError("distances need more digits than bfloat16 has", "leave precision out")
    machine, others = machine_among(Machine, options)
    return chosen, Plan(**{**DEFAULTS, **checked(Plan, others, "the plan")}), machine


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
        Seed of the weights, the first codes and the points.
    data
        A stream, whose first bodies are trained on.
    folder
        Where the model goes.
    options
        Fields of :class:`learned.steps.Plan` and of :class:`learned.machine.Machine`.
    say
        Told about progress.

    Raises
    ------
    ConfigurationError
        If an option does not fit, the data is no stream, or the folder holds a finished model of another training.
    TrainingError
        If training cannot go on.
    """
    chosen, plan, machine = checked_plan(name, options)
    if not isinstance(data, StreamedData):
        raise ConfigurationError(f"training '{data.name}' is no stream of fresh bodies", "take --only humans-varied")
    recipe = {"template": chosen.described(), "plan": asdict(plan), "data": data.digest, "seed": seed}
    if (folder / CARD).is_file():
        check_finished(folder, recipe, in_words(chosen, plan))
        say(f"{folder} holds this model already")
        return
    torch.set_num_threads(machine.threads or available_cores())
    folder.mkdir(parents=True, exist_ok=True)
    say(f"training '{name}', seed {seed}: {in_words(chosen, plan)}; {data.title}")
    shapes = collected(data.surfaces, chosen.bodies, folder, data.digest, say)
    validation = collected(data.validation_surfaces, TOGETHER, None, data.digest, say)
    trained = train_template(
        chosen, plan, shapes, validation, folder, recipe, seed=seed, device=device_named(machine.device), say=say
    )
    card = saved(folder, trained, data, chosen, plan, n_shapes=len(shapes), seed=seed, recipe=recipe)
    load_template(folder)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    shutil.rmtree(folder / SAMPLES)
    say(f"finished in {card['seconds']:.0f} s")


def saved(
    folder: Path,
    trained: Trained,
    data: TrainingData,
    chosen: Template,
    plan: Plan,
    *,
    n_shapes: int,
    seed: int,
    recipe: Mapping[str, Any],
) -> dict[str, Any]:
    """Write weights, history and, last, the card; the codes of the shapes are not kept.

    Parameters
    ----------
    folder
        Where they go.
    trained
        The fields; their weights are rounded to what is stored.
    data, chosen, plan, n_shapes, seed, recipe
        What made them.

    Returns
    -------
    dict
        The card.
    """
    network, progress = trained.network.to("cpu").eval(), trained.progress
    as_stored(network)
    weights = stored(network)
    card = {
        "digest": hashlib.sha256(weights).hexdigest(),
        "template": chosen.described(),
        "parameters": n_parameters(network),
        "data": data.name,
        "data_title": data.title,
        "data_digest": data.digest,
        "bodies": chosen.bodies,
        "shapes": n_shapes,
        "subjects": list(data.subjects),
        "identifiers": list(data.identifiers),
        "extra_data": True,
        "seed": seed,
        "plan": asdict(plan),
        "schedule_in_words": f"{in_words(chosen, plan)}, {hardware(trained.device)}",
        "weights_stored_as": "float16",
        "torch": torch.__version__,
        "seconds": round(progress.seconds, 1),
        "final": dict(progress.history[-1]),
        "recipe": dict(recipe),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    write_model(folder, weights, progress.history, card)
    return card


def in_words(chosen: Template, plan: Plan) -> str:
    """Configuration and plan in one clause."""
    return f"'{chosen.name}', {chosen.bodies} bodies, {plan.steps} steps of {plan.bodies} shapes"
