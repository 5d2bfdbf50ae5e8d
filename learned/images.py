"""Depth images of networks: resized, cropped to the foreground, and turned into surfaces."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor
from torch.nn import functional

from benchmark.errors import InvalidMesh, UnsupportedShape
from benchmark.geometry.depth import SIZE, DepthImage, back_project
from benchmark.geometry.mesh import Mesh

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
    fine = torch.from_numpy(np.stack([image, image > 0]).astype(np.float64))[None]
    depth, cover = functional.adaptive_avg_pool2d(fine, resolution)[0]
    mask = (cover >= COVERED).double()
    depth = torch.where(mask > 0, depth / cover.clamp(min=COVERED), 0.0)
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
    depth, mask = prediction.double()
    inside = (mask > COVERED).double()
    reach = math.ceil(3 * deviation)
    bell = torch.exp(-torch.arange(-reach, reach + 1, dtype=torch.float64).square() / (2 * deviation**2))
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
    depth, mask = prediction.double()
    inside = (mask > COVERED).double()
    coarse = torch.stack([depth * inside, inside, mask])[None]
    depth, weight, mask = functional.interpolate(coarse, size=(SIZE, SIZE), mode="bilinear", align_corners=False)[0]
    # Where the finer mask exceeds a half, so does one of the coarse pixels around; rounding errors know no such rule.
    seen = (mask > COVERED) & (weight > 0)
    result = torch.where(seen, (depth / weight).clamp(LEAST_DEPTH, 1.0), 0.0)
    return np.asarray(result.numpy(), dtype=np.float32)


def surface_behind(predicted: DepthImage, jump: float | None = None) -> tuple[Mesh, dict[str, float | str]]:
    """Surface behind a predicted image, of unit area, and facts about it; sampled like the view input.

    A camera's image shows where one part hides another by a jump of its depth alone, so the view input is cut there. A
    predicted image comes with a mask that was learned for saying what is surface, and its depth with a noise as large
    as such jumps: cut there, it falls into shreds.

    Parameters
    ----------
    predicted
        Depth image, shape (500, 500), 0 outside the predicted mask.
    jump
        Largest depth difference along an edge, as a share of the half width; None cuts nowhere inside the mask.

    Raises
    ------
    UnsupportedShape
        If the image is empty.
    """
    if not predicted.any():
        raise UnsupportedShape("the network predicts an empty mask", "train it for longer or on shapes like this one")
    surface, report = back_project(predicted, 1.0, jump=math.inf if jump is None else jump)
    notes: dict[str, float | str] = {
        "predicted_foreground": report.foreground,
        "predicted_pieces": report.pieces,
        "predicted_bridges": report.bridges,
    }
    return surface.with_vertices(surface.vertices / surface.area**0.5), notes


def outline_blur(mask: Tensor) -> float:
    """Return the mean width in pixels of the uncertain rim of a predicted mask, shape (r, r); 0 for an empty one.

    A network predicts a sharp outline for shapes like those that it was trained on. The width is the sum of 4 m (1 - m)
    over all pixels m, divided by the length of the outline in sides of pixels.
    """
    inside = mask > COVERED
    length = sum(int(torch.count_nonzero(inside.diff(dim=axis))) for axis in (0, 1))
    share = mask.double().clamp(0, 1)
    return float((4 * share * (1 - share)).sum()) / max(length, 1)


FILL = 0.9
"""Share of the frame that the longer side of the foreground's bounding box fills."""

_TIE = 1e-6
"""Shares that differ by less are equal: far above the rounding errors of a sum of pixels."""


def cropped(images: Floats, resolution: int) -> Floats:
    """Depth at another resolution, in a frame that the foreground of the first image fills.

    A pixel gets the mean depth of what it sees of the shape, never a mixture with the background. Depths are scaled
    like lengths, so that angles stay what they are, and shifted so that the mean depth of the first image is that of
    the middle of the frame. What size a body had in its frame is lost, and a form of unit area knows no size.

    Parameters
    ----------
    images
        Depth images of one mask and frame, shape (k, s, s), in [0, 1] with 0 as background: an image, or the front and
        the back of one shape. The first must show something.
    resolution
        Pixels per side.

    Returns
    -------
    numpy.ndarray
        Shape (k, resolution, resolution), float32.
    """
    size = images.shape[-1]
    seen = images[0] > 0
    starts, length = window(images[0])
    down, across = (_resampling(start, length, size, resolution) for start in starts)
    middle = float(images[0][seen].mean(dtype=np.float64))
    return _resampled(images, down, across, middle, size / length)


def window(image: Floats) -> tuple[tuple[float, float], float]:
    """Return the first row and column of the frame that the foreground of an image fills, and its side, in pixels."""
    seen = image > 0
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    length = float(max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1) / FILL
    first, second = (float(place[0] + place[-1] + 1 - length) / 2 for place in (rows, columns))
    return (first, second), length


def shrunk(images: Floats, resolution: int) -> Floats:
    """The same without leaving the frame: depth at another resolution, shape (k, resolution, resolution)."""
    size = images.shape[-1]
    whole = _resampling(0.0, float(size), size, resolution)
    return _resampled(images, whole, whole, 0.5, 1.0)


def _resampling(start: float, length: float, size: int, resolution: int) -> csr_array:
    """Share of each new pixel that each old one covers, shape (resolution, size), most of which are zero."""
    edges = start + length * np.arange(resolution + 1) / resolution
    first = np.floor(edges[:-1]).astype(np.int64)
    old = first[:, None] + np.arange(math.ceil(length / resolution) + 2)
    overlap = np.minimum(edges[1:, None], old + 1.0) - np.maximum(edges[:-1, None], old)
    shares = np.maximum(overlap, 0) * (resolution / length)
    covered = (shares > 0) & (old >= 0) & (old < size)
    begins = np.concatenate([[0], np.cumsum(covered.sum(axis=1))])
    return csr_array((shares[covered], old[covered], begins), shape=(resolution, size))


def _resampled(images: Floats, rows: csr_array, columns: csr_array, middle: float, scale: float) -> Floats:
    seen = (images[0] > 0).astype(np.float64)
    # A sparse product adds in one order on every machine.
    cover = (columns @ (rows @ seen).T).T
    mask = cover >= COVERED - _TIE
    sums = np.stack([(columns @ (rows @ (image * seen)).T).T for image in images])
    depths = 0.5 + (sums / np.where(mask, cover, 1) - middle) * scale
    return np.where(mask, np.clip(depths, LEAST_DEPTH, 1), 0).astype(np.float32)
