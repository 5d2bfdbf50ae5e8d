"""Depth images in closed form, and a training that takes a second."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmark.api.learning import TrainingData, TrainingPair
from benchmark.geometry.depth import SIZE
from learned.paired.configuration import LITERAL
from learned.training.loop import TrainingRun
from tests.baselines.deformable import moved_to

TINY = replace(LITERAL, name="tiny", width=8)
"""The paper's network, half as wide, which trains within seconds."""

OPTIONS: Mapping[str, Any] = {
    "resolution": 32,
    "epochs": 30,
    "early_epochs": 5,
    "batch": 2,
    "jitter": 20,
    "learning_rate": 3e-3,
    "precision": "float32",
    "device": "cpu",
    "threads": 1,
}
"""Of a training that shifts its inputs and changes the weight of the depth on the way."""

BUILDS = {"slim": (0.3, 0.7), "round": (0.6, 0.6), "wide": (0.75, 0.35)}
BENDS = (0.0, 0.15)

Image = NDArray[np.float32]


def ellipsoid(
    width: float = 0.6, height: float = 0.6, *, x: float = 0.0, y: float = 0.0, thickness: float = 0.3, size: int = SIZE
) -> Image:
    """Front of an ellipsoid; lengths are shares of the half width of the frame, depths of the whole depth."""
    offsets = (np.arange(size) + 0.5) * 2 / size - 1
    squared = ((offsets - x) / width) ** 2 + ((-offsets[:, None] - y) / height) ** 2
    front = 0.5 + thickness * np.sqrt(np.maximum(1 - squared, 0))
    return np.asarray(np.where(squared < 1, front, 0), dtype=np.float32)


def person() -> Image:
    """A head, a trunk, two arms and two legs."""
    parts = [ellipsoid(0.12, 0.15, y=0.7, thickness=0.12), ellipsoid(0.2, 0.4, y=0.2, thickness=0.15)]
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
        digest="ellipsoids 1",
        subjects=tuple(BUILDS),
        identifiers=tuple(f"{subject}-{bend}" for subject in BUILDS for bend in BENDS),
        n_pairs=len(BUILDS) * len(BENDS),
        pairs=lambda start=0: itertools.islice(toy_pairs(BUILDS), start, None),
        unseen=lambda start=0: itertools.islice(toy_pairs({"plump": (0.5, 0.4)}), start, None),
    )


def quiet(_: str) -> None:
    """Listen to no progress."""


def run_in(folder: Path, seed: int = 0, say: Callable[[str], None] = quiet) -> TrainingRun:
    """Return a run whose checkpoints go into a folder."""
    return TrainingRun(folder=folder, recipe={"seed": seed}, seed=seed, device=torch.device("cpu"), say=say)


def files(folder: Path) -> set[str]:
    """Names in a folder."""
    return {path.name for path in folder.iterdir()}


def misfit(form: np.ndarray, target: np.ndarray) -> float:
    """Mean distance of corresponding points after the best rigid motion, over the mean distance from the centre."""
    distances = np.linalg.norm(moved_to(form, target) - target, axis=1)
    return float(distances.mean() / np.linalg.norm(target - target.mean(axis=0), axis=1).mean())
