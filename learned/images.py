"""Depth images between the size that the camera gives and the size that a network is trained at."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from benchmark.errors import InvalidMesh, UnsupportedShape
from benchmark.geometry.depth import SIZE, DepthImage

Floats = NDArray[np.float32]

COVERED = 0.5
"""Share of a coarse pixel that must show the shape, and probability of the mask above which a pixel shows it."""


LEAST_DEPTH = 1e-3
"""Smallest predicted depth, for 0 is the background."""


def checked_image(image: DepthImage) -> Floats:
    """The image, if a network can read it.

    Raises
    ------
    InvalidMesh
        If it does not have 500 x 500 pixels in [0, 1].
    UnsupportedShape
        If it shows nothing.
    """
    image = np.asarray(image, dtype=np.float32)
    if image.shape != (SIZE, SIZE):
        raise InvalidMesh(
            f"a depth image of shape {image.shape} does not fit the network", f"render {SIZE} x {SIZE} pixels"
        )
    if not np.isfinite(image).all() or image.min() < 0 or image.max() > 1:
        raise InvalidMesh(
            "the depth image holds NaN or values outside [0, 1]", "normalise it as `render_depth` does, with 0 outside"
        )
    if not image.any():
        raise UnsupportedShape("the depth image is empty", "check the camera and the half width of the data set")
    return image


def shrink(image: Floats, resolution: int) -> Floats:
    """Depth and mask at another resolution.

    A coarse pixel gets the mean depth of what it sees of the shape, never a mixture with the background, which would be
    a depth where nothing is.

    Parameters
    ----------
    image
        Depth image, shape (s, s), 0 as background.
    resolution
        Pixels per side.

    Returns
    -------
    numpy.ndarray
        Shape (2, resolution, resolution), float32: depth, and the mask of zeros and ones.
    """
    fine = torch.from_numpy(np.stack([image, (image > 0).astype(np.float32)]))[None]
    depth, cover = functional.adaptive_avg_pool2d(fine, resolution)[0]
    mask = (cover >= COVERED).float()
    depth = torch.where(mask > 0, depth / cover.clamp(min=COVERED), torch.zeros(()))
    return np.asarray(torch.stack([depth, mask]).numpy(), dtype=np.float32)


def smooth(prediction: Tensor, deviation: float) -> Tensor:
    """Average the depth over neighbours inside the mask, with the weights of a Gaussian; the mask stays as it is.

    Parameters
    ----------
    prediction
        Depth and mask, shape (2, r, r).
    deviation
        Standard deviation of the Gaussian in pixels; 0 changes nothing.

    Returns
    -------
    torch.Tensor
        Shape (2, r, r).
    """
    if deviation == 0:
        return prediction
    depth, mask = prediction.float()
    inside = (mask > COVERED).float()
    reach = math.ceil(3 * deviation)
    bell = torch.exp(-torch.arange(-reach, reach + 1, dtype=torch.float32).square() / (2 * deviation**2))
    blurred = torch.stack([depth * inside, inside])[:, None]
    for kernel, padding in ((bell[None, None, :, None], (reach, 0)), (bell[None, None, None, :], (0, reach))):
        blurred = functional.conv2d(blurred, kernel, padding=padding)
    weighted, weight = blurred[:, 0]
    # Inside the mask the weight is at least that of the pixel itself.
    return torch.stack([torch.where(inside > 0, weighted / weight.clamp(min=1.0), depth), mask])


def enlarge(prediction: Tensor) -> Floats:
    """Depth image of the size of the camera's from a prediction.

    Depths are interpolated among pixels inside the mask alone, so that the rim does not fall towards the background.

    Parameters
    ----------
    prediction
        Depth and mask, shape (2, r, r), in [0, 1].

    Returns
    -------
    numpy.ndarray
        Shape (500, 500), float32; 0 where the mask is at most a half.
    """
    depth, mask = prediction.float()
    inside = (mask > COVERED).float()
    coarse = torch.stack([depth * inside, inside, mask])[None]
    depth, weight, mask = functional.interpolate(coarse, size=(SIZE, SIZE), mode="bilinear", align_corners=False)[0]
    # Where the finer mask exceeds a half, so does one of the coarse pixels around; rounding errors know no such rule.
    seen = (mask > COVERED) & (weight > 0)
    result = torch.where(seen, (depth / weight).clamp(LEAST_DEPTH, 1.0), torch.zeros(()))
    return np.asarray(result.numpy(), dtype=np.float32)
