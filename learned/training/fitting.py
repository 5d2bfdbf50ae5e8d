"""Training of any network, from training data to a folder with a finished model."""

from __future__ import annotations

import csv
import datetime
import hashlib
import io
import json
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch

from benchmark.api.learning import CARD, WEIGHTS, TrainingData, read_card
from benchmark.api.parameters import checked
from benchmark.api.streaming import StreamedData
from benchmark.errors import ConfigurationError
from learned.training.checkpoint import CHECKPOINT, write
from learned.training.loop import N, Plan, Trained, TrainingRun
from learned.training.machine import Machine, MachineWithWorkers, device_named, machine_among
from learned.weights import as_stored, n_parameters, stored

HISTORY = "history.csv"

P = TypeVar("P", bound=Plan)


def plan_among(kind: type[P], options: Mapping[str, Any]) -> tuple[P, MachineWithWorkers]:
    """Return the plan and machine that the options of a training on a stream describe.

    Parameters
    ----------
    kind
        ``Plan`` or a subclass.
    options
        Options as given by the user.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or the device is not available.
    """
    for known, instead in (("epochs", "-o steps=N: no body is seen twice"), ("batch", "-o bodies=N")):
        if known in options:
            raise ConfigurationError(f"a training over a stream has no {known}", f"pass {instead}")
    machine, planned = machine_among(MachineWithWorkers, options)
    return kind(**checked(kind, planned, "the plan")), machine


def stream_of(data: TrainingData) -> StreamedData:
    """Return the data if it is a stream, or raise ``ConfigurationError``."""
    if not isinstance(data, StreamedData):
        raise ConfigurationError(f"training '{data.name}' is no stream of fresh bodies", "take --only humans-varied")
    return data


@dataclass(frozen=True, kw_only=True)
class Fitting(Generic[N]):
    """Training of a model into a folder.

    Parameters
    ----------
    kind
        Key of the configuration on the card.
    name
        Name of the configuration.
    described
        All fields of the configuration.
    plan
        Training plan.
    words
        Network and plan in one clause.
    training_data
        Training data.
    seed
        Seed of the weights.
    train
        Trains, resuming from the checkpoint in the folder.
    load
        Loads the finished model, and raises ``ConfigurationError`` if it cannot be used.
    defaults
        Defaults of fields of the configuration that the card of an older model may lack.
    planned
        Key of the plan on the card.
    """

    kind: str
    name: str
    described: Mapping[str, Any]
    plan: Any
    words: str
    training_data: TrainingData
    seed: int
    train: Callable[[TrainingRun], Trained[N]]
    load: Callable[[Path], object]
    defaults: Mapping[str, Any] = field(default_factory=dict)
    planned: str = "plan"

    @property
    def recipe(self) -> dict[str, Any]:
        """Everything that determines the result."""
        return {
            "configuration": dict(self.described),
            self.planned: asdict(self.plan),
            "data": self.training_data.digest,
            "seed": self.seed,
        }

    def into(self, folder: Path, machine: Machine, say: Callable[[str], None]) -> None:
        """Train a model into a folder, resuming an interrupted training; a finished model is left alone.

        Parameters
        ----------
        folder
            Folder of the model.
        machine
            Machine of the training.
        say
            Called with each progress message.

        Raises
        ------
        ConfigurationError
            If the folder holds a finished model of another training.
        TrainingError
            If training cannot continue.
        """
        recipe = self.recipe
        if (folder / CARD).is_file():
            self._check_finished(folder)
            say(f"{folder} holds this model already")
            return
        torch.set_num_threads(machine.cores)
        folder.mkdir(parents=True, exist_ok=True)
        say(f"training '{self.name}', seed {self.seed}: {self.words}; {self.training_data.title}")
        device = device_named(machine.device)
        trained = self.train(
            TrainingRun(folder=folder, recipe=recipe, seed=self.seed, device=device, workers=machine.workers, say=say)
        )
        card = self._saved(folder, trained, hardware(device.type))
        self.load(folder)
        (folder / CHECKPOINT).unlink(missing_ok=True)
        seen = ", ".join(f"{number} {name.replace('_', ' ')}" for name, number in trained.seen.items())
        say(f"finished in {card['seconds']:.0f} s; {seen}")

    def _check_finished(self, folder: Path) -> None:
        """Raise ``ConfigurationError`` unless the finished model in a folder came from this recipe."""
        card = read_card(folder)
        recipe = dict(card.get("recipe", {}))
        # An older card may lack fields that have a default.
        for part, defaults in (("configuration", self.defaults), (self.planned, defaults_of(self.plan))):
            if part in recipe:
                recipe[part] = {**defaults, **recipe[part]}
        if recipe != self.recipe:
            raise ConfigurationError(
                f"{folder} holds a finished model of another training ({card.get('schedule_in_words', 'unknown')}), "
                f"not of {self.words}",
                "delete the folder to train anew, or name other --results",
            )

    def _saved(self, folder: Path, trained: Trained[N], hardware: str) -> dict[str, Any]:
        """Write the weights, rounded as they are stored, the history and, last, the card; return the card."""
        network, progress, data = trained.network.to("cpu").eval(), trained.progress, self.training_data
        as_stored(network)
        weights = stored(network)
        card = {
            "digest": hashlib.sha256(weights).hexdigest(),
            self.kind: dict(self.described),
            "parameters": n_parameters(network),
            "data": data.name,
            "data_title": data.title,
            "data_digest": data.digest,
            **trained.seen,
            "subjects": list(data.subjects),
            "identifiers": list(data.identifiers),
            "clearance": dict(data.clearance),
            "extra_data": True,
            "seed": self.seed,
            self.planned: asdict(self.plan),
            "schedule_in_words": f"{self.words}, {hardware}",
            "hardware": hardware,
            "precision": trained.precision,
            "weights_stored_as": "float16",
            "torch": torch.__version__,
            "seconds": round(progress.seconds, 1),
            "final": dict(progress.history[-1]),
            "recipe": self.recipe,
            "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            **trained.details,
        }
        write(folder / WEIGHTS, weights)
        write(folder / HISTORY, _table(progress.history).encode())
        # Written last, because its presence means a finished model.
        write(folder / CARD, _card_text(card).encode())
        return card


def defaults_of(described: Any) -> dict[str, Any]:
    """Return the defaults of the fields of a dataclass, by name."""
    return {entry.name: entry.default for entry in fields(described) if entry.default is not MISSING}


def hardware(device: str) -> str:
    """Describe the hardware in words."""
    if device == "cuda":
        return str(torch.cuda.get_device_name())
    threads = torch.get_num_threads()
    return f"{_processor()}, {threads} thread{'s' if threads > 1 else ''}"


def _card_text(card: Mapping[str, Any]) -> str:
    """Return JSON with one line per entry, so that long lists of shapes stay on one line."""
    lines = (f" {json.dumps(name)}: {json.dumps(value)}" for name, value in card.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _table(history: Sequence[Mapping[str, float]]) -> str:
    columns = list(dict.fromkeys(name for row in history for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in history)
    return text.getvalue()
