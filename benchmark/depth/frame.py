"""A single frame of a depth camera: its object as a surface and as the depth image passed to methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.depth.errors import InvalidDepth, InvalidIntrinsics
from benchmark.depth.intrinsics import Intrinsics, find_intrinsics, read_intrinsics
from benchmark.depth.projection import FRAME, HALF_WIDTH, object_surface, unprojected, upright, without_flying_pixels
from benchmark.depth.reading import Depths, Mask, checked_mask, find_mask, in_metres, read_depth, read_mask
from benchmark.depth.segmentation import Plane, background_planes, find_object
from benchmark.geometry.mesh import Mesh

_PLANE_STEP = 2
"""Pixel stride of the subsampled image in which planes are detected."""

Up = Sequence[float]

IMAGE_UP = np.array([0.0, -1.0, 0.0])
"""Default up direction in the camera's frame (right, down, forward)."""

MOST_TILTED = np.cos(np.radians(75))
"""Minimum cosine of the angle between a given up direction and the image plane."""


@dataclass(frozen=True, eq=False)
class ObservedObject:
    """The object in a frame.

    Parameters
    ----------
    depths
        Depth image, shape (h, w), metres; 0 for missing depth.
    mask
        Pixels of the object, shape (h, w).
    surface
        Surface of the object in metres: right, up, towards the camera, which looks level.
    notes
        Details of the detection: ``mask`` ("given" or "found"), ``up`` ("floor", "sidecar" or "image"), ``planes``,
        ``object_pixels``, ``flying_pixels``, ``distance`` (median depth) and ``size`` (longest side), in metres.
    """

    depths: Depths
    mask: Mask
    surface: Mesh
    notes: dict[str, float | str] = field(default_factory=dict)


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
        Shape (h, w), nonzero on the object; None segments the object, see :mod:`benchmark.depth.segmentation`.
    up
        Up direction in the camera's frame (right, down, forward), used if no floor is detected; None for the image's.
    half_width
        Half the side of the frame that the object must fit, in metres.

    Raises
    ------
    DepthError
        If intrinsics or mask do not match the image, no object is found, or it is larger than the frame.
    """
    height, width = depths.shape
    intrinsics.check_size(width, height)
    seen = depths > 0
    object_mask = None if mask is None else checked_mask(mask, seen)
    rays = intrinsics.rays(width, height)
    coarse = (slice(None, None, _PLANE_STEP),) * 2
    if object_mask is None:
        points = unprojected(depths, rays)
        planes = background_planes(points[coarse], seen[coarse])
        chosen, part = find_object(points, seen, planes), (slice(None),) * 2
    else:  # the scene only has to provide the floor
        planes = background_planes(unprojected(depths[coarse], rays[coarse]), (seen & ~object_mask)[coarse])
        chosen, part = object_mask, _window(object_mask)
    kept = np.zeros_like(chosen)
    kept[part] = without_flying_pixels(depths[part], chosen[part])
    direction, up_source = _up(planes, up)
    surface = object_surface(depths[part], rays[part], kept[part], upright(direction), half_width)
    notes: dict[str, float | str] = {
        "mask": "found" if object_mask is None else "given",
        "up": up_source,
        "planes": float(len(planes)),
        "object_pixels": float(np.count_nonzero(kept)),
        "flying_pixels": float(np.count_nonzero(chosen) - np.count_nonzero(kept)),
        "distance": round(float(np.median(depths[kept])), 4),
        "size": round(float(np.ptp(surface.vertices, axis=0).max()), 4),
    }
    return ObservedObject(depths, kept, surface, notes)


def _window(mask: Mask) -> tuple[slice, slice]:
    """Return the bounding rows and columns of a mask, padded by one pixel on each side."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(max(rows[0] - 1, 0), rows[-1] + 2), slice(max(columns[0] - 1, 0), columns[-1] + 2)


def _up(planes: Sequence[Plane], recorded: Up | None) -> tuple[NDArray[np.float64], str]:
    """Return the up direction in the camera's frame and its source."""
    floors = [plane for plane in planes if plane.is_floor]
    if floors:
        return max(floors, key=lambda plane: -plane.offset).normal, "floor"
    if recorded is None:
        return IMAGE_UP, "image"
    return checked_up(recorded), "sidecar"


def checked_up(direction: Up) -> NDArray[np.float64]:
    """Return an up direction as a unit vector; raises ``InvalidDepth`` if it is invalid or near the optical axis."""
    up = np.asarray(direction, dtype=np.float64)
    length = float(np.linalg.norm(up)) if up.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0 and np.hypot(up[0], up[1]) / length >= MOST_TILTED):
        raise InvalidDepth(
            f"{list(direction)} is up in no image",
            "write [right, down, forward] of the camera, such as [0, -1, 0]; cameras that look straight down have none",
        )
    return up / length


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
        Path of the object mask; None searches for a file with a usual name, and segments the object if there is none.
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
        """Path of the intrinsics; None if they are passed directly or missing."""
        return None if self.intrinsics else find_intrinsics(self.image)

    def observe(self) -> ObservedObject:
        """Read the frame and return its object; raises ``DepthError``, which names the faulty file."""
        depths = read_depth(self.image, self.scale)
        mask = self.mask_file
        return observe(depths, self._camera(), read_mask(mask) if mask else None, self.up, self.half_width)

    def _camera(self) -> Intrinsics:
        if self.intrinsics is not None:
            return self.intrinsics
        path = self.intrinsics_file
        if path is None:
            raise InvalidIntrinsics(
                f"there are no intrinsics for {self.image}",
                "put camera.json, camera_info.yaml or intrinsics.txt beside it, or pass --intrinsics fx,fy,cx,cy",
            )
        return read_intrinsics(path)


__all__ = ["FRAME", "FrameFiles", "ObservedObject", "Up", "checked_up", "in_metres", "observe"]
