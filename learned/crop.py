"""A depth image without its frame: the foreground, centred and scaled, and its depth alike."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from learned.images import COVERED, LEAST_DEPTH

Image = NDArray[np.float32]

FILL = 0.9
"""Share of the frame that the longer side of the foreground's bounding box fills."""

_TIE = 1e-6
"""Shares that differ by less are equal: far above the rounding errors of a sum of pixels."""


def cropped(images: Image, resolution: int) -> Image:
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


def window(image: Image) -> tuple[tuple[float, float], float]:
    """Return the first row and column of the frame that the foreground of an image fills, and its side, in pixels."""
    seen = image > 0
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    length = float(max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1) / FILL
    first, second = (float(place[0] + place[-1] + 1 - length) / 2 for place in (rows, columns))
    return (first, second), length


def shrunk(images: Image, resolution: int) -> Image:
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


def _resampled(images: Image, rows: csr_array, columns: csr_array, middle: float, scale: float) -> Image:
    seen = (images[0] > 0).astype(np.float64)
    # A sparse product adds in one order on every machine.
    cover = (columns @ (rows @ seen).T).T
    mask = cover >= COVERED - _TIE
    sums = np.stack([(columns @ (rows @ (image * seen)).T).T for image in images])
    depths = 0.5 + (sums / np.where(mask, cover, 1) - middle) * scale
    return np.where(mask, np.clip(depths, LEAST_DEPTH, 1), 0).astype(np.float32)
