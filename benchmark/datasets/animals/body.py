"""Watertight surfaces from cross sections: a smooth implicit body, polygonised and re-meshed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from benchmark.datasets.animals.anatomy import Species, Tube
from benchmark.datasets.animals.skeleton import Skeleton
from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import isotropic_remesh

SUBDIVISIONS = 6
"""Number of straight pieces between two cross sections."""

VOXELS_PER_EDGE = 1.6
"""Number of voxels per edge of the final mesh."""

BLOCK = 4
"""Number of voxels per side of a block; only blocks near the surface are evaluated per voxel."""


@dataclass(frozen=True)
class Field:
    """An implicit body of tapered elliptic pieces, grouped in tubes.

    Parameters
    ----------
    pieces
        Shape (pieces, 10): start (3), end (3), then depth and breadth ratio at the start and at the end.
    bones
        Bone of each piece, shape (pieces,).
    first
        First piece of each tube, shape (tubes + 1,); the last entry is the number of pieces.
    flats
        Unit axis of the flattening of each tube, shape (tubes, 3).
    blends
        Fillet width of each tube, shape (tubes,).
    hollow
        Whether each tube is subtracted, shape (tubes,); such tubes come last.
    """

    pieces: NDArray[np.float64]
    bones: NDArray[np.int64]
    first: NDArray[np.int64]
    flats: NDArray[np.float64]
    blends: NDArray[np.float64]
    hollow: NDArray[np.bool_]

    @classmethod
    def of(cls, species: Species, skeleton: Skeleton) -> Field:
        """Create the implicit body of a species, with pieces labelled by bones of the skeleton."""
        parts = sorted(species.parts(), key=lambda part: part.hollow)
        pieces, bones = zip(*(_pieces(part, skeleton) for part in parts), strict=True)
        return cls(
            pieces=np.concatenate(pieces),
            bones=np.concatenate(bones),
            first=np.concatenate([[0], np.cumsum([len(piece) for piece in pieces])]),
            flats=np.array([np.asarray(part.flat) / np.linalg.norm(part.flat) for part in parts]),
            blends=np.array([part.blend for part in parts], dtype=np.float64),
            hollow=np.array([part.hollow for part in parts]),
        )

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the corners of a bounding box of the body, each of shape (3,)."""
        boxes = np.array([_box(piece[None]) for piece in self.pieces])
        margin = 0.25 * self.blends.max()
        return boxes[:, 0].min(axis=0) - margin, boxes[:, 1].max(axis=0) + margin

    def evaluate(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Evaluate the body at points of shape (n, 3).

        Returns
        -------
        numpy.ndarray, numpy.ndarray
            First-order signed distances, negative inside, and the nearest pieces, both of shape (n,).
        """
        tubes = np.split(self.pieces, self.first[1:-1])
        arguments = (self.pieces, self.first, self.flats, self.blends, self.hollow, np.array([_box(t) for t in tubes]))
        values, nearest = _evaluate(np.array(points, order="C"), *arguments)
        return values, nearest


def _box(pieces: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lower and upper corner of a bounding box of pieces, shape (2, 3)."""
    radius = (pieces[:, [6, 8]] * np.maximum(pieces[:, [7, 9]], 1.0)).max()
    ends = pieces[:, :6].reshape(-1, 3)
    return np.array([ends.min(axis=0) - radius, ends.max(axis=0) + radius])


def _pieces(part: Tube, skeleton: Skeleton) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Cut a tube into straight tapered pieces along a smooth curve through its sections."""
    rows = np.array([[*s.position, s.depth, s.breadth / s.depth] for s in part.sections])
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rows[:, :3], axis=0), axis=1))])
    at = np.concatenate([np.linspace(a, b, SUBDIVISIONS, endpoint=False) for a, b in pairwise(chord)])
    # Monotone cubics do not overshoot: thickness stays between that of adjacent sections.
    samples = PchipInterpolator(chord, rows)(np.append(at, chord[-1]))
    start, end = samples[:-1], samples[1:]
    bone = skeleton.index(part.parent) if not part.sections[0].bone else -1
    labels = []
    for section in part.sections[:-1]:
        bone = skeleton.index(section.bone) if section.bone else bone
        labels += [bone] * SUBDIVISIONS
    return np.column_stack([start[:, :3], end[:, :3], start[:, 3:], end[:, 3:]]), np.array(labels, dtype=np.int64)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _evaluate(
    points: NDArray[np.float64],
    pieces: NDArray[np.float64],
    first: NDArray[np.int64],
    flats: NDArray[np.float64],
    blends: NDArray[np.float64],
    hollow: NDArray[np.bool_],
    boxes: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    values = np.empty(len(points))
    nearest = np.empty(len(points), np.int64)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        value, least, owner = 1e9, 1e9, -1
        for tube in range(len(blends)):
            blend = blends[tube]
            gap = 0.0
            for k in range(3):
                outside = max(boxes[tube, 0, k] - points[i, k], points[i, k] - boxes[tube, 1, k], 0.0)
                gap += outside * outside
            # A tube farther away than its fillet does not change the value.
            if owner >= 0 and np.sqrt(gap) > abs(value) + blend:
                continue
            nx, ny, nz = flats[tube, 0], flats[tube, 1], flats[tube, 2]
            distance = 1e9
            for p in range(first[tube], first[tube + 1]):
                ax, ay, az = x - pieces[p, 0], y - pieces[p, 1], z - pieces[p, 2]
                bx, by, bz = pieces[p, 3] - pieces[p, 0], pieces[p, 4] - pieces[p, 1], pieces[p, 5] - pieces[p, 2]
                t = (ax * bx + ay * by + az * bz) / (bx * bx + by * by + bz * bz)
                t = min(max(t, 0.0), 1.0)
                radius = pieces[p, 6] + t * (pieces[p, 8] - pieces[p, 6])
                ratio = pieces[p, 7] + t * (pieces[p, 9] - pieces[p, 7])
                cx, cy, cz = ax - t * bx, ay - t * by, az - t * bz
                along = cx * nx + cy * ny + cz * nz
                across = max(cx * cx + cy * cy + cz * cz - along * along, 0.0)
                norm = np.sqrt(across + (along / ratio) ** 2)
                slope = np.sqrt(across + (along / (ratio * ratio)) ** 2)
                # First-order distance to an ellipse: implicit function divided by the gradient norm.
                d = (norm - radius) * (norm / slope if slope > 1e-9 else 1.0)
                distance = min(distance, d)
                if d < least and not hollow[tube]:
                    least, owner = d, p
            if hollow[tube]:
                overlap = max(blend - abs(value + distance), 0.0)
                value = max(value, -distance) + 0.25 * overlap * overlap / blend
            else:
                overlap = max(blend - abs(value - distance), 0.0)
                value = min(value, distance) - 0.25 * overlap * overlap / blend
        # Soles and hooves are flat on the ground.
        values[i] = max(value, -z)
        nearest[i] = owner
    return values, nearest


def surface(field: Field, n_vertices: int) -> tuple[Mesh, NDArray[np.int64]]:
    """Polygonise an implicit body.

    Parameters
    ----------
    field
        The body.
    n_vertices
        Target number of vertices, reached within about ten per cent.

    Returns
    -------
    Mesh, numpy.ndarray
        A closed surface of triangles of similar size, and the bone of each vertex, shape (n,).

    Raises
    ------
    InvalidMesh
        If the surface is not a single closed component without handles; correct the proportions.
    """
    import igl

    low, high = field.bounds()
    # A coarse pass measures the area, which determines the edge length: 2 n triangles of area l^2 sqrt(3) / 4.
    coarse = _marching_cubes(field, low, high, float((high - low).max()) / 60.0)
    # Rounded, so that rounding errors of a sum cannot change the triangles.
    edge = round(float(np.sqrt(coarse.area / (2 * n_vertices) * 4.0 / np.sqrt(3.0))), 3)
    coarse = _marching_cubes(field, low, high, edge / VOXELS_PER_EDGE)
    mesh = isotropic_remesh(coarse, edge, iterations=5, feature_degrees=60.0, max_deviation=1.0)
    euler = mesh.n_vertices - mesh.n_faces // 2
    pieces = int(igl.connected_components(igl.adjacency_matrix(mesh.faces.astype(np.int64)))[0])
    if pieces != 1 or euler != 2:
        raise InvalidMesh(
            f"the body has {pieces} pieces and Euler number {euler}", "correct the proportions of the species"
        )
    _, owner = field.evaluate(mesh.vertices)
    return mesh, field.bones[owner]


def _marching_cubes(field: Field, low: NDArray[np.float64], high: NDArray[np.float64], step: float) -> Mesh:
    import igl

    counts = (np.ceil((high - low) / step).astype(int) // BLOCK + 2) * BLOCK
    axes = [start + step * (np.arange(count) - 1.0) for start, count in zip(low, counts, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    grid = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    # Evaluate only blocks near the surface per voxel; the others keep the value at their centre.
    middle = np.s_[BLOCK // 2 :: BLOCK, BLOCK // 2 :: BLOCK, BLOCK // 2 :: BLOCK]
    centres = np.column_stack([x[middle].ravel(), y[middle].ravel(), z[middle].ravel()])
    values = field.evaluate(centres)[0].reshape(x[middle].shape)
    for axis in range(3):
        values = values.repeat(BLOCK, axis=axis)
    values = values.ravel()
    near = np.abs(values) < 2.0 * BLOCK * step
    values[near], _ = field.evaluate(grid[near])
    vertices, faces, _ = igl.marching_cubes(values, grid, *(int(count) for count in counts), 0.0)
    mesh = Mesh(vertices, faces)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    outward = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0
    return mesh if outward else Mesh(vertices, faces[:, ::-1])
