"""A trained network becomes files: weights, a history, and a card that says where they come from."""

from __future__ import annotations

import datetime
import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from benchmark.api.learning import TrainingData
from learned.paired.configuration import Configuration
from learned.paired.schedule import Schedule
from learned.paired.training import Result
from learned.training.saving import hardware, write_model
from learned.weights import n_parameters, stored


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
        "departures_from_the_paper": plan.non_default_settings(),
        "schedule_in_words": f"{plan.in_words()}, {hardware(result.device)}",
        "hardware": hardware(result.device),
        "precision": result.precision,
        "weights_stored_as": "float16",
        "torch": torch.__version__,
        "seconds": round(progress.seconds, 1),
        "images_per_second": round(images, 1),
        "final_losses": _strict(progress.history[-1]),
        "final": {name: _strict(values) for name, values in final.items()},
        "recipe": dict(recipe),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    write_model(folder, weights, progress.history, card)
    return card


def _strict(values: Mapping[str, float]) -> dict[str, float | None]:
    """Numbers as JSON has them: None for what is none, such as the error of masks that do not overlap."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}
