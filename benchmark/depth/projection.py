"""From the pixels of an object to its surface in metres, upright, as an orthographic camera before it sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.depth.errors import NoObject
from benchmark.depth.intrinsics import Rays
from benchmark.depth.mask import Mask
from benchmark.depth.reading import FEWEST_SEEN
from benchmark.depth.segmentation import jump
from benchmark.geometry.camera import Camera
from benchmark.geometry.cleaning import compact
from benchmark.geometry.mesh import Mesh, Points

HALF_WIDTH = 1.285
"""Half the width of the frame of the humans in metres, which ``literal`` and ``wide`` know their scale by."""

UPRIGHT = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
"""The orthographic camera before a surface of :func:`object_surface`."""

FRAME = np.diag([1.0, -1.0, -1.0])
"""From the camera's frame (right, down, forward) to that of the suite (right, up, towards the camera)."""

_LEAST_SUPPORT = 3
"""Neighbours of eight on the same surface, without which a pixel flies."""


def unprojected(depths: NDArray[np.float64], rays: Rays) -> Points:
    """Return the points behind pixels, shape (h, w, 3), metres: right, down, forward.

    Parameters
    ----------
    depths
        Shape (h, w), metres along the optical axis.
    rays
        See :meth:`benchmark.depth.intrinsics.Intrinsics.rays`.
    """
    points = np.empty((*depths.shape, 3))
    points[..., :2] = rays * depths[..., None]
    points[..., 2] = depths
    return points


def without_flying_pixels(depths: NDArray[np.float64], mask: Mask) -> Mask:
    """Return a mask without the pixels that lie between two surfaces, as cameras measure at edges.

    Such a pixel has few neighbours of its own depth.

    Parameters
    ----------
    depths
        Shape (h, w), metres.
    mask
        Pixels of the object, shape (h, w).
    """
    padded, inside = np.pad(depths, 1), np.pad(mask, 1)
    height, width = depths.shape
    limit = jump(depths)
    support = np.zeros(depths.shape, dtype=np.int8)
    for down in range(3):
        for right in range(3):
            if (down, right) != (1, 1):
                window = (slice(down, down + height), slice(right, right + width))
                support += inside[window] & (np.abs(padded[window] - depths) <= limit)
    return np.asarray(mask & (support >= _LEAST_SUPPORT))


def upright(up: NDArray[np.float64]) -> Points:
    """Return the rotation from the camera's frame to one in which ``up`` is up and the camera looks level.

    Parameters
    ----------
    up
        What is up in the camera's frame (right, down, forward), shape (3,); not along the optical axis.

    Returns
    -------
    numpy.ndarray
        Shape (3, 3); its rows are right, up, and back towards the camera.
    """
    y = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    back = np.array([0.0, 0.0, -1.0])
    back = back - (back @ y) * y
    back /= np.linalg.norm(back)
    return np.stack([np.cross(y, back), y, back])


def object_surface(points: Points, mask: Mask, rotation: Points, half_width: float = HALF_WIDTH) -> Mesh:
    """Return the surface behind the pixels of an object.

    Each 2 x 2 block gives two triangles, or one where a pixel is missing; those across a depth jump are left out, and
    so is what no triangle holds.

    Parameters
    ----------
    points
        Shape (h, w, 3), metres in the camera's frame.
    mask
        Pixels of the object, shape (h, w).
    rotation
        From :func:`upright`.
    half_width
        Half the side of the frame, in metres.

    Raises
    ------
    NoObject
        If the pixels are too few, or their surface is larger than the frame.
    """
    if np.count_nonzero(mask) < FEWEST_SEEN:
        raise NoObject(
            f"the object shows {np.count_nonzero(mask)} pixels, fewer than {FEWEST_SEEN}",
            "go nearer, or check the mask",
        )
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    mask, points = mask[part], points[part]
    faces = _triangles(points[..., 2], mask)
    if len(faces) < FEWEST_SEEN:
        raise NoObject("the pixels of the object hold no surface in one piece", "check the mask and the depth scale")
    mesh = compact(points.reshape(-1, 3), faces)
    mesh = mesh.with_vertices(mesh.vertices @ rotation.T)
    extents = np.ptp(mesh.vertices, axis=0)
    if extents.max() >= 2 * half_width:
        size = " x ".join(f"{extent:.2f}" for extent in extents)
        raise NoObject(
            f"the object is {size} m (width, height, depth), more than the {2 * half_width:.2f} m of the frame",
            "check the depth scale, or pass a mask of the object alone",
        )
    return mesh


def _triangles(depths: NDArray[np.float64], mask: Mask) -> NDArray[np.int32]:
    """Triangles over pixels, counter-clockwise as the camera sees them, without those across a jump."""
    index = np.arange(depths.size, dtype=np.int32).reshape(depths.shape)
    a, b, c, d = (block.ravel() for block in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    some = mask.ravel()[np.stack([a, b, c, d])].sum(axis=0) >= 3
    a, b, c, d = (corner[some] for corner in (a, b, c, d))
    inside, z = mask.ravel(), depths.ravel()
    # The diagonal is that of the smaller depth difference; through a missing pixel it is no choice.
    along_ac = np.where(inside[a] & inside[c], np.abs(z[a] - z[c]), np.inf)
    along_bd = np.where(inside[b] & inside[d], np.abs(z[b] - z[d]), np.inf)
    split = (along_ac <= along_bd)[:, None]
    first = np.where(split, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(split, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    faces = np.concatenate([first, second])
    corners = z[faces]
    nearest = corners.min(axis=1)
    kept = inside[faces].all(axis=1) & (corners.max(axis=1) - nearest <= jump(nearest))
    return np.asarray(faces[kept], dtype=np.int32)
