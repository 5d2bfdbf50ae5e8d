"""Frames of a depth camera.

From depths, intrinsics and mask to the surface of the object, upright and in metres.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.depth.filling import WIDEST, averages, filled, in_gaps_of_mask
from benchmark.depth.intrinsics import Intrinsics, Rays, find_intrinsics, read_intrinsics
from benchmark.depth.neighbours import (
    HOW_TO_RESIZE,
    MOST_DEAD,
    MOST_FLYING,
    dead_lines,
    jump,
    on_surface,
    without_flying_pixels,
)
from benchmark.depth.reading import (
    FEWEST_SEEN,
    Depths,
    Mask,
    checked_mask,
    find_mask,
    in_metres,
    read_mask,
    read_values,
    usual_scale,
)
from benchmark.depth.segmentation import Plane, background_planes, find_object
from benchmark.errors import DepthError
from benchmark.files import named_errors
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Faces, FloatArray, Mesh, Points

HALF_WIDTH = 1.285
"""Half the frame width of the human data sets in metres, the reference scale of ``literal`` and
``wide``."""

UPRIGHT = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
"""The orthographic camera in front of the surface of an object."""

IMAGE_UP = np.array([0.0, -1.0, 0.0])
"""Default up direction in the camera's frame (right, down, forward)."""

FLOOR = np.cos(np.radians(50))
"""Minimum cosine of the angle between the normal of a floor and the up direction of the image."""

MOST_TILTED = np.cos(np.radians(75))
"""Minimum cosine of the angle between a given up direction and the image plane."""

FEWEST_SURE = 3000
"""Number of readings of an object below which its form depends on where its pixels lie.

Chosen on eight frames (results/experiments/README.md): with fewer, classical forms of the same body
in two samplings differ by more than twice as much as those of two measurements."""

MOST_AVERAGED = 0.05
"""Averages with missing pixels per reading of the object above which an image was averaged.

A camera measures less than .02."""

_PLANE_STEP = 2
"""Pixel stride of the subsampled image in which planes are detected."""

Up = Sequence[float]

Pixels = tuple[NDArray[Any], ...]
"""Places in an image, as :func:`numpy.ix_` gives them."""


@dataclass(frozen=True, eq=False)
class ObservedObject:
    """The object in a frame.

    Parameters
    ----------
    depths
        Depth image, shape (h, w), metres; 0 for missing depth. Between pixels of the object,
        missing ones are filled.
    mask
        Pixels of the object, filled ones included, shape (h, w).
    surface
        Surface of the object in metres: right, up, towards the camera, which looks level.
    notes
        Details of the detection: ``mask`` ("found", "given" or its file), ``up`` ("floor",
        "sidecar" or "image"), ``planes``, ``object_pixels``, ``flying_pixels`` (dropped),
        ``filled_pixels`` (which had no reading), ``distance`` (median depth) and ``size`` (longest
        side), in metres; of files also ``unit`` and ``camera``.
    doubts
        Why its form may be wrong, each with what to do.
    """

    depths: Depths
    mask: Mask
    surface: Mesh
    notes: dict[str, float | str]
    doubts: tuple[tuple[str, str], ...] = ()


def observe(
    depths: Depths,
    intrinsics: Intrinsics,
    mask: NDArray[Any] | None = None,
    up: Up | None = None,
    half_width: float = HALF_WIDTH,
) -> ObservedObject:
    """Find the object in a depth image, and return its pixels and its surface.

    Without a mask, the object is the nearest large piece before the background. Flying pixels are
    dropped, gaps are filled, and the surface is turned upright.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    intrinsics
        Intrinsics of the camera.
    mask
        Shape (h, w), nonzero on the object; None to find the object, see
        :mod:`benchmark.depth.segmentation`.
    up
        Up direction in the camera's frame (right, down, forward), used if no floor is detected;
        None for the up direction of the image.
    half_width
        Half the side of the frame that the object must fit, in metres.

    Raises
    ------
    DepthError
        If intrinsics or mask do not match the image, no object is found, or it is larger than the
        frame.
    """
    height, width = depths.shape
    intrinsics.check_size(width, height)
    rays = intrinsics.rays(width, height)
    points = unprojected(depths, rays)
    # An image that was registered to another camera has rows and columns without any reading: they
    # are left out of the search.
    dead_rows, dead_columns = dead_lines(depths > 0)
    live = np.ix_(~dead_rows, ~dead_columns)
    if mask is None:
        pixels = _find_pixels(depths, points, live)
    else:
        pixels = _pixels_of_mask(depths, points, live, checked_mask(mask, depths > 0))
    _check_count(pixels.kept)

    # Gaps between the readings of the object are filled, up to a width in pixels.
    distance = float(np.median(depths[pixels.kept]))
    widest = int(WIDEST * max(intrinsics.fx, intrinsics.fy) / distance)
    certainly_missing = _certainly_missing(dead_rows, dead_columns)
    # Depths that a program averaged with missing ones are replaced like gaps.
    averaged = averages(depths, pixels.kept, pixels.dropped & ~pixels.kept)
    completed = filled(depths, pixels.kept, averaged, pixels.mask, certainly_missing, widest)
    is_object = completed > 0

    direction, up_source = _up_direction(pixels.planes, up)
    surface = object_surface(completed, rays, is_object, upright_rotation(direction), half_width)
    n_pixels = int(np.count_nonzero(pixels.kept))
    n_filled = int(np.count_nonzero(is_object)) - n_pixels
    notes = _notes(pixels, up_source, n_filled, distance, surface)
    n_averaged = int(np.count_nonzero(averaged & (pixels.chosen | is_object)))
    return ObservedObject(
        depths=np.where(is_object, completed, depths),
        mask=is_object,
        surface=surface,
        notes=notes,
        doubts=_doubts(n_pixels, n_averaged),
    )


class _Pixels(NamedTuple):
    """The pixels of an object, and the planes around it.

    Parameters
    ----------
    mask
        The object as a user passes it, with pixels without a reading; None if it was found.
    chosen
        Readings in the mask, or in the piece that was found.
    kept
        Readings on the surface of the object, also in gaps of the mask.
    dropped
        Readings that may be on no surface.
    n_flying
        Number of chosen readings on no surface.
    planes
        Planes of the background.
    """

    mask: Mask | None
    chosen: Mask
    kept: Mask
    dropped: Mask
    n_flying: int
    planes: list[Plane]


def _certainly_missing(dead_rows: Mask, dead_columns: Mask) -> Mask:
    """Return the pixels whose depth is missing whatever lies there, shape (h, w).

    They are those of rows and columns without any reading. If these are many, the image was
    registered to a larger one, and what lies between its readings may be anything: then there are
    none.

    Parameters
    ----------
    dead_rows, dead_columns
        Rows and columns of the image without a reading, shapes (h,) and (w,).
    """
    dead = dead_rows[:, None] | dead_columns
    if dead.mean() > MOST_DEAD:
        dead[:] = False
    return np.asarray(dead)


def _find_pixels(depths: Depths, points: Points, live: Pixels) -> _Pixels:
    """Find the pixels of the object in an image without a mask.

    The object is the nearest large piece before the background.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    points
        Point of each pixel in the camera's frame, shape (h, w, 3), metres.
    live
        Index of the rows and columns that have any readings, as from ``numpy.ix_``.

    Raises
    ------
    DepthError
        If no piece is large enough, or the depth jumps between too many pixels.
    """
    seen = depths > 0
    planes = _planes(points[live], seen[live])
    chosen = np.zeros_like(seen)
    chosen[live] = find_object(points[live], seen[live], planes)
    _check_count(chosen)
    kept = on_surface(depths, chosen)
    dropped = seen & ~without_flying_pixels(depths, seen)
    if np.count_nonzero(dropped) > MOST_FLYING * np.count_nonzero(seen):
        raise DepthError("the depth jumps between too many pixels of the image", HOW_TO_RESIZE)
    n_flying = int(np.count_nonzero(chosen & ~kept))
    return _Pixels(
        mask=None, chosen=chosen, kept=kept, dropped=dropped, n_flying=n_flying, planes=planes
    )


def _pixels_of_mask(depths: Depths, points: Points, live: Pixels, mask: Mask) -> _Pixels:
    """Return the pixels of the object in an image with a mask.

    These are the readings in the mask, and those in gaps of the mask that continue their surface.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    points
        Point of each pixel in the camera's frame, shape (h, w, 3), metres.
    live
        Index of the rows and columns that have any readings, as from ``numpy.ix_``.
    mask
        Pixels of the object, with and without a reading, shape (h, w).

    Raises
    ------
    DepthError
        If few readings lie in the mask, or few of them on the surface of the object.
    """
    seen = depths > 0
    chosen = mask & seen
    _check_count(chosen)
    kept = on_surface(depths, chosen)
    n_flying = int(np.count_nonzero(chosen & ~kept))
    in_gaps = in_gaps_of_mask(depths, kept)
    # Planes are needed for the floor alone, so they are searched outside of the object.
    planes = _planes(points[live], (seen & ~mask & ~in_gaps)[live])
    in_gaps &= ~_on_planes(points, planes)  # through a gap, the floor may be seen
    return _Pixels(
        mask=mask,
        chosen=chosen,
        kept=kept | in_gaps,
        dropped=chosen,
        n_flying=n_flying,
        planes=planes,
    )


def _notes(
    pixels: _Pixels, up_source: str, n_filled: int, distance: float, surface: Mesh
) -> dict[str, float | str]:
    """Return what a report says of an object in a depth image, by name.

    Parameters
    ----------
    pixels
        The pixels of the object.
    up_source
        Where its up direction comes from.
    n_filled
        Number of pixels without a reading whose depths were filled in.
    distance
        Median depth of the object, in metres.
    surface
        Its surface, in metres.
    """
    return {
        "mask": "found" if pixels.mask is None else "given",
        "up": up_source,
        "planes": float(len(pixels.planes)),
        "object_pixels": float(np.count_nonzero(pixels.kept)),
        "flying_pixels": float(pixels.n_flying),
        "filled_pixels": float(n_filled),
        "distance": round(distance, 4),
        "size": round(float(np.ptp(surface.vertices, axis=0).max()), 4),
    }


def _doubts(n_pixels: int, n_averaged: int) -> tuple[tuple[str, str], ...]:
    """Return the reasons for which the form of an object may be wrong, each with a remedy.

    Parameters
    ----------
    n_pixels
        Number of readings on the object.
    n_averaged
        Number of those that a program averaged with missing ones when it resized the image.
    """
    doubts = []
    if n_pixels < FEWEST_SURE:
        doubt = f"the object shows {n_pixels} pixels, so its form depends on where they lie"
        doubts.append((doubt, f"go nearer, until it shows {FEWEST_SURE}"))
    if n_averaged > MOST_AVERAGED * n_pixels:
        doubt = (
            f"{n_averaged} depths of the object were averaged with missing ones,"
            " so its edges were averaged, too"
        )
        doubts.append((doubt, HOW_TO_RESIZE))
    return tuple(doubts)


def _check_count(mask: Mask) -> None:
    """Raise ``DepthError`` if an object shows too few pixels for a surface."""
    if (count := np.count_nonzero(mask)) < FEWEST_SEEN:
        problem = f"the object shows {count} pixels, fewer than {FEWEST_SEEN}"
        raise DepthError(problem, "go nearer, or check the mask")


def _planes(points: Points, seen: Mask) -> list[Plane]:
    """Return the planes of the background, found in a subsampled image."""
    coarse = np.s_[::_PLANE_STEP, ::_PLANE_STEP]
    return background_planes(points[coarse], seen[coarse])


def _on_planes(points: Points, planes: Sequence[Plane]) -> Mask:
    """Return which points, shape (h, w, 3), lie on one of the planes."""
    result = np.zeros(points.shape[:2], dtype=bool)
    for plane in planes:
        result |= plane.holds(points)
    return result


def scale_of(
    values: NDArray[Any], intrinsics: Intrinsics, scale: float | None = None
) -> float | None:
    """Return the units per metre of an image; None for the usual ones.

    They are those passed, or those that the file of the camera states.

    Parameters
    ----------
    values
        Shape (h, w), in units of the image.
    intrinsics
        The camera.
    scale
        Units per metre, if they are passed.

    Raises
    ------
    DepthError
        If the file's is neither a unit nor, in any of its readings, the usual scale of the image's
        type.
    """
    if scale is not None:
        return scale
    readings = intrinsics.scales
    if len(readings) > 1 and not np.isclose(readings, usual_scale(values)).any():
        listed = " or ".join(f"{unit:g}" for unit in dict.fromkeys(readings))
        problem = f"the depth scale of the camera file may mean {listed} units per metre"
        hint = "pass --depth-scale with the units per metre, or depth_scale in dataset.toml"
        raise DepthError(problem, hint)
    return readings[0] if len(readings) == 1 else None


def _up_direction(planes: Sequence[Plane], recorded: Up | None) -> tuple[FloatArray, str]:
    """Return the up direction in the camera's frame, and its source.

    The source is the lowest floor, a file, or the image.
    """
    floors = [plane for plane in planes if -plane.normal[1] >= FLOOR]
    if floors:
        lowest = min(floors, key=lambda plane: plane.offset)
        return lowest.normal, "floor"
    if recorded is not None:
        return checked_up(recorded), "sidecar"
    return IMAGE_UP, "image"


def checked_up(direction: Up) -> FloatArray:
    """Return an up direction as a unit vector.

    Parameters
    ----------
    direction
        Three numbers, right, down and forward in the camera's frame, of any length. It may come
        from a file, and hold anything.

    Raises
    ------
    DepthError
        If it is no such vector, or points nearly along the optical axis.
    """
    try:
        up = np.asarray(direction, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        up = np.empty(0)  # not usable: the error below shows what was given
    if not _is_usable_up(up):
        hint = (
            "write [right, down, forward] of the camera, such as [0, -1, 0];"
            " none if it looks straight down"
        )
        raise DepthError(f"not a usable up direction: {direction}", hint)
    return up / float(np.linalg.norm(up))


def _is_usable_up(up: FloatArray) -> bool:
    """Return whether a vector is a finite direction, and not near the optical axis."""
    if up.shape != (3,):
        return False
    length = float(np.linalg.norm(up))
    if not np.isfinite(length) or length == 0:
        return False
    return bool(np.hypot(up[0], up[1]) / length >= MOST_TILTED)


def upright_rotation(up: FloatArray) -> Points:
    """Return the rotation from the camera's frame to one in which the camera looks level.

    Its rows are right, up, and back towards the camera; ``up`` has unit length and is not along the
    optical axis.
    """
    back = np.array([0.0, 0.0, -1.0]) + up[2] * up
    back /= np.linalg.norm(back)
    return np.stack([np.cross(up, back), up, back])


def unprojected(depths: Depths, rays: Rays) -> Points:
    """Return the 3D points of pixels, shape (h, w, 3), metres: right, down, forward."""
    return np.concatenate([rays * depths[..., None], depths[..., None]], axis=-1)


def object_surface(
    depths: Depths, rays: Rays, mask: Mask, rotation: Points, half_width: float
) -> Mesh:
    """Return the surface of an object from its pixels, turned upright.

    Each pixel becomes two triangles between its four corners. The depth of a corner is the mean of
    the pixels of the object around it. Where the depth jumps, each pixel has a corner of its own,
    at the mean of the pixels on its side of the jump.

    Parameters
    ----------
    depths
        Shape (h, w), metres.
    rays
        Rays of the pixels, shape (h, w, 2): x and y at depth 1.
    mask
        Pixels of the object, shape (h, w).
    rotation
        Rotation from the camera's frame to an upright one, shape (3, 3).
    half_width
        Half the side of the frame that the object must fit, in metres.

    Raises
    ------
    DepthError
        If the surface is larger than the frame.
    """
    # Rows and columns of the object.
    bounding_box = tuple(slice(at.min(), at.max() + 1) for at in np.nonzero(mask))
    points, faces = _squares(depths[bounding_box], rays[bounding_box], mask[bounding_box])
    mesh = Mesh(points @ rotation.T, faces)
    extents = np.ptp(mesh.vertices, axis=0)
    if extents.max() >= 2 * half_width:
        size = " x ".join(f"{extent:.2f}" for extent in extents)
        problem = (
            f"the object is {size} m (width, height, depth),"
            f" more than the {2 * half_width:.2f} m of the frame"
        )
        raise DepthError(problem, "check the depth scale, or pass a mask of the object alone")
    return mesh


def _squares(depths: Depths, rays: Rays, mask: Mask) -> tuple[Points, Faces]:
    """Return the mesh of the pixels of an object, with two triangles for each pixel.

    Vertices are corners of pixels. The pixels around a corner share it, at the mean of their
    depths, unless the depth jumps between them: such a corner is *torn*, and each of its pixels has
    a vertex of its own there.

    Parameters
    ----------
    depths
        Shape (h, w), metres.
    rays
        Rays of the pixels, shape (h, w, 2): x and y at depth 1.
    mask
        Pixels of the object, shape (h, w).

    Returns
    -------
    numpy.ndarray
        Vertices in the camera's frame, shape (n, 3), metres.
    numpy.ndarray
        Triangles that face the camera, shape (m, 3).
    """
    # For each corner of the grid of pixels, the depths of the four pixels around it, and which of
    # these show the object: shape (4, h + 1, w + 1).
    around = _around_corners(depths)
    on_object = _around_corners(mask)
    is_whole = _are_within_a_jump(around, on_object)
    is_torn = on_object & ~is_whole
    n_whole = np.count_nonzero(is_whole)

    # Vertices: first the corners on one surface, then one for each pixel around a torn corner.
    numbers = np.zeros(around.shape, dtype=np.int32)
    numbers[:, is_whole] = np.arange(n_whole)
    numbers[is_torn] = n_whole + np.arange(np.count_nonzero(is_torn))

    # Their depths, and x and y on the rays through the corners.
    sums = (around * on_object).sum(axis=0)[is_whole]
    means = sums / on_object.sum(axis=0)[is_whole]
    z = np.concatenate([means, _depths_of_torn_corners(around, on_object, is_torn)])
    _, row, column = np.nonzero(is_torn)
    rays_of_corners = _rays_of_corners(rays)
    xy = np.concatenate([rays_of_corners[is_whole], rays_of_corners[row, column]]) * z[:, None]

    return np.column_stack([xy, z]), _halves_of_pixels(numbers, mask)


def _halves_of_pixels(numbers: Faces, mask: Mask) -> Faces:
    """Return two triangles for each pixel of an object, shape (m, 3), which face the camera.

    Parameters
    ----------
    numbers
        Vertices of the mesh, shape (4, h + 1, w + 1): for each corner of the grid of pixels, the
        vertex that each of the four pixels around the corner has there. The pixels come in the
        order above left, above right, below left, below right.
    mask
        Pixels of the object, shape (h, w).
    """
    # A pixel lies below and to the right of its top left corner, and so on.
    below_right, below_left, above_right, above_left = numbers[::-1]
    top_left = below_right[:-1, :-1][mask]
    bottom_left = above_right[1:, :-1][mask]
    bottom_right = above_left[1:, 1:][mask]
    top_right = below_left[:-1, 1:][mask]
    return np.concatenate(
        [
            np.stack([top_left, bottom_left, bottom_right], axis=1),
            np.stack([top_left, bottom_right, top_right], axis=1),
        ]
    )


def _around_corners(image: NDArray[Any]) -> NDArray[Any]:
    """Return the values around each pixel corner, shape (4, h + 1, w + 1); 0 outside.

    They are those above left, above right, below left and below right.
    """
    padded = np.pad(image, 1)
    above, below = padded[:-1], padded[1:]
    return np.stack([above[:, :-1], above[:, 1:], below[:, :-1], below[:, 1:]])


def _are_within_a_jump(around: Depths, held: Mask) -> Mask:
    """Return which corners have pixels of the object around them, all of one surface."""
    nearest = np.where(held, around, np.inf).min(axis=0)
    farthest = np.where(held, around, 0).max(axis=0)
    is_used = held.any(axis=0)
    limit = jump(np.where(is_used, nearest, 0))
    return np.asarray(is_used & (farthest - nearest <= limit))


def _depths_of_torn_corners(around: Depths, held: Mask, is_torn: Mask) -> Depths:
    """Return the depth of a torn corner for each pixel around it.

    It is the mean over the pixels on the same side of the jump.
    """
    _, row, column = np.nonzero(is_torn)
    own = around[is_torn]
    depths = around[:, row, column]
    is_beside = held[:, row, column] & (np.abs(depths - own) <= jump(own))
    return np.asarray((depths * is_beside).sum(axis=0) / is_beside.sum(axis=0))


def _rays_of_corners(rays: Rays) -> Rays:
    """Return the rays of pixel corners, shape (h + 1, w + 1, 2), from those of pixels.

    Rays of pixels go on beyond the image.
    """
    outer = np.pad(rays, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    total = outer[:-1, :-1] + outer[:-1, 1:] + outer[1:, :-1] + outer[1:, 1:]
    return np.asarray(total / 4)


@dataclass(frozen=True)
class FrameFiles:
    """The files and settings of a frame.

    Parameters
    ----------
    image
        Path of the depth image.
    intrinsics
        Intrinsics of the camera; None searches for a file with a usual name.
    mask
        Path of the object mask; None searches for a file with a usual name, and segments the object
        if there is none.
    scale
        Units of the image per metre; None for 1000 (integers) or 1 (floats).
    up
        Up direction in the camera's frame (right, down, forward), used if no floor is detected.
    half_width
        Half the side of the frame, in metres.
    """

    image: Path
    intrinsics: Intrinsics | None = None
    mask: Path | None = None
    scale: float | None = None
    up: Up | None = None
    half_width: float = HALF_WIDTH

    @property
    def mask_file(self) -> Path | None:
        """Path of the mask; None if there is none."""
        return self.mask or find_mask(self.image)

    @property
    def intrinsics_file(self) -> Path | None:
        """Path of the file that holds intrinsics or depth scale.

        None if both are passed, or it is missing. Intrinsics may state the scale themselves.
        """
        if self.intrinsics and (self.scale or self.intrinsics.scales):
            return None
        return find_intrinsics(self.image)

    @property
    def stated_scales(self) -> tuple[float, ...]:
        """Units per metre that the user or the file of the camera states; empty if neither does.

        There are several if the number in the file may mean any of them.

        Raises
        ------
        DepthError
            If there are no intrinsics, or their file cannot be read.
        """
        if self.scale is not None:
            return (self.scale,)
        return self._camera().scales

    def observe(self) -> ObservedObject:
        """Read the image, its intrinsics and its mask, and return the object that it shows.

        Raises
        ------
        DepthError
            If a file is faulty, or no object is found; the error names the file.
        """
        values = read_values(self.image)
        mask_file = self.mask_file
        camera = self._camera()
        mask = read_mask(mask_file) if mask_file else None
        with named_errors(self.image, "depth image", DepthError, "export the image again"):
            scale = scale_of(values, camera, self.scale)
            depths = in_metres(values, scale)
            observed = observe(depths, camera, mask, self.up, self.half_width)
        notes = observed.notes | {
            "unit": self._unit_in_words(values, scale),
            "camera": self._camera_in_words(),
        }
        if mask_file:
            notes["mask"] = mask_file.name
        return replace(observed, notes=notes)

    @staticmethod
    def _unit_in_words(values: NDArray[Any], scale: float | None) -> str:
        """Return the unit of an image."""
        if scale:
            return f"1 / {scale:g} m"
        return f"assumed 1 / {usual_scale(values):g} m"

    def _camera_in_words(self) -> str:
        """Return the file of the camera as seen from the image."""
        if self.intrinsics:
            return "given"
        return os.path.relpath(self.intrinsics_file or "", self.image.parent)

    def _camera(self) -> Intrinsics:
        """Return the intrinsics that were passed, or else those of the file beside the image.

        Raises
        ------
        DepthError
            If nothing was passed, and there is no file or it cannot be read.
        """
        file = self.intrinsics_file
        if self.intrinsics is None:
            if file is None:
                hint = (
                    "put camera.json beside it, or pass --intrinsics fx,fy,cx,cy;"
                    " for a folder, write dataset.toml"
                )
                raise DepthError("there are no intrinsics", hint, self.image)
            return read_intrinsics(file)
        if file is None:
            return self.intrinsics
        # Intrinsics that were passed lack the unit of depths, which the file may state. The file is
        # not needed otherwise, so that it may be of any kind.
        with suppress(DepthError):
            return replace(self.intrinsics, scales=read_intrinsics(file).scales)
        return self.intrinsics
