"""SIFT on depth images in single precision: the local features of the scorer.

The settings are those of vl_sift: no upsampling of the image, three levels per octave, an initial scale of 1.6 pixels
and a nominal blur of 0.5, edge ratio 10, descriptors as unsigned bytes. Depth is never reduced to eight bits: the steps
between grey levels would put keypoints on contour lines that the surface does not have.

References
----------
Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 60, 2004.
Vedaldi & Fulkerson, "VLFeat: an open and portable library of computer vision algorithms", 2008 (the settings).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from retrieval.gradient_histograms import DESCRIPTOR_SIZE, MAX_ORIENTATIONS, describe, gradients, orientations
from retrieval.scale_space import (
    BASE_SCALE,
    LEVELS,
    MARGIN,
    N_GAUSSIANS,
    SMALLEST_SIDE,
    STEP,
    build_octave,
    find_extrema,
)

EDGE_RATIO = 10.0
#: Largest accepted absolute value of a pixel.
LARGEST_VALUE = 1e6


@dataclass(frozen=True, eq=False)
class Features:
    """Descriptors of all views of one form.

    Parameters
    ----------
    descriptors
        Shape (k, 128), uint8.
    view_offsets
        Shape (number of views + 1,), int32: the descriptors of view v are the rows ``view_offsets[v]`` to
        ``view_offsets[v + 1]``.
    """

    descriptors: NDArray[np.uint8]
    view_offsets: NDArray[np.int32]

    def mirrored(self, view_permutation: NDArray[np.int32]) -> Features:
        """Return the features of the mirror image of the form.

        The mirror image of a view has the same keypoints with descriptors flipped along their own axes, so no rendering
        is needed.

        Parameters
        ----------
        view_permutation
            Shape (number of views,): the view that shows the mirror image of view v.
        """
        cells = self.descriptors.reshape(-1, 4, 4, 8)
        flipped = cells[:, ::-1, :, (-np.arange(8)) % 8].reshape(-1, DESCRIPTOR_SIZE)
        per_view = np.split(flipped, self.view_offsets[1:-1])
        source = np.argsort(view_permutation)
        offsets = np.concatenate([[0], np.cumsum(np.diff(self.view_offsets)[source])]).astype(np.int32)
        return Features(np.concatenate([per_view[v] for v in source]), offsets)


def detect_views(images: NDArray[np.float32], *, peak_threshold: float, background: float) -> Features:
    """Detect and describe the keypoints of every view of a form.

    Parameters
    ----------
    images
        Shape (number of views, height, width), float32.
    peak_threshold
        Minimum absolute difference of Gaussians at a keypoint, in units of the images, which lie in [0, 1].
    background
        Value of pixels that show no surface; the search skips regions far from all other pixels.
    """
    _, descriptors, offsets = _detect_all(_checked(images), np.float32(background), peak_threshold, EDGE_RATIO)
    return Features(descriptors, offsets)


def _checked(images: NDArray[np.float32]) -> NDArray[np.float32]:
    # The square of a gradient must not overflow: the bin of a NaN angle lies outside every histogram.
    if not (images.max(initial=0.0) <= LARGEST_VALUE and images.min(initial=0.0) >= -LARGEST_VALUE):
        raise InvalidMesh(
            f"a depth image has pixels that are NaN, infinite or beyond {LARGEST_VALUE:g}, where depths lie in [0, 1]",
            "check the form that was rendered",
        )
    return np.ascontiguousarray(images, dtype=np.float32)


@njit(cache=True, nogil=True)
def _detect_all(
    images: NDArray[np.float32], background: np.float32, peak_threshold: float, edge_ratio: float
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.int32]]:
    """Return frames (k, 4) of x, y, scale, angle; descriptors (k, 128); offsets of the images' keypoints."""
    n_images = images.shape[0]
    frames = np.empty((4096, 4))
    descriptors = np.empty((4096, DESCRIPTOR_SIZE), dtype=np.uint8)
    offsets = np.zeros(n_images + 1, dtype=np.int32)
    points = np.empty((1024, 4))
    peaks = np.empty(MAX_ORIENTATIONS)  # no more are written
    count = 0
    for index in range(n_images):
        whole = images[index]
        top, bottom, left, right = _foreground(whole, background)
        height, width = whole.shape
        base, base_row, base_column = whole, 0, 0
        beyond = background
        octave = 0
        while top < bottom and (min(height, width) >= SMALLEST_SIDE or octave == 0):
            pixel = 2**octave
            row0, row1 = max(top // pixel - MARGIN, 0), min(bottom // pixel + MARGIN + 1, height)
            column0, column1 = max(left // pixel - MARGIN, 0), min(right // pixel + MARGIN + 1, width)
            shape = (row1 - row0, column1 - column0)
            crop = np.full(shape, beyond, dtype=np.float32)
            gaussians = np.empty((N_GAUSSIANS, *shape), dtype=np.float32)
            differences = np.empty((N_GAUSSIANS - 1, *shape), dtype=np.float32)
            _paste(base, base_row, base_column, crop, row0, column0)
            build_octave(crop, gaussians, differences, octave == 0)
            n_points = find_extrema(differences, peak_threshold, edge_ratio, points)
            # Extrema beyond the capacity are counted, so a second search has room for all.
            if n_points > len(points):
                points = np.empty((2 * n_points, 4))
                n_points = find_extrema(differences, peak_threshold, edge_ratio, points)
            magnitudes, angles = np.empty_like(crop), np.empty_like(crop)
            level_done = -1
            for k in range(n_points):
                x, y, level = points[k, 0], points[k, 1], int(points[k, 2])
                sigma = BASE_SCALE * STEP ** (level + 1 + points[k, 3])
                if level != level_done:
                    gradients(gaussians[level + 1], magnitudes, angles)
                    level_done = level
                for a in range(orientations(magnitudes, angles, x, y, sigma, peaks)):
                    if count == len(frames):
                        frames = np.concatenate((frames, np.empty_like(frames)))
                        descriptors = np.concatenate((descriptors, np.empty_like(descriptors)))
                    frames[count, 0], frames[count, 1] = pixel * (x + column0), pixel * (y + row0)
                    frames[count, 2], frames[count, 3] = pixel * sigma, peaks[a]
                    describe(magnitudes, angles, x, y, sigma, peaks[a], descriptors[count])
                    count += 1
            # The level of twice the base scale, every second pixel, starts the next octave.
            start_row, start_column = row0 % 2, column0 % 2
            base = gaussians[LEVELS, start_row::2, start_column::2].copy()
            base_row, base_column = (row0 + 1) // 2, (column0 + 1) // 2
            beyond = _blurred(beyond, octave == 0)
            height, width = height // 2, width // 2
            octave += 1
        offsets[index + 1] = count
    return frames[:count].copy(), descriptors[:count].copy(), offsets


@njit(cache=True, nogil=True)
def _foreground(image: NDArray[np.float32], background: np.float32) -> tuple[int, int, int, int]:
    """Return the bounding box (top, bottom, left, right) of the foreground, ends excluded; all zero if it is empty."""
    height, width = image.shape
    top, bottom, left, right = height, 0, width, 0
    for row in range(height):
        for column in range(width):
            if image[row, column] != background:
                top, bottom = min(top, row), row + 1
                left, right = min(left, column), max(right, column + 1)
    return (top, bottom, left, right) if bottom else (0, 0, 0, 0)


@njit(cache=True, nogil=True)
def _blurred(background: np.float32, is_first: bool) -> np.float32:
    """Return the background in the next octave: blur changes its last bits, and an edge between both would be found."""
    base = np.full((1, 1), background, dtype=np.float32)
    gaussians = np.empty((N_GAUSSIANS, 1, 1), dtype=np.float32)
    build_octave(base, gaussians, gaussians[1:].copy(), is_first)
    blurred: np.float32 = gaussians[LEVELS, 0, 0]
    return blurred


@njit(cache=True, nogil=True)
def _paste(
    source: NDArray[np.float32],
    source_row: int,
    source_column: int,
    target: NDArray[np.float32],
    target_row: int,
    target_column: int,
) -> None:
    """Copy the overlap of two windows, each given by the position of its first pixel in the octave."""
    row0, row1 = max(source_row, target_row), min(source_row + source.shape[0], target_row + target.shape[0])
    column0 = max(source_column, target_column)
    column1 = min(source_column + source.shape[1], target_column + target.shape[1])
    for row in range(row0, row1):
        for column in range(column0, column1):
            target[row - target_row, column - target_column] = source[row - source_row, column - source_column]
