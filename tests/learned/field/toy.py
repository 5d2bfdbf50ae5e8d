"""A field that trains within seconds, and the bent spheroids that it learns from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

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
