"""Front and back of a body become one closed surface, joined along the outline of the mask."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from benchmark.errors import UnsupportedShape
from benchmark.geometry.depth import SAMPLES, SIZE, DepthImage, back_project
from benchmark.geometry.mesh import Mesh

THINNEST = 0.004
"""Smallest distance of front and back, as a share of half the frame: less than that of two samples, so that a surface
whose predicted sides cross is thin there and not inside out."""


def closed_surface(front: DepthImage, back: DepthImage) -> tuple[Mesh, dict[str, float | str]]:
    """Closed surface of unit area behind two depth images, and facts about it.

    The front is triangulated as a view is, nothing cut inside the mask and its pieces joined by bridges; the back gets
    the same triangles, turned over; a wall of triangles runs along each border. So the surface is closed whatever the
    images hold.

    Parameters
    ----------
    front, back
        Depth of the nearest and of the farthest surface from the same eye, shape (500, 500), 0 outside the mask of
        the front.

    Raises
    ------
    UnsupportedShape
        If the mask is empty.
    """
    seen = front > 0
    if not seen.any():
        raise UnsupportedShape("the network predicts an empty mask", "train it for longer or on shapes like this one")
    # Each side gets half of the vertices that a form should have.
    stride = max(1, round(math.sqrt(np.count_nonzero(seen) / (SAMPLES / 2))))
    side, report = back_project(front, 1.0, stride=stride, jump=math.inf)
    behind = np.minimum(2 * _below(side.vertices, back, seen) - 1, side.vertices[:, 2] - THINNEST)
    twins = np.column_stack([side.vertices[:, :2], behind])
    surface = Mesh(np.concatenate([side.vertices, twins]), _joined(side))
    notes: dict[str, float | str] = {
        "predicted_foreground": report.foreground,
        "predicted_pieces": report.pieces,
        "predicted_bridges": report.bridges,
        "predicted_crossings": float(np.mean(behind == side.vertices[:, 2] - THINNEST)),
    }
    return surface.with_vertices(surface.vertices / surface.area**0.5), notes


def _below(vertices: NDArray[np.float64], back: DepthImage, seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Depth of the back at vertices of the front; beside the mask, where bridges are, that of the nearest pixel."""
    rows, columns = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    # Vertices are centres of pixels, so rounding down is far from a tie.
    column, row = np.clip(((vertices[:, :2] * [1, -1] + 1) * (SIZE / 2)).astype(np.int64), 0, SIZE - 1).T
    return np.asarray(back[rows[row, column], columns[row, column]], dtype=np.float64)


def _joined(side: Mesh) -> NDArray[np.int32]:
    """Triangles of the front, of the back, and of the wall along every border, shape (m, 3)."""
    count = side.n_vertices
    tails, heads = side.faces.ravel(), np.roll(side.faces, -1, axis=1).ravel()
    forward = tails.astype(np.int64) * count + heads
    single = ~np.isin(forward, heads.astype(np.int64) * count + tails)
    i, j = tails[single], heads[single]
    wall = np.concatenate([np.stack([j, i, i + count], axis=1), np.stack([j, i + count, j + count], axis=1)])
    return np.concatenate([side.faces, side.faces[:, ::-1] + count, wall]).astype(np.int32)
