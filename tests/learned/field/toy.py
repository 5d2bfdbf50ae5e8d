"""A field that trains within seconds, and the bent spheroids that it learns from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmark.geometry.mesh import Mesh
from learned.field.configuration import PLAIN
from tests.learned.streamed.toy import Ellipsoids

TOY = replace(
    PLAIN,
    name="toy",
    points=64,
    tokens=24,
    neighbours=8,
    width=32,
    heads=2,
    encoder_layers=1,
    decoder_layers=1,
    frequencies=3,
)

OPTIONS: dict[str, Any] = {
    "steps": 16,
    "bodies": 2,
    "warm_up": 2,
    "learning_rate": 3e-3,
    "precision": "float32",
    "threads": 1,
    "workers": 0,
}


def bent_spheroid(seed: int = 5) -> tuple[Mesh, Mesh]:
    """A spheroid that no training sees: as it is and bent."""
    made = Ellipsoids(seed=seed).surfaces(0, 1)
    return Mesh(made.canonical[0], made.faces), Mesh(made.posed[0, 0], made.faces)


def misfit(form: np.ndarray, target: np.ndarray) -> float:
    """Mean distance of corresponding points after the best rigid motion, over the mean distance from the centre.

    The motion is that of Kabsch (1976), without mirroring.
    """
    form, target = form - form.mean(axis=0), target - target.mean(axis=0)
    left, _, right = np.linalg.svd(target.T @ form)
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    distances = np.linalg.norm(form @ (left @ right).T - target, axis=1)
    return float(distances.mean() / np.linalg.norm(target, axis=1).mean())
