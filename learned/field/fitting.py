"""Training of a deformation field on a stream of fresh bodies, into a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmark.api.learning import TrainingData
from benchmark.api.streaming import ScannedData, StreamedAndScannedData, StreamedData
from benchmark.errors import ConfigurationError
from learned.field.configuration import Field, field_named
from learned.field.model import load_field
from learned.field.network import FieldNetwork
from learned.field.training import FieldPlan, train_field
from learned.training.fitting import Fitting, plan_among, stream_of
from learned.training.loop import Trained, TrainingRun
from learned.training.machine import MachineWithWorkers


def checked_plan(name: str, options: Mapping[str, Any]) -> tuple[Field, FieldPlan, MachineWithWorkers]:
    """Return the configuration of this name, and the plan and machine that the options describe.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or the device is not available.
    """
    chosen = field_named(name)
    if "resolution" in options:
        raise ConfigurationError("a deformation field sees points, no pixels", "leave --resolution out")
    return chosen, *plan_among(FieldPlan, options)


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
        Fields of :class:`learned.field.training.FieldPlan` and of :class:`learned.training.machine.MachineWithWorkers`.
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
    stream = _stream_for(plan, data)

    def train(run: TrainingRun) -> Trained[FieldNetwork]:
        if isinstance(stream, ScannedData):
            return train_field(chosen, plan, stream.scans, stream.validation, run)
        return train_field(chosen, plan, stream.surfaces, stream.validation_surfaces, run)

    fitting = Fitting(
        kind="field",
        name=name,
        described=chosen.described(),
        plan=plan,
        words=_in_words(chosen, plan),
        training_data=stream,
        seed=seed,
        train=train,
        load=load_field,
    )
    fitting.into(folder, machine, say)


def _stream_for(plan: FieldPlan, data: TrainingData) -> StreamedData | ScannedData:
    """Return the stream that a plan trains on, or raise ``ConfigurationError`` if the data has none."""
    stream = stream_of(data)
    if plan.shapes == "bodies":
        return stream
    if not isinstance(stream, StreamedAndScannedData):
        raise ConfigurationError(f"training '{data.name}' has no scans", "pass -o shapes=bodies")
    return stream.scanned


def _in_words(chosen: Field, plan: FieldPlan) -> str:
    """Describe network and plan in one clause."""
    shown = "fresh bodies" if plan.shapes == "bodies" else f"scanned bodies, each scan {plan.uses} times"
    begun = "" if plan.start == "random" else ", from the shipped weights"
    return f"field '{chosen.name}', {chosen.points} points, {plan.steps} steps of {plan.bodies} {shown}{begun}"
