"""From the pixels of an object to its upright surface in metres, ready for an orthographic camera in front of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.depth.errors import NoObject
from benchmark.depth.intrinsics import Rays
from benchmark.depth.reading import FEWEST_SEEN, Mask
from benchmark.depth.segmentation import jump
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Mesh, Points

HALF_WIDTH = 1.285
"""Half the frame width of the human data sets in metres, the reference scale of ``literal`` and ``wide``."""

UPRIGHT = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
"""The orthographic camera in front of a surface from :func:`object_surface`."""

FRAME = np.diag([1.0, -1.0, -1.0])
"""Transform from the camera's frame (right, down, forward) to the suite's (right, up, towards the camera)."""

_LEAST_SUPPORT = 3
"""Minimum number of the eight neighbours on the same surface; a pixel with fewer is a flying pixel."""


def unprojected(depths: NDArray[np.float64], rays: Rays) -> Points:
    """Return the 3D points of pixels, shape (h, w, 3), metres: right, down, forward.

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
    """Return a mask without flying pixels, which cameras measure between two surfaces at depth edges.

    A flying pixel has few neighbours at its own depth.

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
    """Return the rotation from the camera's frame to an upright frame in which the camera looks level.

    Parameters
    ----------
    up
        Up direction in the camera's frame (right, down, forward), shape (3,); not along the optical axis.

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


def object_surface(
    depths: NDArray[np.float64], rays: Rays, mask: Mask, rotation: Points, half_width: float = HALF_WIDTH
) -> Mesh:
    """Return the surface of an object from its pixels.

    Each pixel yields two triangles between its corners. The depth of a corner is the mean over the adjacent object
    pixels; at a depth jump, each pixel gets its own corner, with the mean over the adjacent pixels on its side.

    Parameters
    ----------
    depths
        Shape (h, w), metres.
    rays
        Rays of the pixels, shape (h, w, 2); see :meth:`benchmark.depth.intrinsics.Intrinsics.rays`.
    mask
        Pixels of the object, shape (h, w).
    rotation
        From :func:`upright`.
    half_width
        Half the side of the frame, in metres.

    Raises
    ------
    NoObject
        If there are too few pixels, or the surface is larger than the frame.
    """
    if np.count_nonzero(mask) < FEWEST_SEEN:
        raise NoObject(
            f"the object shows {np.count_nonzero(mask)} pixels, fewer than {FEWEST_SEEN}",
            "go nearer, or check the mask",
        )
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    points, faces = _squares(depths[part], rays[part], mask[part])
    mesh = Mesh(points @ rotation.T, faces)
    extents = np.ptp(mesh.vertices, axis=0)
    if extents.max() >= 2 * half_width:
        size = " x ".join(f"{extent:.2f}" for extent in extents)
        raise NoObject(
            f"the object is {size} m (width, height, depth), more than the {2 * half_width:.2f} m of the frame",
            "check the depth scale, or pass a mask of the object alone",
        )
    return mesh


def _squares(depths: NDArray[np.float64], rays: Rays, mask: Mask) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return pixel corners in the camera's frame, shape (n, 3), and two camera-facing triangles per pixel."""
    padded, inside = np.pad(depths, 1), np.pad(mask, 1)
    # The pixels around each corner: above left, above right, below left, below right.
    windows = [(slice(a, a + depths.shape[0] + 1), slice(b, b + depths.shape[1] + 1)) for a in (0, 1) for b in (0, 1)]
    around, held = np.stack([padded[window] for window in windows]), np.stack([inside[window] for window in windows])
    nearest = np.where(held, around, np.inf).min(axis=0)
    farthest = np.where(held, around, 0).max(axis=0)
    used = held.any(axis=0)
    whole = used & (farthest - nearest <= jump(np.where(used, nearest, 0)))
    numbers = np.zeros(around.shape, dtype=np.int32)
    numbers[:, whole] = np.arange(np.count_nonzero(whole))
    torn = held & (used & ~whole)
    numbers[torn] = np.count_nonzero(whole) + np.arange(np.count_nonzero(torn))
    means = (around * held).sum(axis=0)[whole] / held.sum(axis=0)[whole]
    places = np.nonzero(torn)
    members, own = around[:, places[1], places[2]], around[torn]
    side = held[:, places[1], places[2]] & (np.abs(members - own) <= jump(own))
    z = np.concatenate([means, (members * side).sum(axis=0) / side.sum(axis=0)])
    outer = np.pad(rays, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    of_corners = (outer[:-1, :-1] + outer[:-1, 1:] + outer[1:, :-1] + outer[1:, 1:]) / 4
    xy = np.concatenate([of_corners[whole], of_corners[places[1], places[2]]]) * z[:, None]
    a, b, c, d = (
        numbers[member, down : down + mask.shape[0], right : right + mask.shape[1]][mask]
        for member, down, right in ((3, 0, 0), (1, 1, 0), (0, 1, 1), (2, 0, 1))
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.column_stack([xy, z]), faces
