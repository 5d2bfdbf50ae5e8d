"""The shapes that a template is trained on: some bodies of a stream, made once, and the batches drawn of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load, save
from torch import Tensor

from benchmark.api.streaming import MakesSurfaces
from benchmark.errors import BenchmarkError, TrainingError, one_line
from benchmark.geometry.mesh import Mesh
from learned.frame import centred
from learned.template.distances import rays_around
from learned.training.checkpoint import write

KEPT = 8192
"""Rays that are kept of each shape."""

TOGETHER = 8
"""Bodies that are made, and kept in a file, together."""

SAMPLES = "samples"
"""Folder of the files, inside that of the model; it goes when the training ends."""

_NAMES = ("feet", "directions", "lengths")


@dataclass(frozen=True, eq=False)
class Shapes:
    """Rays around all shapes; see :class:`learned.template.distances.Rays`.

    Parameters
    ----------
    feet, directions
        Shape (shapes, rays, 3).
    lengths
        Shape (shapes, rays).
    """

    feet: Tensor
    directions: Tensor
    lengths: Tensor

    @classmethod
    def around(cls, meshes: Iterable[Mesh], rays: int) -> Self:
        """So many rays around each of some closed surfaces, centred and of unit area."""
        found = [vars(rays_around(centred(mesh), rays)) for mesh in meshes]
        return cls(*(torch.from_numpy(np.stack([each[name] for each in found])) for name in _NAMES))

    def __len__(self) -> int:
        return len(self.lengths)


@dataclass(frozen=True, eq=False)
class PointBatch:
    """Points around some shapes, the first half of them on the surface.

    Parameters
    ----------
    number
        Place among the steps.
    shapes
        Which shapes, shape (n,).
    points, directions
        Positions, and the gradient of the distance there, shape (n, 2 * rays, 3).
    distances
        Signed distances, shape (n, 2 * rays).
    drawn_again
        Nothing is.
    """

    number: int
    shapes: Tensor
    points: Tensor
    directions: Tensor
    distances: Tensor
    drawn_again: Mapping[str, int]


@dataclass(frozen=True)
class DrawsPoints:
    """Draws the batch of a number: shapes in an order that shows all of them equally often, and points around each.

    Parameters
    ----------
    shapes
        What is drawn from.
    n_shapes
        Shapes of each batch.
    rays
        Points on the surface of each, and as many around it.
    seed
        Seed of the draws.
    """

    shapes: Shapes
    n_shapes: int
    rays: int
    seed: int

    def __call__(self, number: int) -> PointBatch:
        """Draw one batch."""
        first = number * self.n_shapes
        chosen = np.array([self._shape(place) for place in range(first, first + self.n_shapes)])
        random = np.random.default_rng([self.seed, 1, number])
        # Half of the points off the surface crowd near it, half lie anywhere along their rays.
        share = random.uniform(size=(self.n_shapes, self.rays)) ** np.where(np.arange(self.rays) % 2, 1, 3)
        rays = torch.from_numpy(random.integers(self.shapes.lengths.shape[1], size=(self.n_shapes, 2 * self.rays)))
        indices = torch.from_numpy(chosen)
        lengths = self.shapes.lengths[indices[:, None], rays].clone()
        lengths[:, : self.rays] = 0
        lengths[:, self.rays :] *= torch.from_numpy(share.astype(np.float32))
        directions = self.shapes.directions[indices[:, None], rays]
        points = self.shapes.feet[indices[:, None], rays] + lengths[..., None] * directions
        return PointBatch(number, indices, points, directions, lengths, {})

    def _shape(self, place: int) -> int:
        """Shape in a place of the endless order, a permutation after the other."""
        turn, within = divmod(place, len(self.shapes))
        return int(np.random.default_rng([self.seed, 0, turn]).permutation(len(self.shapes))[within])


def collected(make: MakesSurfaces, bodies: int, folder: Path | None, digest: str, say: Callable[[str], None]) -> Shapes:
    """Make the first bodies of a stream, each in the canonical pose and then in its poses.

    Parameters
    ----------
    make
        Makes the surfaces.
    bodies
        How many.
    folder
        Where files are kept that a training which is resumed reads again; None for no files.
    digest
        Names the data; a file of other data, or made by other code, is made again.
    say
        Told about progress.

    Raises
    ------
    TrainingError
        If a body cannot be made or a file cannot be written. What was made before is kept.
    """
    parts = []
    told = {"digest": digest, "rays": str(KEPT)}
    for number, first in enumerate(range(0, bodies, TOGETHER)):
        path = folder / SAMPLES / f"{number}.safetensors" if folder is not None else None
        count = min(TOGETHER, bodies - first)
        part = _read(path, told | {"bodies": str(count)}) if path is not None else None
        if part is None:
            try:
                part = _made(make, number, count)
            except BenchmarkError as error:
                raise TrainingError(
                    f"batch {number} cannot be made: {one_line(error)}",
                    "correct it and train again: it goes on from there",
                ) from error
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                write(path, save(vars(part), told | {"bodies": str(count)}))
                say(f"distances around {first + count} of {bodies} bodies")
        parts.append(part)
    return Shapes(*(torch.cat([vars(part)[name] for part in parts]) for name in _NAMES))


def _made(make: MakesSurfaces, number: int, bodies: int) -> Shapes:
    found = make(number, bodies)
    of_bodies = zip(found.canonical, found.posed, strict=True)
    meshes = (Mesh(each, found.faces) for canonical, posed in of_bodies for each in (canonical, *posed))
    return Shapes.around(meshes, KEPT)


def _read(path: Path, told: Mapping[str, str]) -> Shapes | None:
    """Return what a file keeps; None if there is none, it is damaged, or it does not tell what it should."""
    try:
        content = path.read_bytes()
        with safe_open(str(path), framework="pt") as file:
            if file.metadata() != told:
                return None
        return Shapes(**load(content))
    except (OSError, SafetensorError, TypeError):
        return None
