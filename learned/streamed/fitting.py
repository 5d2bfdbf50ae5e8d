"""From a stream of fresh bodies to a folder with a finished model."""

from __future__ import annotations

import datetime
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import torch

from benchmark.contracts import Interval
from benchmark.errors import ConfigurationError
from benchmark.learning import CARD, TrainingData
from benchmark.parameters.values import checked
from benchmark.streaming import StreamedData
from benchmark.threads import available_cores
from learned.arithmetic import device_named
from learned.checkpoint import CHECKPOINT
from learned.machine import Machine, machine_among
from learned.saving import check_finished, hardware, write_model
from learned.steps import Plan, drawn_again
from learned.streamed.configuration import Streamed, streamed
from learned.streamed.model import load_streamed
from learned.streamed.training import Trained, train_streamed
from learned.weights import as_stored, n_parameters, stored


@dataclass(frozen=True, kw_only=True)
class MachineWithWorkers(Machine):
    """A machine on which processes of their own make bodies.

    Parameters
    ----------
    workers
        How many; 0 makes the bodies between the steps.
    """

    workers: Annotated[int, Interval(0, 64)] = 1


def checked_plan(name: str, options: Mapping[str, Any]) -> tuple[Streamed, Plan, MachineWithWorkers]:
    """The configuration of a name, its plan and the machine with options.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or there is no such device here.
    """
    chosen = streamed(name)
    for known, instead in (("epochs", "-o steps=N: no body is seen twice"), ("batch", "-o bodies=N")):
        if known in options:
            raise ConfigurationError(f"a streamed network has no {known}", f"pass {instead}")
    if "resolution" in options and str(options["resolution"]) != str(chosen.resolution):
        raise ConfigurationError(
            f"network '{chosen.name}' has resolution {chosen.resolution}", "leave --resolution out"
        )
    machine, others = machine_among(MachineWithWorkers, options)
    planned = {name: value for name, value in others.items() if name != "resolution"}
    plan = Plan(**checked(Plan, planned, "the plan"))
    return chosen, plan, machine


def recipe_of(chosen: Streamed, plan: Plan, data: TrainingData, seed: int) -> dict[str, Any]:
    """Everything that determines the result."""
    return {
        "configuration": chosen.described(),
        "plan": asdict(plan),
        "data": data.digest,
        "seed": seed,
    }


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
        Seed of the weights.
    data
        A stream.
    folder
        Where the model goes.
    options
        Fields of :class:`learned.steps.Plan` and of :class:`MachineWithWorkers`.
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
    recipe = recipe_of(chosen, plan, data, seed)
    if (folder / CARD).is_file():
        check_finished(folder, recipe, in_words(chosen, plan))
        say(f"{folder} holds this model already")
        return
    torch.set_num_threads(machine.threads or max(1, available_cores() - machine.workers))
    folder.mkdir(parents=True, exist_ok=True)
    say(f"training '{name}', seed {seed}: {in_words(chosen, plan)}; {data.title}")
    device = device_named(machine.device)
    trained = train_streamed(
        chosen, plan, data.fresh, data.validation, folder, recipe,
        seed=seed, device=device, workers=machine.workers, say=say,
    )  # fmt: skip
    card = saved(folder, trained, data, chosen, plan, seed=seed, recipe=recipe)
    load_streamed(folder)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    say(f"finished in {card['seconds']:.0f} s; {card['drawn_again']} bodies and poses were drawn again")


def saved(
    folder: Path,
    trained: Trained,
    data: TrainingData,
    chosen: Streamed,
    plan: Plan,
    *,
    seed: int,
    recipe: Mapping[str, Any],
) -> dict[str, Any]:
    """Write weights, history and, last, the card.

    Parameters
    ----------
    folder
        Where they go.
    trained
        The network; its weights are rounded to what is stored.
    data, chosen, plan, seed, recipe
        What made it.

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
        "streamed": chosen.described(),
        "parameters": n_parameters(network),
        "data": data.name,
        "data_title": data.title,
        "data_digest": data.digest,
        "bodies": plan.steps * plan.bodies,
        "drawn_again": drawn_again(progress.history),
        "subjects": list(data.subjects),
        "identifiers": list(data.identifiers),
        "extra_data": True,
        "seed": seed,
        "plan": asdict(plan),
        "schedule_in_words": f"{in_words(chosen, plan)}, {hardware(trained.device)}",
        "precision": trained.precision,
        "weights_stored_as": "float16",
        "torch": torch.__version__,
        "seconds": round(progress.seconds, 1),
        "final": dict(progress.history[-1]),
        "recipe": dict(recipe),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    write_model(folder, weights, progress.history, card)
    return card


def in_words(chosen: Streamed, plan: Plan) -> str:
    """Network and plan in one clause."""
    size = f"{chosen.resolution} x {chosen.resolution} pixels"
    return f"'{chosen.name}', {size}, {plan.steps} steps of {plan.bodies} fresh bodies"
