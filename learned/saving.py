"""A trained network becomes files: weights, a history, and a card that says where they come from."""

from __future__ import annotations

import csv
import datetime
import hashlib
import io
import json
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from benchmark.errors import ConfigurationError
from benchmark.learning import CARD, WEIGHTS, TrainingData, read_card
from learned.checkpoint import write
from learned.configuration import Configuration
from learned.network import n_parameters
from learned.schedule import Schedule
from learned.training import Result
from learned.weights import stored

HISTORY = "history.csv"


def save_model(
    folder: Path,
    result: Result,
    data: TrainingData,
    configuration: Configuration,
    plan: Schedule,
    *,
    seed: int,
    n_pairs: int,
    final: Mapping[str, Mapping[str, float]],
    recipe: Mapping[str, Any],
) -> dict[str, Any]:
    """Write weights, history and, last, the card.

    Parameters
    ----------
    folder
        Where they go.
    result
        The trained network.
    data, configuration, plan, seed
        What made it.
    n_pairs
        Pairs that were trained on.
    final
        Measures of the finished model on ``"training"`` and ``"unseen"`` pairs.
    recipe
        Everything that determines the result.

    Returns
    -------
    dict
        The card.
    """
    weights = stored(result.network)
    progress = result.progress
    images = n_pairs * plan.epochs / progress.seconds if progress.seconds else 0.0
    card = {
        "digest": hashlib.sha256(weights).hexdigest(),
        "configuration": configuration.described(),
        "parameters": n_parameters(result.network),
        "data": data.name,
        "data_title": data.title,
        "data_digest": data.digest,
        "pairs": n_pairs,
        "subjects": list(data.subjects),
        "identifiers": list(data.identifiers),
        "extra_data": configuration.extra_data,
        "seed": seed,
        "schedule": {
            name: getattr(plan, name)
            for name in Schedule.__dataclass_fields__
            if name not in ("compile", "early_epochs")
        }
        | {"early_epochs": plan.n_early, "batch_at_the_end": progress.batch},
        "departures_from_the_paper": plan.departures(),
        "schedule_in_words": f"{plan.in_words()}, {hardware(result.device)}",
        "hardware": hardware(result.device),
        "precision": result.precision,
        "weights_stored_as": "float16",
        "torch": torch.__version__,
        "seconds": round(progress.seconds, 1),
        "images_per_second": round(images, 1),
        "final_losses": dict(progress.history[-1]),
        "final": {name: dict(values) for name, values in final.items()},
        "recipe": dict(recipe),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    write_model(folder, weights, progress.history, card)
    return card


def write_model(folder: Path, weights: bytes, history: Sequence[Mapping[str, float]], card: Mapping[str, Any]) -> None:
    """Write the files of a model, the card last: its presence means a finished model."""
    write(folder / WEIGHTS, weights)
    write(folder / HISTORY, _table(history).encode())
    write(folder / CARD, _card_text(card).encode())


def check_finished(folder: Path, recipe: Mapping[str, Any], wanted: str) -> None:
    """Raise ``ConfigurationError`` unless the finished model in a folder came from this recipe.

    Parameters
    ----------
    folder
        Folder of the model.
    recipe
        Everything that determines the result.
    wanted
        The training that was asked for, in words.
    """
    card = read_card(folder)
    if card.get("recipe") != recipe:
        raise ConfigurationError(
            f"{folder} holds a finished model of another training ({card.get('schedule_in_words', 'unknown')}), "
            f"not of {wanted}",
            "delete the folder to train anew, or name other --results",
        )


def hardware(device: str) -> str:
    """What computes, in words."""
    if device == "cuda":
        return str(torch.cuda.get_device_name())
    threads = torch.get_num_threads()
    return f"{_processor()}, {threads} thread{'s' if threads > 1 else ''}"


def _card_text(card: Mapping[str, Any]) -> str:
    """JSON with one line for each entry: long lists of shapes stay on one line."""
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
