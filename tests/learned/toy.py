"""Depth images in closed form, and a training that takes a second."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.learning import CARD, WEIGHTS, TrainingData, TrainingPair, digest_of
from benchmark.geometry.depth import SIZE
from learned.models import Configuration

TINY = Configuration(name="tiny", width=8)
"""The paper's network, half as wide, which trains within seconds."""

OPTIONS: Mapping[str, Any] = {
    "resolution": 32,
    "epochs": 30,
    "early_epochs": 5,
    "batch": 2,
    "learning_rate": 3e-3,
    "precision": "float32",
    "device": "cpu",
    "threads": 1,
}
"""Of a training that changes the weight of the depth on the way."""

BUILDS = {"slim": (0.3, 0.7), "round": (0.6, 0.6), "wide": (0.75, 0.35)}
BENDS = (0.0, 0.15)

Image = NDArray[np.float32]


def ellipsoid(
    width: float = 0.6,
    height: float = 0.6,
    *,
    x: float = 0.0,
    y: float = 0.0,
    thickness: float = 0.3,
) -> Image:
    """Front of an ellipsoid; lengths are shares of the half width of the frame, depths of the whole
    depth.
    """
    offsets = (np.arange(SIZE) + 0.5) * 2 / SIZE - 1
    squared = ((offsets - x) / width) ** 2 + ((-offsets[:, None] - y) / height) ** 2
    front = 0.5 + thickness * np.sqrt(np.maximum(1 - squared, 0))
    return np.asarray(np.where(squared < 1, front, 0), dtype=np.float32)


def person() -> Image:
    """A head, a trunk, two arms and two legs."""
    parts = [
        ellipsoid(0.12, 0.15, y=0.7, thickness=0.12),
        ellipsoid(0.2, 0.4, y=0.2, thickness=0.15),
    ]
    for side in (-1, 1):
        parts.append(ellipsoid(0.35, 0.07, x=0.45 * side, y=0.4, thickness=0.07))
        parts.append(ellipsoid(0.09, 0.45, x=0.13 * side, y=-0.45, thickness=0.09))
    return np.asarray(np.max(parts, axis=0))


def toy_pairs(builds: Mapping[str, tuple[float, float]]) -> Iterator[TrainingPair]:
    """Ellipsoids that are out of place, and the same in the centre."""
    for subject, (width, height) in builds.items():
        target = ellipsoid(width, height)
        for bend in BENDS:
            yield TrainingPair(
                identifier=f"{subject}-{bend}",
                subject=subject,
                target_identifier=f"{subject}-{BENDS[0]}",
                image=ellipsoid(width, height, x=bend, y=-bend),
                target=target,
            )


def toy_data() -> TrainingData:
    """Six pairs of three subjects, and two of a fourth that is never trained on."""
    return TrainingData(
        name="toy-I",
        title="ellipsoids (stand-in for nothing)",
        subjects=tuple(BUILDS),
        identifiers=tuple(f"{subject}-{bend}" for subject in BUILDS for bend in BENDS),
        tested=digest_of(["plump"]),
        pairs=lambda: toy_pairs(BUILDS),
        n_pairs=len(BUILDS) * len(BENDS),
        validation=lambda: toy_pairs({"plump": (0.5, 0.4)}),
        n_validation=len(BENDS),
    )


def quiet(_: str) -> None:
    """Listen to no progress."""


def files(folder: Path) -> set[str]:
    """Names in a folder."""
    return {path.name for path in folder.iterdir()}


def edit_card(folder: Path, edit: Callable[[dict[str, Any]], object]) -> None:
    """Change the card of a model."""
    card = json.loads((folder / CARD).read_text())
    edit(card)
    (folder / CARD).write_text(json.dumps(card))


def replace_weights(folder: Path, content: bytes) -> None:
    """Put other weights into a folder whose card names their digest."""
    (folder / WEIGHTS).write_bytes(content)
    edit_card(folder, lambda card: card.update(digest=hashlib.sha256(content).hexdigest()))
