"""A field that trains within seconds, and the bent spheroids that it learns from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh

from benchmark.api.streaming import StreamedData, Surfaces
from benchmark.geometry.mesh import Mesh
from learned.field.configuration import PLAIN
from tests.learned.streamed.toy import Ellipsoids, bent, surface_stream

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


@dataclass(frozen=True)
class Paddles:
    """Makes paddles that are bent by up to two radians: no two directions of one look alike, unlike those of spheroids.

    Parameters
    ----------
    seed
        Of the series.
    """

    seed: int

    def surfaces(self, number: int, bodies: int) -> Surfaces:
        random = np.random.default_rng([self.seed, number])
        sphere = trimesh.creation.icosphere(subdivisions=2)
        canonical = np.stack([self._paddle(sphere.vertices, random) for _ in range(bodies)])
        posed = np.stack([np.stack([bent(each, random.uniform(-2, 2)) for _ in range(2)]) for each in canonical])
        names = tuple(f"paddle-{number}-{body}" for body in range(bodies))
        return Surfaces(
            identifiers=names, canonical=canonical, posed=posed, faces=sphere.faces.astype(np.int32), drawn_again={}
        )

    def _paddle(self, sphere: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """A long ellipsoid, thick above, hollow in front and leaning to one side."""
        x, y, z = sphere.T
        thickness, width, length = random.uniform([0.15, 0.3, 0.8], [0.2, 0.4, 1.0])
        taper = 1 + 0.5 * z
        return np.stack([thickness * x * taper + 0.15 * y * y, width * y * taper + 0.15 * z * z, length * z], axis=1)


def paddles() -> StreamedData:
    """The toy data with a stream of paddles."""
    return surface_stream(Paddles(0).surfaces, Paddles(1).surfaces)
