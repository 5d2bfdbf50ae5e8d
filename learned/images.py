"""Depth images for networks: resampled, cropped to the foreground, and predictions enlarged."""

from __future__ import annotations

import math
from typing import Annotated, Any, Self

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor
from torch.nn import functional

from benchmark.errors import InvalidMesh, UnsupportedShape
from benchmark.geometry.depth import SIZE, DepthImage

COVERED = 0.5
"""Share of a coarse pixel that the shape must cover; probability above which it is in a mask."""

CROP_FILL = 0.9
"""Share of the frame that the longer side of the foreground's bounding box fills when cropped."""

LEAST_DEPTH = 1e-3
"""Smallest depth of the foreground, because 0 is the background."""

#: Difference below which shares are equal, far above the rounding errors of a sum of pixels.
_TIE = 1e-6


def checked_image(image: DepthImage) -> DepthImage:
    """Check that a network can read a depth image, and return it as float32.

    Parameters
    ----------
    image
        Shape (500, 500), in [0, 1] with 0 as background.

    Raises
    ------
    InvalidMesh
        If it has another shape or other values.
    UnsupportedShape
        If it is empty.
    """
    image = np.asarray(image, dtype=np.float32)
    if image.shape != (SIZE, SIZE):
        problem = f"a depth image of shape {image.shape} does not fit the network"
        raise InvalidMesh(problem, f"render {SIZE} x {SIZE} pixels")
    if not np.isfinite(image).all() or image.min() < 0 or image.max() > 1:
        problem = "the depth image holds NaN or values outside [0, 1]"
        raise InvalidMesh(problem, "normalise it as `render_depth` does, with 0 outside")
    if not image.any():
        problem = "the depth image is empty"
        raise UnsupportedShape(problem, "check the camera and the half width of the data set")
    return image


def resampled(image: DepthImage, resolution: int, *, crop: bool = False) -> DepthImage:
    """Resample a depth image to the resolution of a network.

    The depth of a pixel is the mean over the foreground that it covers, without the background, at
    whose depth nothing is.

    Parameters
    ----------
    image
        Depth image, shape (s, s), in [0, 1] with 0 as background, not empty.
    resolution
        Pixels per side, r.
    crop
        Whether to crop the image to its foreground. Depths are then scaled by the same factor as
        the image, and shifted so that their mean is 0.5.

    Returns
    -------
    numpy.ndarray
        Shape (2, r, r), float32: depth and binary mask.

    Raises
    ------
    UnsupportedShape
        If the foreground covers half of no pixel.
    """
    size = image.shape[-1]
    seen = image > 0
    first_row = 0.0
    first_column = 0.0
    length = float(size)
    if crop:
        first_row, first_column, length = _window(seen)
    # How much of each row and column of the image each row and column of the result covers.
    rows = _shares(first_row, length, size, resolution)
    columns = _shares(first_column, length, size, resolution)

    def summed(pixels: NDArray[Any]) -> NDArray[np.float64]:
        """Return the sum of the pixels that each pixel of the result covers, by their shares."""
        # Sparse products add in the same order on every machine.
        return np.asarray((columns @ (rows @ pixels.astype(np.float64)).T).T)

    cover = summed(seen)
    mask = cover >= COVERED - _TIE
    if not mask.any():
        problem = f"the object is too thin or too small for {resolution} x {resolution} pixels"
        raise UnsupportedShape(problem, "take a network with more pixels, or a closer view")
    depth = summed(image) / np.where(mask, cover, 1)
    if crop:
        depth = 0.5 + (depth - float(image[seen].mean(dtype=np.float64))) * (size / length)
    depth = np.where(mask, np.clip(depth, LEAST_DEPTH, 1), 0)
    return np.ascontiguousarray(np.stack([depth, mask]), dtype=np.float32)


def _window(seen: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return first row, first column and side, in pixels, of the frame around the foreground."""
    rows = np.flatnonzero(seen.any(axis=1))
    columns = np.flatnonzero(seen.any(axis=0))
    length = float(max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1) / CROP_FILL
    first_row = float(rows[0] + rows[-1] + 1 - length) / 2
    first_column = float(columns[0] + columns[-1] + 1 - length) / 2
    return first_row, first_column, length


def _shares(start: float, length: float, size: int, resolution: int) -> csr_array:
    """Return the share of each new pixel that each old one covers, shape (resolution, size).

    Parameters
    ----------
    start, length
        Where the new pixels begin, and the length of all of them, in old pixels.
    size, resolution
        Number of old and of new pixels.
    """
    edges = start + length * np.arange(resolution + 1) / resolution
    first = np.floor(edges[:-1]).astype(np.int64)
    old = first[:, None] + np.arange(math.ceil(length / resolution) + 2)
    overlap = np.minimum(edges[1:, None], old + 1.0) - np.maximum(edges[:-1, None], old)
    shares = np.maximum(overlap, 0) * (resolution / length)
    covered = (shares > 0) & (old >= 0) & (old < size)
    begins = np.concatenate([[0], np.cumsum(covered.sum(axis=1))])
    return csr_array((shares[covered], old[covered], begins), shape=(resolution, size))


def enlarged(prediction: Tensor) -> DepthImage:
    """Upsample a prediction to the size of a camera image.

    Depths are interpolated between pixels inside the mask only, so the rim does not fall off
    towards the background.

    Parameters
    ----------
    prediction
        Depth and mask, shape (2, r, r), in [0, 1].

    Returns
    -------
    numpy.ndarray
        Shape (500, 500), float32; 0 where the mask is at most a half.
    """
    depth, mask = prediction.double()
    inside = (mask > COVERED).double()
    coarse = torch.stack([depth * inside, inside, mask])
    depth, weight, mask = _at_full_size(coarse)
    # If the fine mask exceeds a half, so does one of the coarse pixels around it, except for
    # rounding errors.
    seen = (mask > COVERED) & (weight > 0)
    fine = torch.where(seen, (depth / weight).clamp(LEAST_DEPTH, 1.0), 0.0)
    return np.asarray(fine.numpy(), dtype=np.float32)


def _at_full_size(images: Tensor) -> Tensor:
    """Return images, shape (k, r, r), interpolated to the size of a camera image."""
    size = (SIZE, SIZE)
    return functional.interpolate(images[None], size=size, mode="bilinear", align_corners=False)[0]


class DepthScale(msgspec.Struct, frozen=True):
    """Linear map of depths, .5 + factor (depth - mean).

    By it, the targets of a training fill the range .1 to .9. The frame is as deep as it is wide, so
    the depths of a standing body fill less than a tenth of [0, 1].

    Parameters
    ----------
    mean, factor
        By default, depths stay as they are.
    """

    mean: float = 0.5
    factor: Annotated[float, msgspec.Meta(gt=0)] = 1.0

    @classmethod
    def of(cls, targets: Tensor) -> Self:
        """Return the map for depths and masks of all targets, shape (t, 2, r, r)."""
        depths = targets[:, 0][targets[:, 1] > COVERED].double()
        mean = math.fsum(depths.tolist()) / len(depths)  # equal on every machine
        return cls.between(float(depths.min()), float(depths.max()), mean)

    @classmethod
    def between(cls, least: float, largest: float, mean: float) -> Self:
        """Return the map for depths with these bounds and this mean."""
        return cls(mean, 0.4 / max(largest - mean, mean - least, LEAST_DEPTH))

    def apply(self, targets: Tensor) -> Tensor:
        """Map the foreground of targets, shape (t, 2, r, r)."""
        depth, mask = targets.double().unbind(1)
        scaled = torch.where(mask > COVERED, 0.5 + self.factor * (depth - self.mean), 0.0)
        return torch.stack([scaled, mask], dim=1).float()

    def undo(self, prediction: Tensor) -> Tensor:
        """Map predicted depths back, shape (sides + 1, r, r); exact for the default."""
        # In this order, a mean of .5 and a factor of 1 change no bit.
        depths = prediction[:-1] / self.factor + (self.mean - 0.5 / self.factor)
        return torch.cat([depths, prediction[-1:]])


def outline_blur(mask: Tensor) -> float:
    """Return the mean width in pixels of the uncertain rim of a predicted mask, shape (r, r).

    0 for an empty one. A network predicts sharp outlines for shapes like those in its training. The
    width is the sum of 4 m (1 - m) over all pixels m, divided by the length of the outline in pixel
    sides.
    """
    inside = mask > COVERED
    length = sum(int(torch.count_nonzero(inside.diff(dim=axis))) for axis in (0, 1))
    share = mask.double().clamp(0, 1)
    return float((4 * share * (1 - share)).sum()) / max(length, 1)
