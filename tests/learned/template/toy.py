"""Rods that are bent, and a template of them that is trained within seconds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import trimesh

from benchmark.api.streaming import StreamedData, Surfaces
from benchmark.errors import DatasetError
from benchmark.geometry.mesh import Mesh
from learned.template.configuration import PLAIN
from tests.learned.streamed.toy import bent, surface_stream

TOY = replace(
    PLAIN, name="toy", bodies=3, code_size=8, width=16, template_layers=2, deformation_layers=2, rays=16,
    template_frequency=10.0, deformation_frequency=5.0,
)  # fmt: skip

OPTIONS: dict[str, Any] = {
    "steps": 12,
    "bodies": 4,
    "warm_up": 2,
    "learning_rate": 2e-3,
    "code_rate": 1.0,
    "threads": 1,
}

SPHERE = trimesh.creation.icosphere(subdivisions=2)


def rod(angle: float = 0.0) -> Mesh:
    """A thin spheroid whose axis turns by an angle."""
    return Mesh(bent(SPHERE.vertices * [0.2, 0.2, 1.0], angle), SPHERE.faces.astype(np.int32))


@dataclass
class Rods:
    """Makes rods that are bent by up to 2 radians; the canonical one is straight.

    Parameters
    ----------
    broken
        Number of the batch that cannot be made.
    asked
        Numbers that were asked for.
    """

    broken: int = -1
    asked: list[int] = field(default_factory=list)

    def surfaces(self, number: int, bodies: int) -> Surfaces:
        self.asked.append(number)
        if number == self.broken:
            raise DatasetError(f"rod-{number}-0 has no pose", "correct it")
        angles = np.random.default_rng(number).uniform(-2, 2, (bodies, 2))
        return Surfaces(
            identifiers=tuple(f"rod-{number}-{body}" for body in range(bodies)),
            canonical=np.stack([rod().vertices] * bodies),
            posed=np.stack([np.stack([rod(angle).vertices for angle in pair]) for pair in angles]),
            faces=rod().faces,
            drawn_again={},
        )


def rods(make: Rods | None = None) -> StreamedData:
    """The toy data with a stream of rods."""
    return surface_stream((make or Rods()).surfaces, Rods().surfaces)
