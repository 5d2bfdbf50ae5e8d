"""Training of a network of images on a stream of fresh bodies, into a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmark.api.learning import TrainingData
from benchmark.errors import ConfigurationError
from learned.streamed.configuration import Streamed, streamed
from learned.streamed.model import load_streamed
from learned.streamed.network import StreamedNetwork
from learned.streamed.training import train_streamed
from learned.training.fitting import Fitting, defaults_of, plan_among, stream_of
from learned.training.loop import Plan, Trained, TrainingRun
from learned.training.machine import MachineWithWorkers


def checked_plan(name: str, options: Mapping[str, Any]) -> tuple[Streamed, Plan, MachineWithWorkers]:
    """Return the configuration of this name, and the plan and machine that the options describe.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or the device is not available.
    """
    chosen = streamed(name)
    if "resolution" in options and str(options["resolution"]) != str(chosen.resolution):
        raise ConfigurationError(
            f"network '{chosen.name}' has resolution {chosen.resolution}", "leave --resolution out"
        )
    others = {name: value for name, value in options.items() if name != "resolution"}
    return chosen, *plan_among(Plan, others)


def fit(
    name: str,
    seed: int,
    data: TrainingData,
    folder: Path,
    options: Mapping[str, Any],
    say: Callable[[str], None],
) -> None:
    """Train a model into a folder; see :meth:`learned.training.fitting.Fitting.into`.

    Parameters
    ----------
    name
        Name of the configuration.
    seed
        Seed of the weights.
    data
        A stream of fresh bodies.
    folder
        Folder of the model.
    options
        Fields of :class:`learned.training.loop.Plan` and of :class:`learned.training.machine.MachineWithWorkers`.
    say
        Called with each progress message.

    Raises
    ------
    ConfigurationError
        If an option does not fit, the data is not a stream, or the folder holds a finished model of another training.
    TrainingError
        If training cannot continue.
    """
    chosen, plan, machine = checked_plan(name, options)
    stream = stream_of(data)
    if chosen.stream == "wide":
        if stream.wide is None:
            raise ConfigurationError(f"training '{data.name}' has no wide stream", "take another configuration")
        stream = stream.wide

    def train(run: TrainingRun) -> Trained[StreamedNetwork]:
        return train_streamed(chosen, plan, stream.fresh, stream.validation, run)

    fitting = Fitting(
        kind="streamed",
        name=name,
        described=chosen.described(),
        plan=plan,
        words=in_words(chosen, plan),
        training_data=stream,
        seed=seed,
        train=train,
        load=load_streamed,
        defaults=defaults_of(chosen),
    )
    fitting.into(folder, machine, say)


def in_words(chosen: Streamed, plan: Plan) -> str:
    """Describe network and plan in one clause."""
    size = f"{chosen.resolution} x {chosen.resolution} pixels"
    return f"'{chosen.name}', {size}, {plan.steps} steps of {plan.bodies} fresh bodies"
