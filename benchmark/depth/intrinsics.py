"""Intrinsics of a pinhole camera, from text, Open3D, ROS, OpenCV or four numbers, and the rays of its pixels."""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmark.errors import DepthError
from benchmark.geometry.io import named_errors

Rays = NDArray[np.float64]

#: Names of intrinsics files, in the folder of the image or in one of its two parents.
NAMES = (
    "camera.json", "camera_info.yaml", "camera_info.yml", "camera_info.json", "depth_camera_info.yaml",
    "intrinsics.txt", "intrinsics.json", "intrinsics.yaml", "intrinsic.txt", "intrinsic.json",
    "depthIntrinsics.txt", "depth_intrinsics.txt", "depth_intrinsics.json", "intrinsics_depth.txt",
    "intrinsic_depth.txt", "camera-intrinsics.txt", "camera_intrinsics.txt", "camera_intrinsic.json", "K.txt",
)  # fmt: skip

CENTRAL = (0.25, 0.75)
"""Bounds of the principal point as fractions of width and height, if the intrinsics do not give the image size."""

#: Coefficients of Brown's model with its rational extension, and its names in files; an empty name means this model.
_BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_BROWN_NAMES = ("", "plumb_bob", "rational_polynomial", "brown_conrady", "brown", "radtan", "opencv", "pinhole")

#: Models other than a pinhole camera, rejected with any coefficients; other unknown models may have zero coefficients.
_BEYOND_PINHOLE = "fish_?eye|equidistant|kannala|f_?theta|omni|(^|_)mei(_|$)|unified|panoram"

#: Keys of lists of coefficients.
_COEFFICIENTS = ("distortion_coefficients", "distortion_coeffs", "distortion", "dist_coeffs", "coeffs", "D", "d")

_LARGEST_FILE = 100_000
_HINT = "write a 3 x 3 matrix, camera.json of Open3D, camera_info.yaml of ROS, or fx,fy,cx,cy"

#: Iterations to find the ray of a distorted pixel; lenses of depth cameras need five.
_STEPS = 20


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera.

    Parameters
    ----------
    fx, fy
        Focal lengths in pixels.
    cx, cy
        Principal point in pixels; the centre of the first pixel is at 0.
    size
        Width and height of the image; None if unknown.
    distortion
        Coefficients k1, k2, p1, p2, k3, k4, k5, k6 of Brown's model with its rational extension, in OpenCV's order;
        empty for no distortion.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not (all(map(math.isfinite, values)) and self.fx > 0 and self.fy > 0):
            raise DepthError(
                f"focal lengths {self.fx:g}, {self.fy:g} with centre {self.cx:g}, {self.cy:g} are those of no camera",
                "pass positive focal lengths in pixels",
            )

    def check_size(self, width: int, height: int) -> None:
        """Raise ``DepthError`` if the intrinsics belong to an image of another size."""
        if self.size is not None and self.size != (width, height):
            raise DepthError(
                f"the intrinsics are those of {self.size[0]} x {self.size[1]} pixels, the image has {width} x {height}",
                "pass those of the depth image, not of the colour image or of another resolution",
            )
        low, high = (0.0, 1.0) if self.size else CENTRAL
        if not (low * width <= self.cx + 0.5 <= high * width and low * height <= self.cy + 0.5 <= high * height):
            raise DepthError(
                f"the principal point {self.cx:g}, {self.cy:g} is far from the middle of {width} x {height} pixels",
                "pass the intrinsics of this image; those of a part of an image need its width and height beside them",
            )

    @functools.lru_cache(maxsize=4)  # noqa: B019
    def rays(self, width: int, height: int) -> Rays:
        """Return the intersection of each pixel's ray with depth 1, shape (height, width, 2): right, down."""
        x, y = (np.arange(width) - self.cx) / self.fx, (np.arange(height) - self.cy) / self.fy
        rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)
        if any(self.distortion):
            rays = _undistorted(rays, self.distortion)
        rays.flags.writeable = False
        return rays


def _undistorted(seen: Rays, coefficients: Sequence[float]) -> Rays:
    """Invert the distortion by fixed-point iteration, as OpenCV does [Brown 1971]."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*coefficients, *(0.0,) * (8 - len(coefficients)))
    rays = seen
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            x, y = rays[..., 0], rays[..., 1]
            r = x * x + y * y
            radial = (1 + r * (k4 + r * (k5 + r * k6))) / (1 + r * (k1 + r * (k2 + r * k3)))
            shift = np.stack([2 * p1 * x * y + p2 * (r + 2 * x * x), p1 * (r + 2 * y * y) + 2 * p2 * x * y], axis=-1)
            rays = (seen - shift) * radial[..., None]
    if not (np.isfinite(rays).all() and np.abs(rays).max() < 100):
        raise DepthError(f"distortion {coefficients} cannot be inverted on this image", "check its coefficients")
    return rays


def parse_intrinsics(text: str) -> Intrinsics:
    """Parse ``fx,fy,cx,cy`` or the numbers of a matrix; raises ``DepthError`` for anything else."""
    words = re.sub(r"(#|%|//).*|[\[\],;]", " ", text).split()
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise DepthError(f"'{' '.join(text.split()):.60}' is no list of numbers", _HINT) from error
    return camera_of(numbers)


def intrinsics_of(value: str, folder: Path = Path()) -> Intrinsics:
    """Return the intrinsics given as ``fx,fy,cx,cy`` or as a file in a folder, see :func:`read_intrinsics`."""
    if "," in value and not (folder / value).exists():
        return parse_intrinsics(value)
    return read_intrinsics(folder / value)


def read_intrinsics(path: Path) -> Intrinsics:
    """Read intrinsics.

    Parameters
    ----------
    path
        Text with the numbers of a 3 x 3 or 4 x 4 matrix, or fx, fy, cx and cy; ``camera.json`` of Open3D;
        ``camera_info`` of ROS or a file of OpenCV, as YAML or JSON; or a mapping with ``fx``, ``fy``, ``cx``, ``cy``.

    Raises
    ------
    DepthError
        If the file is missing, holds no intrinsics, or those of a lens that is not a pinhole with Brown's distortion.
    """
    with named_errors(path, "file of intrinsics", DepthError, _HINT):
        if path.stat().st_size > _LARGEST_FILE:
            raise DepthError("it is too large for intrinsics", _HINT)
        text = path.read_bytes().decode("utf-8-sig")
        content = _parsed(text)
        return _of_mapping(content) if isinstance(content, Mapping) else parse_intrinsics(text)


def _parsed(text: str) -> Any:
    """Return the content of JSON or of the first document of YAML; None for plain numbers."""
    if text.lstrip().startswith("{"):
        return json.loads(text)
    if ":" not in text:
        return None
    plain = re.sub(r"(?m)^%.*$|!!opencv-\w+", "", text)
    if any(isinstance(token, yaml.AliasToken) for token in yaml.scan(plain)):  # a few of them can hold gigabytes
        raise ValueError("it has aliases")
    return next(iter(yaml.safe_load_all(plain)), None)


def find_intrinsics(image: Path) -> Path | None:
    """Return the file of intrinsics, by its usual names, in the folder of an image or in one of its two parents."""
    folders = (image.parent, *image.absolute().parent.parents[:2])
    paths = (folder / name for folder in folders for name in NAMES)
    return next((path for path in paths if path.is_file()), None)


def camera_of(
    numbers: Sequence[float], size: tuple[int, int] | None = None, distortion: Sequence[float] = ()
) -> Intrinsics:
    """Return the camera of fx, fy, cx, cy or of a 3 x 3 or 4 x 4 matrix; raises ``DepthError`` for others."""
    if len(numbers) == 4:
        fx, fy, cx, cy = numbers
        return Intrinsics(fx, fy, cx, cy, size, tuple(distortion))
    if len(numbers) not in (9, 16):
        shown = " ".join(f"{number:g}" for number in numbers)
        raise DepthError(f"'{shown:.60}' are {len(numbers)} numbers", _HINT)
    matrix = np.array(numbers).reshape(math.isqrt(len(numbers)), -1)[:3, :3]
    if not np.isfinite(matrix).all() or (matrix[2] != (0, 0, 1)).any() or matrix[1, 0]:
        rows = " / ".join(" ".join(f"{value:g}" for value in row) for row in matrix)
        raise DepthError(f"the matrix {rows} is that of no camera", "write fx 0 cx / 0 fy cy / 0 0 1")
    fx, fy, cx, cy = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Intrinsics(fx, fy, cx, cy, size, tuple(distortion))


def _of_mapping(content: Mapping[str, Any]) -> Intrinsics:
    """Read parsed JSON or YAML: ``camera.json`` of Open3D, ``camera_info`` of ROS, or named focal lengths."""
    inner = content.get("intrinsic", {})
    values = {**content, **(inner if isinstance(inner, Mapping) else {"K": inner})}
    size, distortion = _size(values), _distortion(values)
    if "intrinsic_matrix" in values:  # Open3D, column-major
        return camera_of(np.array(_flat(values["intrinsic_matrix"])).reshape(3, 3).T.ravel().tolist(), size, distortion)
    for key in ("K", "k", "camera_matrix", "Camera_Matrix"):
        if key in values:
            return camera_of(_flat(values[key]), size, distortion)
    cx, cy = (values.get(f"c{axis}", values.get(f"pp{axis}")) for axis in "xy")
    if cx is None or cy is None:
        raise DepthError(f"keys {', '.join(map(str, values)):.200} name no principal point", _HINT)
    return camera_of(_flat([values["fx"], values["fy"], cx, cy]), size, distortion)


def _flat(values: Any) -> list[float]:
    """Return the numbers of a list, a nested list, or the ``data`` of an OpenCV or ROS matrix."""
    return [float(value) for value in np.ravel(values["data"] if isinstance(values, Mapping) else values)]


def _distortion(values: Mapping[str, Any]) -> list[float]:
    """Return the coefficients of Brown's model; empty if all are zero.

    Raises
    ------
    DepthError
        If the distortion model is another one, or the number of coefficients does not match Brown's model.
    """
    named = next((str(values[key]) for key in ("distortion_model", "model", "camera_model") if key in values), "")
    model = re.sub(r"[\W_]+", "_", named.lower()).removeprefix("distortion_")
    lists = (_flat(values[key]) for key in _COEFFICIENTS if not isinstance(values.get(key), str | None))
    coefficients = next(lists, [float(values.get(name) or 0) for name in _BROWN])
    if re.search(_BEYOND_PINHOLE, model) or (model not in _BROWN_NAMES and any(coefficients)):
        raise DepthError(
            f"the distortion model is '{named:.60}'", "rectify the image, and pass plumb_bob or rational_polynomial"
        )
    if not any(coefficients):
        return []
    if len(coefficients) not in (4, 5, 8):
        raise DepthError(f"{len(coefficients)} coefficients of distortion", "pass 4, 5 or 8 of Brown's model")
    return coefficients


def _size(values: Mapping[str, Any]) -> tuple[int, int] | None:
    for prefix in ("", "image_"):
        if f"{prefix}width" in values and f"{prefix}height" in values:
            width, height = int(values[f"{prefix}width"]), int(values[f"{prefix}height"])
            return (width, height) if width > 0 and height > 0 else None
    return None
