"""A frame of a depth camera: from depths, intrinsics and mask to the surface of its object, upright and in metres."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.depth import reading
from benchmark.depth.filling import WIDEST, averages, filled, in_gaps_of_mask
from benchmark.depth.intrinsics import Intrinsics, Rays, find_intrinsics, read_intrinsics
from benchmark.depth.neighbours import (
    AVERAGED,
    MOST_DEAD,
    MOST_FLYING,
    dead_lines,
    jump,
    on_surface,
    without_flying_pixels,
)
from benchmark.depth.reading import Depths, Mask
from benchmark.depth.segmentation import Plane, background_planes, find_object
from benchmark.errors import DepthError
from benchmark.files import named_errors
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Faces, FloatArray, Mesh, Points

HALF_WIDTH = 1.285
"""Half the frame width of the human data sets in metres, the reference scale of ``literal`` and ``wide``."""

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
"""Readings that are averages with missing pixels, per reading of the object, above which the image was averaged; a
camera measures less than .02."""

_PLANE_STEP = 2
"""Pixel stride of the subsampled image in which planes are detected."""

Up = Sequence[float]


@dataclass(frozen=True, eq=False)
class ObservedObject:
    """The object in a frame.

    Parameters
    ----------
    depths
        Depth image, shape (h, w), metres; 0 for missing depth. Between pixels of the object, missing
        ones are filled.
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
    """Return the object of a depth image.

    Parameters
    ----------
    depths
        Shape (h, w), metres; 0 for missing depth.
    intrinsics
        Intrinsics of the camera.
    mask
        Shape (h, w), nonzero on the object; None segments the object, see
        :mod:`benchmark.depth.segmentation`.
    up
        Up direction in the camera's frame (right, down, forward), used if no floor is detected;
        None for the image's.
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
    seen, rays = depths > 0, intrinsics.rays(width, height)
    points = unprojected(depths, rays)
    dead_rows, dead_columns = dead_lines(seen)
    live = np.ix_(~dead_rows, ~dead_columns)
    if mask is None:
        whole = None
        planes = _planes(points[live], seen[live])
        chosen = np.zeros_like(seen)
        chosen[live] = find_object(points[live], seen[live], planes)
        _check_count(chosen)
        kept = on_surface(depths, chosen)
        dropped = seen & ~without_flying_pixels(depths, seen)
        if np.count_nonzero(dropped) > MOST_FLYING * np.count_nonzero(seen):
            raise DepthError("the depth jumps between too many pixels of the image", AVERAGED)
        beside = np.zeros_like(seen)
    else:
        whole = reading.checked_mask(mask, seen)
        chosen = dropped = whole & seen
        _check_count(chosen)
        kept = on_surface(depths, chosen)
        beside = in_gaps_of_mask(depths, kept)
        # The scene only has to provide the floor.
        planes = _planes(points[live], (seen & ~whole & ~beside)[live])
        beside &= ~_on_planes(points, planes)
    flying = np.count_nonzero(chosen & ~kept)
    kept = kept | beside
    _check_count(kept)
    distance = float(np.median(depths[kept]))
    widest = int(WIDEST * max(intrinsics.fx, intrinsics.fy) / distance)
    dead = dead_rows[:, None] | dead_columns
    if dead.mean() > MOST_DEAD:  # of a registered image, what lies between readings may be anything
        dead[:] = False
    averaged = averages(depths, kept, dropped & ~kept)
    completed = filled(depths, kept, averaged, whole, dead, widest)
    direction, up_source = _up(planes, up)
    surface = object_surface(completed, rays, completed > 0, upright(direction), half_width)
    notes: dict[str, float | str] = {
        "mask": "found" if mask is None else "given",
        "up": up_source,
        "planes": float(len(planes)),
        "object_pixels": float(np.count_nonzero(kept)),
        "flying_pixels": float(flying),
        "filled_pixels": float(np.count_nonzero(completed) - np.count_nonzero(kept)),
        "distance": round(distance, 4),
        "size": round(float(np.ptp(surface.vertices, axis=0).max()), 4),
    }
    n_averaged = int(np.count_nonzero(averaged & (chosen | (completed > 0))))
    doubts = _doubts(int(np.count_nonzero(kept)), n_averaged)
    return ObservedObject(
        np.where(completed > 0, completed, depths), completed > 0, surface, notes, doubts
    )


def _doubts(n_pixels: int, n_averaged: int) -> tuple[tuple[str, str], ...]:
    """Return why the form of an object may be wrong, from the numbers of its readings and of averages among them."""
    doubts = []
    if n_pixels < FEWEST_SURE:
        what = f"the object shows {n_pixels} pixels, so its form depends on where they lie"
        doubts.append((what, f"go nearer, until it shows {FEWEST_SURE}"))
    if n_averaged > MOST_AVERAGED * n_pixels:
        what = f"{n_averaged} depths of the object were averaged with missing ones, so its edges were averaged, too"
        doubts.append((what, AVERAGED))
    return tuple(doubts)


def _check_count(mask: Mask) -> None:
    """Raise ``DepthError`` if an object shows too few pixels for a surface."""
    if (count := np.count_nonzero(mask)) < reading.FEWEST_SEEN:
        problem = f"the object shows {count} pixels, fewer than {reading.FEWEST_SEEN}"
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
    """Return the units per metre that are passed, or that the file of a camera states; None for the usual ones.

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
    stated = intrinsics.scales if scale is None else (scale,)
    if len(stated) > 1 and not np.isclose(stated, reading.usual_scale(values)).any():
        readings = " or ".join(f"{unit:g}" for unit in dict.fromkeys(stated))
        problem = f"the depth scale of the camera file may mean {readings} units per metre"
        raise DepthError(problem, "pass --depth-scale with the units per metre")
    return stated[0] if len(stated) == 1 else None


def _up(planes: Sequence[Plane], recorded: Up | None) -> tuple[FloatArray, str]:
    """Return the up direction in the camera's frame and its source."""
    floors = [plane for plane in planes if -plane.normal[1] >= FLOOR]
    if floors:
        return min(floors, key=lambda plane: plane.offset).normal, "floor"
    return (IMAGE_UP, "image") if recorded is None else (checked_up(recorded), "sidecar")


def checked_up(direction: Up) -> FloatArray:
    """Return an up direction as a unit vector; raises ``DepthError`` if it is invalid or near the optical axis."""
    try:
        up = np.asarray(direction, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):  # the direction may come from a settings file
        up = np.empty(0)
    length = float(np.linalg.norm(up)) if up.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0 and np.hypot(up[0], up[1]) / length >= MOST_TILTED):
        hint = "write [right, down, forward] of the camera, such as [0, -1, 0]; none if it looks straight down"
        raise DepthError(f"not a usable up direction: {direction}", hint)
    return up / length


def upright(up: FloatArray) -> Points:
    """Return the rotation from the camera's frame to an upright frame in which the camera looks level.

    Its rows are right, up, and back towards the camera; ``up`` has unit length and is not along the
    optical axis.
    """
    back = np.array([0.0, 0.0, -1.0]) + up[2] * up
    back /= np.linalg.norm(back)
    return np.stack([np.cross(up, back), up, back])


def unprojected(depths: Depths, rays: Rays) -> Points:
    """Return the 3D points of pixels, shape (h, w, 3), metres: right, down, forward."""
    return np.concatenate([rays * depths[..., None], depths[..., None]], axis=-1)


def _windows(shape: tuple[int, ...], count: int) -> list[tuple[slice, slice]]:
    """Return the shifted windows into an image padded by one, row by row, whose last one ends at its corner."""
    height, width = shape[0] + 3 - count, shape[1] + 3 - count
    return [
        np.s_[down : down + height, right : right + width]
        for down in range(count)
        for right in range(count)
    ]


def object_surface(
    depths: Depths, rays: Rays, mask: Mask, rotation: Points, half_width: float
) -> Mesh:
    """Return the surface of an object from its pixels.

    Each pixel yields two triangles between its corners. The depth of a corner is the mean over the
    adjacent object pixels; at a depth jump, each pixel gets its own corner, with the mean over the
    adjacent pixels on its side.

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
    DepthError
        If the surface is larger than the frame.
    """
    part = tuple(slice(at.min(), at.max() + 1) for at in np.nonzero(mask))
    points, faces = _squares(depths[part], rays[part], mask[part])
    mesh = Mesh(points @ rotation.T, faces)
    extents = np.ptp(mesh.vertices, axis=0)
    if extents.max() >= 2 * half_width:
        size = " x ".join(f"{extent:.2f}" for extent in extents)
        problem = f"the object is {size} m (width, height, depth), more than the {2 * half_width:.2f} m of the frame"
        raise DepthError(problem, "check the depth scale, or pass a mask of the object alone")
    return mesh


def _squares(depths: Depths, rays: Rays, mask: Mask) -> tuple[Points, Faces]:
    """Return pixel corners in the camera's frame, shape (n, 3), and two camera-facing triangles per pixel."""
    # The pixels around each corner: above left, above right, below left, below right.
    windows = _windows(depths.shape, 2)
    around: Depths = np.stack([np.pad(depths, 1)[window] for window in windows])
    held: Mask = np.stack([np.pad(mask, 1)[window] for window in windows])
    nearest = np.where(held, around, np.inf).min(axis=0)
    farthest = np.where(held, around, 0).max(axis=0)
    used = held.any(axis=0)
    whole = used & (farthest - nearest <= jump(np.where(used, nearest, 0)))
    torn = held & (used & ~whole)
    numbers = np.zeros(around.shape, dtype=np.int32)
    numbers[:, whole] = np.arange(np.count_nonzero(whole))
    numbers[torn] = np.count_nonzero(whole) + np.arange(np.count_nonzero(torn))
    means = (around * held).sum(axis=0)[whole] / held.sum(axis=0)[whole]
    _, row, column = np.nonzero(torn)
    members, own = around[:, row, column], around[torn]
    side = held[:, row, column] & (np.abs(members - own) <= jump(own))
    z = np.concatenate([means, (members * side).sum(axis=0) / side.sum(axis=0)])
    outer = np.pad(rays, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    of_corners = (outer[:-1, :-1] + outer[:-1, 1:] + outer[1:, :-1] + outer[1:, 1:]) / 4
    xy = np.concatenate([of_corners[whole], of_corners[row, column]]) * z[:, None]
    corners = _windows(
        (mask.shape[0] - 1, mask.shape[1] - 1), 2
    )  # of the pixels, of which each is on four sides
    a, d, b, c = (
        of_side[corner][mask] for of_side, corner in zip(numbers[::-1], corners, strict=True)
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.column_stack([xy, z]), faces


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
        return self.mask or reading.find_mask(self.image)

    @property
    def intrinsics_file(self) -> Path | None:
        """Path of the file that holds intrinsics or depth scale; None if both are passed directly, or it is missing."""
        return None if self.intrinsics and self.scale else find_intrinsics(self.image)

    def observe(self) -> ObservedObject:
        """Read the frame and return its object; raises ``DepthError``, which names the faulty file."""
        values, mask_file, camera = reading.read_values(self.image), self.mask_file, self._camera()
        mask = reading.read_mask(mask_file) if mask_file else None
        with named_errors(self.image, "depth image", DepthError, "export the image again"):
            scale = scale_of(values, camera, self.scale)
            observed = observe(
                reading.in_metres(values, scale), camera, mask, self.up, self.half_width
            )
        observed.notes["unit"] = (
            f"1 / {scale:g} m" if scale else f"assumed 1 / {reading.usual_scale(values):g} m"
        )
        observed.notes["camera"] = (
            "given"
            if self.intrinsics
            else os.path.relpath(self.intrinsics_file or "", self.image.parent)
        )
        if mask_file:
            observed.notes["mask"] = mask_file.name
        return observed

    def _camera(self) -> Intrinsics:
        file = self.intrinsics_file
        if self.intrinsics is None and file is None:
            hint = "put camera.json beside it, or pass --intrinsics fx,fy,cx,cy; for a folder, write dataset.toml"
            raise DepthError("there are no intrinsics", hint, self.image)
        if self.intrinsics is None or self.intrinsics.scales or file is None:
            return self.intrinsics or read_intrinsics(file or self.image)
        with suppress(DepthError):  # a file that is not used for its intrinsics may hold anything
            return replace(self.intrinsics, scales=read_intrinsics(file).scales)
        return self.intrinsics
