"""Simulation of a body scanner: one skin over all that touches, other triangles every time, and noise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from benchmark.geometry.cleaning import largest_component
from benchmark.geometry.mesh import Mesh, Points, sides_of
from benchmark.geometry.preparation import isotropic_remesh
from benchmark.geometry.rasterise import depth_buffer

CELL = 0.005
"""Side of a voxel in metres."""

_MARGIN = 6
"""Empty voxels around the body."""

_CLOSING = 0.012
"""Radius in metres of the ball that closes the gaps between fingers; gaps up to twice as wide disappear."""

_WHITE, _SMOOTH = 0.0002, 0.0003
"""Standard deviations in metres of the noise that is independent and of that which neighbours share."""

_CORNERS = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=np.int64
)
"""Corners of a cube in the order that libigl's marching cubes expects."""


_DIRECTIONS, _IMAGE, _DEPTH_TOLERANCE, _EXPOSED = 128, 400, 0.002, 0.12
"""Views and pixels per side for the visibility, tolerance in metres, and the share of views that see a vertex."""


def sheltered_vertices(mesh: Mesh) -> NDArray[np.bool_]:
    """Return whether light from fewer than one in eight directions reaches a vertex, shape (n,).

    Parameters
    ----------
    mesh
        A surface in metres; the directions are those of a Fibonacci lattice on the sphere.
    """
    steps = np.arange(_DIRECTIONS) + 0.5
    heights, turns = 1 - 2 * steps / _DIRECTIONS, np.pi * (1 + math.sqrt(5)) * steps
    radii = np.sqrt(1 - heights**2)
    seen = np.zeros(mesh.n_vertices)
    for direction in np.stack([radii * np.cos(turns), radii * np.sin(turns), heights], axis=1):
        across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
        across /= np.linalg.norm(across)
        points = mesh.vertices @ np.stack([across, np.cross(direction, across), direction], axis=1)
        low, extent = points.min(axis=0), np.ptp(points, axis=0).max()
        points = (points - low) * [_IMAGE / extent, _IMAGE / extent, 1]
        nearest = depth_buffer(points, mesh.faces, _IMAGE, np.inf)
        column, row = np.minimum(points[:, :2].astype(np.int64), _IMAGE - 1).T
        seen += points[:, 2] <= nearest[row, column] + _DEPTH_TOLERANCE
    return np.asarray(seen < _EXPOSED * _DIRECTIONS)


def membrane(mesh: Mesh, free: NDArray[np.bool_]) -> Mesh:
    """Stretch the free part of a surface like a soap film: each free vertex becomes the mean of its neighbours.

    Parameters
    ----------
    mesh
        A surface; every free component borders on a vertex that is not free.
    free
        Which vertices move, shape (n,).
    """
    tails, heads = sides_of(mesh.faces)
    links = csr_array((np.ones(len(tails)), (tails, heads)), shape=(mesh.n_vertices, mesh.n_vertices))[free]
    degrees = np.asarray(links.sum(axis=1)).ravel()
    system = (diags_array(degrees) - links[:, free]).tocsc()
    vertices = mesh.vertices.copy()
    vertices[free] = spsolve(system, links[:, ~free] @ mesh.vertices[~free])
    return mesh.with_vertices(vertices)


def scan(mesh: Mesh, fused: Sequence[NDArray[np.int64]], n_vertices: int, random: np.random.Generator) -> Mesh:
    """Surface as a body scanner would deliver it.

    The solid is sampled on a grid in a random position, the gaps between fingers are closed, the boundary is
    extracted by marching cubes [Lorensen and Cline 1987] and re-meshed isotropically [Botsch and Kobbelt 2004], and
    every vertex moves along its normal by noise of a third of a millimetre.

    Parameters
    ----------
    mesh
        A closed surface in metres, standing along z; small self-intersections do no harm.
    fused
        Vertices of each part in which narrow gaps are to be closed: each hand, each foot.
    n_vertices
        Number of vertices to come near to.
    random
        Source of the position of the grid and of the noise.

    Returns
    -------
    Mesh
        One closed component in the place of the original.
    """
    angle = random.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turned = mesh.vertices @ turn.T / CELL
    origin = turned.min(axis=0) - _MARGIN - random.uniform(0, 1, 3)
    points = turned - origin
    size = np.ceil(points.max(axis=0)).astype(np.int64) + _MARGIN
    crossings = np.zeros(tuple(size), dtype=np.int8)
    _count_crossings(points, mesh.faces, crossings)
    # Sum of signed crossings below a point: its winding number, which is 2 where two parts overlap.
    solid = np.cumsum(crossings, axis=2, dtype=np.int8) > 0
    for part in fused:
        _close_gaps(solid, points[part])
    skin = _remeshed(_boundary(solid), n_vertices)
    vertices = ((skin.vertices + origin) * CELL) @ turn
    return _noisy(skin.with_vertices(vertices), random)


@njit(cache=True, nogil=True)
def _count_crossings(points, faces, crossings):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Add to ``crossings[x, y, z]`` the orientation of each triangle that the line along z enters below node z.

    Rows and spans are half-open and each edge is evaluated from its lower end alone, so that no line slips between
    two triangles or meets both.
    """
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        bx, by = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
        # A line that goes up enters the solid through a triangle whose normal looks down.
        sign = 1 if ax * by - ay * bx < 0 else -1
        if points[j, 1] < points[i, 1]:
            i, j = j, i
        if points[k, 1] < points[j, 1]:
            j, k = k, j
            if points[j, 1] < points[i, 1]:
                i, j = j, i
        for row in range(int(np.ceil(points[i, 1])), int(np.ceil(points[k, 1]))):
            x0, z0 = _at_row(points, i, k, row)
            if row < points[j, 1]:
                x1, z1 = _at_row(points, i, j, row)
            else:
                x1, z1 = _at_row(points, j, k, row)
            if x1 < x0:
                x0, x1, z0, z1 = x1, x0, z1, z0
            for column in range(int(np.ceil(x0)), int(np.ceil(x1))):
                # Between the ends of the span, hence inside the grid, which leaves a margin around all points.
                height = z0 + (column - x0) / (x1 - x0) * (z1 - z0)
                crossings[column, row, int(np.ceil(height))] += sign


@njit(cache=True, nogil=True, inline="always")
def _at_row(points, low, high, row):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    share = (row - points[low, 1]) / (points[high, 1] - points[low, 1])
    x = points[low, 0] + share * (points[high, 0] - points[low, 0])
    return x, points[low, 2] + share * (points[high, 2] - points[low, 2])


def _close_gaps(solid: NDArray[np.bool_], part: Points) -> None:
    """Morphological closing by a ball in the box around a part, in place."""
    radius = _CLOSING / CELL
    low = np.maximum(np.floor(part.min(axis=0)).astype(int) - math.ceil(radius), 0)
    high = np.ceil(part.max(axis=0)).astype(int) + math.ceil(radius) + 1
    box = tuple(slice(start, stop) for start, stop in zip(low, high, strict=True))
    grown = distance_transform_edt(~solid[box]) <= radius
    solid[box] |= distance_transform_edt(grown) > radius


def _boundary(solid: NDArray[np.bool_]) -> Mesh:
    """Surface of the solid in units of voxels, by marching cubes over the cubes that hold it."""
    import igl

    density = gaussian_filter(solid.astype(np.float32), 1.0)
    inside = density > 0.5
    first = inside[:-1, :-1, :-1]
    mixed = np.zeros(first.shape, dtype=bool)
    for corner in _CORNERS[1:]:
        window = tuple(slice(offset, offset + length) for offset, length in zip(corner, first.shape, strict=True))
        mixed |= inside[window] != first
    corners = np.argwhere(mixed)[:, np.newaxis, :] + _CORNERS
    flat = np.ravel_multi_index(tuple(np.moveaxis(corners, 2, 0)), density.shape)
    used, cubes = np.unique(flat, return_inverse=True)
    nodes = np.stack(np.unravel_index(used, density.shape), axis=1).astype(np.float64)
    values = density.ravel()[used].astype(np.float64)
    vertices, faces, _ = igl.marching_cubes(values, nodes, cubes.reshape(-1, 8).astype(np.int64), 0.5)
    # libigl orients the triangles towards larger values, that is inwards.
    return largest_component(Mesh(vertices, faces[:, ::-1]))


def _remeshed(mesh: Mesh, n_vertices: int) -> Mesh:
    # n vertices of equilateral triangles with side s cover n s^2 sqrt(3) / 2; the edges come out a little longer.
    side = 0.97 * math.sqrt(mesh.area / n_vertices * 2 / math.sqrt(3))
    return isotropic_remesh(mesh, side, iterations=3, feature_degrees=180)


def _noisy(mesh: Mesh, random: np.random.Generator) -> Mesh:
    white, smooth = random.normal(0, 1, (2, mesh.n_vertices))
    smooth = _neighbour_mean(mesh, _neighbour_mean(mesh, smooth))
    amount = _WHITE * white + _SMOOTH * smooth / smooth.std()
    return mesh.with_vertices(np.round(mesh.vertices + amount[:, np.newaxis] * vertex_normals(mesh), 6))


def _neighbour_mean(mesh: Mesh, values: NDArray[np.float64]) -> NDArray[np.float64]:
    tails, heads = sides_of(mesh.faces)
    sums = np.bincount(tails, values[heads], mesh.n_vertices) + values
    return np.asarray(sums / (np.bincount(tails, minlength=mesh.n_vertices) + 1))


def vertex_normals(mesh: Mesh) -> Points:
    """Unit normals of the vertices, shape (n, 3): means over the faces, weighted by area."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.zeros((mesh.n_vertices, 3))
    np.add.at(normals, mesh.faces.ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))
