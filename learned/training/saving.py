"""A finished model on disk, whatever trained it: its files, and whether they are those that were asked for."""

from __future__ import annotations

import csv
import io
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import torch

from benchmark.api.learning import CARD, WEIGHTS, read_card
from benchmark.errors import ConfigurationError
from learned.training.checkpoint import write

HISTORY = "history.csv"


def write_model(folder: Path, weights: bytes, history: Sequence[Mapping[str, float]], card: Mapping[str, Any]) -> None:
    """Write the files of a model, the card last: its presence means a finished model."""
    write(folder / WEIGHTS, weights)
    write(folder / HISTORY, _table(history).encode())
    write(folder / CARD, _card_text(card).encode())


def check_finished(
    folder: Path, recipe: Mapping[str, Any], wanted: str, defaults: Mapping[str, Mapping[str, Any]] | None = None
) -> None:
    """Raise ``ConfigurationError`` unless the finished model in a folder came from this recipe.

    Parameters
    ----------
    folder
        Folder of the model.
    recipe
        Everything that determines the result.
    wanted
        The training that was asked for, in words.
    defaults
        Entries of parts of the recipe, by name of the part, that an older card may lack.
    """
    card = read_card(folder)
    found = dict(card.get("recipe", {}))
    found |= {part: {**entries, **found[part]} for part, entries in (defaults or {}).items() if part in found}
    if found != recipe:
        raise ConfigurationError(
            f"{folder} holds a finished model of another training ({card.get('schedule_in_words', 'unknown')}), "
            f"not of {wanted}",
            "delete the folder to train anew, or name other --results",
        )


def defaults_of(described: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that have a default, with it, by name."""
    return {entry.name: entry.default for entry in fields(described) if entry.default is not MISSING}


def hardware(device: str) -> str:
    """Return what computes, in words."""
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
