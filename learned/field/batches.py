"""Fresh bodies as the field sees them: a batch is a function of its number alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor

from benchmark.api.streaming import MakesSurfaces
from benchmark.geometry.mesh import Mesh, Points, edges_of
from learned.field.configuration import Field
from learned.field.sampling import random_samples
from learned.frame import centred, frame_of

EDGES = 192
"""Edges of each body whose two ends are asked for."""

WALK = 8
"""Steps of a random walk over the mesh from the start of an edge to its end: about a fortieth of a body's height on
the meshes of bodies, as far as the neighbours in a mesh of two thousand vertices are apart."""

NOISE = 2e-3
"""Standard deviation of what is added to points and positions in training, in roots of the area."""


@dataclass(frozen=True, eq=False)
class SurfaceBatch:
    """Bodies to train on; the poses of one body are neighbours.

    Parameters
    ----------
    number
        Place in the stream.
    identifiers
        Names of the bodies.
    points, normals
        What the encoder sees, shape (n, m, 3); n is bodies times poses.
    positions, position_normals
        What the decoder is asked for, shape (n, q, 3): starts of edges along the surface, then their ends.
    targets, target_normals
        The same places in the canonical pose, shape (n, q, 3).
    heights
        Of the bodies in the canonical pose, in roots of their area, shape (n,).
    drawn_again
        How often something was drawn again, by reason.
    """

    number: int
    identifiers: tuple[str, ...]
    points: Tensor
    normals: Tensor
    positions: Tensor
    position_normals: Tensor
    targets: Tensor
    target_normals: Tensor
    heights: Tensor
    drawn_again: Mapping[str, int]

    @classmethod
    def of(
        cls, number: int, identifiers: tuple[str, ...], rows: Iterable[Sequence[Any]], drawn_again: Mapping[str, int]
    ) -> SurfaceBatch:
        """Stack rows, each the arrays of one pose from ``points`` to ``heights``."""
        points, normals, positions, position_normals, targets, target_normals, heights = (
            torch.from_numpy(np.stack(column).astype(np.float32)) for column in zip(*rows, strict=True)
        )
        return cls(
            number, identifiers, points, normals, positions, position_normals, targets, target_normals, heights,
            dict(drawn_again),
        )  # fmt: skip


def noised(places: Points, random: np.random.Generator) -> Points:
    """Return points or positions with the noise of training."""
    return places + random.normal(scale=NOISE, size=places.shape)


@dataclass(frozen=True)
class MakesSurfaceBatches:
    """Makes batches; can be sent to another process.

    Parameters
    ----------
    make
        Makes fresh bodies.
    configuration
        What the network sees of them.
    bodies
        Bodies of each batch.
    perturbed
        Whether frames and points are perturbed as in training.
    """

    make: MakesSurfaces
    configuration: Field
    bodies: int
    perturbed: bool = True

    def __call__(self, number: int) -> SurfaceBatch:
        """Make one batch."""
        surfaces = self.make(number, self.bodies)
        over = _Over.of(surfaces.faces)
        rows = []
        for place, (canonical, posed) in enumerate(zip(surfaces.canonical, surfaces.posed, strict=True)):
            random = np.random.default_rng([number, place])
            target = centred(Mesh(canonical, surfaces.faces))
            height = np.array(np.ptp(target.vertices[:, 2]))
            for vertices in posed:
                seen, asked = self._of_pose(Mesh(vertices, surfaces.faces), over, random)
                rows.append((*seen, target.vertices[asked], over.normals(target, asked), height))
        return SurfaceBatch.of(number, surfaces.identifiers, rows, surfaces.drawn_again)

    def _of_pose(
        self, mesh: Mesh, over: _Over, random: np.random.Generator
    ) -> tuple[tuple[Points, Points, Points, Points], NDArray[np.int64]]:
        """Points and positions with their normals in the frame of a body, and which vertices the positions are."""
        inside = frame_of(mesh, random if self.perturbed else None).seen(mesh)
        samples = random_samples(inside, self.configuration.points, random)
        starts = random.choice(mesh.n_vertices, EDGES, p=shares(inside))
        asked = np.concatenate([starts, over.walked(starts, random)])
        points, positions = samples.points, inside.vertices[asked]
        if self.perturbed:
            points, positions = noised(points, random), noised(positions, random)
        return (points, samples.normals, positions, over.normals(inside, asked)), asked


@dataclass(frozen=True, eq=False)
class _Over:
    """Facts of all bodies' vertices from their triangles.

    Parameters
    ----------
    neighbours
        Which vertices share an edge, shape (n, n).
    triangles
        Which vertices have which triangles, shape (n, m).
    """

    neighbours: csr_array
    triangles: csr_array

    @classmethod
    def of(cls, faces: NDArray[np.int32]) -> _Over:
        ends = edges_of(faces).ends
        both = np.concatenate([ends, ends[:, ::-1]])
        owners = np.repeat(np.arange(len(faces)), 3)
        return cls(csr_array((np.ones(len(both)), both.T)), csr_array((np.ones(faces.size), (faces.ravel(), owners))))

    def walked(self, starts: NDArray[np.int64], random: np.random.Generator) -> NDArray[np.int64]:
        """Return where random walks from vertices end; one that ends where it began is led to a neighbour."""
        first, heads = self.neighbours.indptr, self.neighbours.indices
        places = starts
        for step in range(WALK + 1):
            moved = heads[first[places] + random.integers(0, first[places + 1] - first[places])].astype(np.int64)
            places = moved if step < WALK else np.where(places == starts, moved, places)
        return places

    def normals(self, mesh: Mesh, vertices: NDArray[np.int64]) -> Points:
        """Unit normals at some vertices, the means over their triangles by area, shape (k, 3)."""
        around = self.triangles[vertices]
        a, b, c = (mesh.vertices[mesh.faces[around.indices, k]] for k in range(3))
        summed = csr_array((around.data, np.arange(around.nnz), around.indptr)) @ np.cross(b - a, c - a)
        return np.asarray(summed / np.linalg.norm(summed, axis=1, keepdims=True).clip(min=np.finfo(float).tiny))


def shares(mesh: Mesh) -> NDArray[np.float64]:
    """Share of the area that belongs to each vertex, shape (n,)."""
    areas = np.bincount(mesh.faces.ravel(), np.repeat(mesh.face_areas, 3), minlength=mesh.n_vertices)
    return np.asarray(areas / areas.sum())
