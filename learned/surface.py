"""Surfaces behind predicted depth images."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from benchmark.errors import UnsupportedShape
from benchmark.geometry.depth import SAMPLES, SIZE, DepthImage, back_project
from benchmark.geometry.mesh import Mesh

Notes = dict[str, float | str]

THINNEST = 0.004
"""Smallest distance between front and back, as a share of half the frame.

It is less than that between two samples, so that a surface is thin, not inside out, where its
predicted sides cross.
"""


def open_surface(front: DepthImage) -> tuple[Mesh, Notes]:
    """Return the surface of unit area behind a predicted image, and notes about it.

    It is sampled like the view input. In a camera image, only a jump in depth shows that one part
    hides another, so the view input is cut at jumps. A predicted image has a mask that was trained
    to show the surface, and its depth noise is as large as such jumps: cuts would tear the surface
    to pieces.

    Parameters
    ----------
    front
        Depth image, shape (500, 500), 0 outside the predicted mask.

    Raises
    ------
    UnsupportedShape
        If the image is empty.
    """
    _check_mask(front)
    surface, report = back_project(front, 1.0, jump=math.inf)
    return surface.with_vertices(surface.vertices / surface.area**0.5), _notes(report)


def closed_surface(front: DepthImage, back: DepthImage) -> tuple[Mesh, Notes]:
    """Return the closed surface between two depth images, of unit area, and notes about it.

    The front becomes a connected surface. The back gets the same triangles, turned round, and walls
    of triangles join the borders of both. So the surface is closed whatever the images contain.

    Parameters
    ----------
    front
        Depth of the nearest surface, shape (500, 500), 0 outside the mask.
    back
        Depth of the farthest surface from the same viewpoint, shape (500, 500).

    Raises
    ------
    UnsupportedShape
        If the mask is empty.
    """
    _check_mask(front)
    seen = front > 0
    # Each side gets half of the vertices of a form.
    stride = max(1, round(math.sqrt(np.count_nonzero(seen) / (SAMPLES / 2))))
    side, report = back_project(front, 1.0, stride=stride, jump=math.inf)
    # The back is behind the front by at least a least thickness, where the images cross, too.
    farthest = side.vertices[:, 2] - THINNEST
    behind = np.minimum(2 * _below(side.vertices, back, seen) - 1, farthest)
    twins = np.column_stack([side.vertices[:, :2], behind])
    surface = Mesh(np.concatenate([side.vertices, twins]), _joined(side))
    notes = _notes(report)
    notes["predicted_crossings"] = float(np.mean(behind == farthest))
    return surface.with_vertices(surface.vertices / surface.area**0.5), notes


def _check_mask(front: DepthImage) -> None:
    """Raise ``UnsupportedShape`` if the mask is empty."""
    if not front.any():
        problem = "the network predicts an empty mask"
        raise UnsupportedShape(problem, "train it for longer or on shapes like this one")


def _notes(report: Mapping[str, float]) -> Notes:
    """Return what a form says of the report of its back-projection."""
    return {f"predicted_{name}": report[name] for name in ("foreground", "pieces", "bridges")}


def _below(
    vertices: NDArray[np.float64], back: DepthImage, seen: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the depth of the back at vertices of the front.

    On bridges outside the mask, it is that at the nearest pixel of the mask.
    """
    rows, columns = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    # Vertices are centres of pixels, so rounding down is far from a tie.
    pixels = ((vertices[:, :2] * [1, -1] + 1) * (SIZE / 2)).astype(np.int64)
    column, row = np.clip(pixels, 0, SIZE - 1).T
    return np.asarray(back[rows[row, column], columns[row, column]], dtype=np.float64)


def _joined(side: Mesh) -> NDArray[np.int32]:
    """Return the triangles of a closed surface: the front, the back, and the walls between them.

    Parameters
    ----------
    side
        The front, with n vertices. The twin of its vertex i on the back is vertex i + n.

    Returns
    -------
    numpy.ndarray
        Vertex indices, shape (m, 3).
    """
    n_vertices = side.n_vertices
    tails = side.faces.ravel()
    heads = np.roll(side.faces, -1, axis=1).ravel()
    # A side of a triangle lies on a border if no other triangle has it in the opposite direction.
    # Both ends of a side are joined to one number for that search.
    forward = tails.astype(np.int64) * n_vertices + heads
    backward = heads.astype(np.int64) * n_vertices + tails
    is_border = ~np.isin(forward, backward)
    # Each border side from i to j becomes a wall of two triangles to its twin on the back.
    i = tails[is_border]
    j = heads[is_border]
    i_back = i + n_vertices
    j_back = j + n_vertices
    wall = np.concatenate([np.stack([j, i, i_back], axis=1), np.stack([j, i_back, j_back], axis=1)])
    back = side.faces[:, ::-1] + n_vertices
    return np.concatenate([side.faces, back, wall]).astype(np.int32)
