"""A stream of ellipsoids, which costs nothing to make."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import trimesh

from benchmark.api.streaming import N_POINTS, Fresh, MakesSurfaces, StreamedData, Surfaces
from benchmark.errors import DatasetError
from learned.streamed.configuration import PLAIN, Streamed
from learned.training import loop
from tests.learned.toy import ellipsoid, quiet, toy_data

TOY = replace(PLAIN, name="toy", resolution=32, width=8, code_size=16)


@dataclass(frozen=True)
class Ellipsoids:
    """Bodies with a width and a height; a pose puts them elsewhere in the frame.

    Parameters
    ----------
    seed
        Seed of the stream.
    broken
        Number of the batch that cannot be made.
    killed
        A file that appears when the process that makes batch 3 is killed, once.
    """

    seed: int = 0
    broken: int = -1
    killed: Path | None = None

    def __call__(self, number: int, bodies: int, size: int) -> Fresh:
        if number == self.broken:
            raise DatasetError(f"toy-{number}-0 has no pose", "correct it")
        if self.killed is not None and number == 3 and not self.killed.exists():
            self.killed.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        random = np.random.default_rng([self.seed, number])
        images = np.zeros((bodies, 2, size, size), dtype=np.float32)
        fronts, backs = np.zeros((2, bodies, size, size), dtype=np.float32)
        for body in range(bodies):
            width, height = random.uniform(0.2, 0.5, 2)
            fronts[body], backs[body] = both(size, width, height)
            for pose in range(2):
                images[body, pose] = both(size, width, height, *random.uniform(-0.3, 0.3, 2))[0]
        names = tuple(f"toy-{number}-{body}" for body in range(bodies))
        pixels = random.uniform(0.4 * size, 0.6 * size, (bodies, 2, 20, 2)).astype(np.float32)
        pixels[:, :, 0] = np.nan
        places = random.uniform(-0.5, 0.5, (bodies, 20, 3)).astype(np.float32)
        points = np.repeat(fronts.max(axis=(1, 2))[:, None], 3 * N_POINTS, axis=1)
        return Fresh(
            identifiers=names, images=images, fronts=fronts, backs=backs, drawn_again={"toys": 1},
            pixels=pixels, places=places, points=points,
        )  # fmt: skip

    def surfaces(self, number: int, bodies: int) -> Surfaces:
        """Spheroids that are bent along their axis in each of two poses."""
        random = np.random.default_rng([self.seed, number])
        sphere = trimesh.creation.icosphere(subdivisions=2)
        canonical = np.empty((bodies, len(sphere.vertices), 3))
        posed = np.empty((bodies, 2, len(sphere.vertices), 3))
        for body in range(bodies):
            canonical[body] = sphere.vertices * [*np.repeat(random.uniform(0.2, 0.4), 2), random.uniform(0.7, 1.0)]
            for pose in range(2):
                posed[body, pose] = bent(canonical[body], random.uniform(-1, 1))
        names = tuple(f"toy-{number}-{body}" for body in range(bodies))
        faces = sphere.faces.astype(np.int32)
        return Surfaces(identifiers=names, canonical=canonical, posed=posed, faces=faces, drawn_again={})


def bent(points: np.ndarray, angle: float) -> np.ndarray:
    """Points bent in the plane of x and z, so that the axis from z = -1 to 1 turns by an angle."""
    if angle == 0:
        return points.copy()
    radius, turn = 2 / angle, points[:, 2] * angle / 2
    distance = radius - points[:, 0]
    return np.stack([radius - distance * np.cos(turn), points[:, 1], distance * np.sin(turn)], axis=1)


def both(size: int, width: float, height: float, x: float = 0.0, y: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Front and back of an ellipsoid whose depth is as large as its width."""
    return tuple(ellipsoid(width, height, x=x, y=y, thickness=side * width / 2, size=size) for side in (1, -1))


def toy_stream(make: Ellipsoids = Ellipsoids()) -> StreamedData:
    """The toy data with a stream."""
    validation = Ellipsoids(seed=1)
    return replace(surface_stream(make.surfaces, validation.surfaces), fresh=make, validation=validation)


def surface_stream(surfaces: MakesSurfaces, validation: MakesSurfaces) -> StreamedData:
    """The toy data with a stream of other surfaces."""
    images = Ellipsoids()
    return StreamedData(
        **vars(toy_data()), fresh=images, validation=images, surfaces=surfaces, validation_surfaces=validation
    )


def toy(**changes: object) -> Streamed:
    """The toy network with changes."""
    return replace(TOY, **changes)


def settle(patch: pytest.MonkeyPatch, known: dict[str, Any], configuration: Any, training: ModuleType) -> None:
    """Give a toy network its name, and write a checkpoint every fourth step."""
    patch.setitem(known, configuration.name, configuration)
    patch.setattr(loop, "ROW", 4)
    patch.setattr(loop, "CHECKPOINT_SECONDS", -1.0)
    patch.setattr(training, "LOOKED_AT", 2)


def trained_toy(
    folder: Path, known: dict[str, Any], configuration: Any, training: ModuleType, fit: Any, options: dict[str, Any]
) -> Path:
    """Train a toy network on the toy stream into a folder."""
    with pytest.MonkeyPatch.context() as patch:
        settle(patch, known, configuration, training)
        fit("toy", 0, toy_stream(), folder, options, quiet)
    return folder


#: Options that no training on a stream takes, and what is said of them.
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"epochs": 3}, "no body is seen twice"),
    ({"batch": 3}, "bodies=N"),
    ({"step": 3}, "did you mean steps"),
    ({"bodies": 1}, "at least 2"),
]
