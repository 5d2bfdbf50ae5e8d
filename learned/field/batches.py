"""Training batches of fresh bodies for the field, each determined by its number."""

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
"""Edges sampled from each posed body; the decoder is queried at both ends."""

WALK = 8
"""Steps of the random walk over the mesh from the start of an edge to its end. On meshes of bodies, they cover about a
fortieth of the height, the distance between neighbours in a mesh of 2000 vertices."""

NOISE = 2e-3
"""Standard deviation of the training noise on points and positions, in units of sqrt(area)."""


@dataclass(frozen=True, eq=False)
class SurfaceBatch:
    """Bodies to train on; the poses of a body are adjacent.

    Parameters
    ----------
    number
        Index in the stream.
    identifiers
        Names of the bodies.
    points, normals
        Input of the encoder, shape (n, m, 3); n is bodies times poses.
    positions, position_normals
        Queries of the decoder, shape (n, q, 3): starts of edges along the surface, then their ends.
    targets, target_normals
        The same points in the canonical pose, shape (n, q, 3).
    heights
        Heights of the bodies in the canonical pose, in units of sqrt(area), shape (n,).
    drawn_again
        Number of redraws, by reason.
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
        """Stack rows, each with the arrays of one pose from ``points`` to ``heights``."""
        points, normals, positions, position_normals, targets, target_normals, heights = (
            torch.from_numpy(np.stack(column).astype(np.float32)) for column in zip(*rows, strict=True)
        )
        return cls(
            number, identifiers, points, normals, positions, position_normals, targets, target_normals, heights,
            dict(drawn_again),
        )  # fmt: skip


def noised(places: Points, random: np.random.Generator) -> Points:
    """Add the training noise to points or positions."""
    return places + random.normal(scale=NOISE, size=places.shape)


@dataclass(frozen=True)
class MakesSurfaceBatches:
    """Maker of batches; can be sent to another process.

    Parameters
    ----------
    make
        Maker of fresh bodies.
    configuration
        Configuration of the network.
    bodies
        Bodies per batch.
    perturbed
        Whether to perturb frames and points as in training.
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
        """Return points and positions with normals in the frame of a body, and the vertices at the positions."""
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
    """Adjacency in the mesh that all bodies share.

    Parameters
    ----------
    neighbours
        Pairs of vertices that share an edge, shape (n, n).
    triangles
        Triangles of each vertex, shape (n, m).
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
        """Return the ends of random walks from vertices; a walk that ends at its start takes another step."""
        first, heads = self.neighbours.indptr, self.neighbours.indices
        places = starts
        for step in range(WALK + 1):
            moved = heads[first[places] + random.integers(0, first[places + 1] - first[places])].astype(np.int64)
            places = moved if step < WALK else np.where(places == starts, moved, places)
        return places

    def normals(self, mesh: Mesh, vertices: NDArray[np.int64]) -> Points:
        """Return unit normals at some vertices, averaged over their triangles by area, shape (k, 3)."""
        around = self.triangles[vertices]
        a, b, c = (mesh.vertices[mesh.faces[around.indices, k]] for k in range(3))
        summed = csr_array((around.data, np.arange(around.nnz), around.indptr)) @ np.cross(b - a, c - a)
        return np.asarray(summed / np.linalg.norm(summed, axis=1, keepdims=True).clip(min=np.finfo(float).tiny))


def shares(mesh: Mesh) -> NDArray[np.float64]:
    """Return the share of the area that belongs to each vertex, shape (n,)."""
    areas = np.bincount(mesh.faces.ravel(), np.repeat(mesh.face_areas, 3), minlength=mesh.n_vertices)
    return np.asarray(areas / areas.sum())
