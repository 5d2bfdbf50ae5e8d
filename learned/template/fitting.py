"""From some bodies of a stream to a folder with a finished model."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmark.api.learning import TrainingData
from benchmark.errors import ConfigurationError
from benchmark.parameters.values import checked
from learned.template.configuration import Template, template
from learned.template.model import load_template
from learned.template.network import TemplateNetwork
from learned.template.samples import SAMPLES, TOGETHER, collected
from learned.template.training import TemplatePlan, train_template
from learned.training.fitting import Fitting, stream_of
from learned.training.loop import Trained, TrainingRun
from learned.training.machine import Machine, machine_among


def checked_plan(name: str, options: Mapping[str, Any]) -> tuple[Template, TemplatePlan, Machine]:
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
    return chosen, TemplatePlan(**checked(TemplatePlan, others, "the plan")), machine


def fit(
    name: str,
    seed: int,
    data: TrainingData,
    folder: Path,
    options: Mapping[str, Any],
    say: Callable[[str], None],
) -> None:
    """Train a model into a folder, without the codes; see :meth:`learned.training.fitting.Fitting.into`.

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
        Fields of :class:`learned.template.training.TemplatePlan` and of :class:`learned.training.machine.Machine`.
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
    stream = stream_of(data)

    def train(run: TrainingRun) -> Trained[TemplateNetwork]:
        shapes = collected(stream.surfaces, chosen.bodies, run.folder, stream.digest, run.say)
        validation = collected(stream.validation_surfaces, TOGETHER, None, stream.digest, run.say)
        return train_template(chosen, plan, shapes, validation, run)

    fitting = Fitting(
        kind="template",
        name=name,
        described=chosen.described(),
        plan=plan,
        words=f"'{chosen.name}', {chosen.bodies} bodies, {plan.steps} steps of {plan.bodies} shapes",
        training_data=stream,
        seed=seed,
        train=train,
        load=load_template,
    )
    fitting.into(folder, machine, say)
    if (folder / SAMPLES).is_dir():
        shutil.rmtree(folder / SAMPLES)
