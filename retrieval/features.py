"""SIFT on depth images in single precision: the local features of the scorer.

The settings are those of vl_sift: no upsampling of the image, three levels per octave, an initial
scale of 1.6 pixels and a nominal blur of 0.5, edge ratio 10, descriptors as unsigned bytes. Depth
is never reduced to eight bits: the steps between grey levels would put keypoints on contour lines
that the surface does not have.

References
----------
Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 60, 2004. Vedaldi &
Fulkerson, "VLFeat: an open and portable library of computer vision algorithms", 2008 (the
settings).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from retrieval.gradient_histograms import (
    DESCRIPTOR_SIZE,
    MAX_ORIENTATIONS,
    gradients,
    orientations,
    write_descriptor,
)
from retrieval.scale_space import (
    BASE_SCALE,
    LEVELS,
    MARGIN,
    N_GAUSSIANS,
    SMALLEST_SIDE,
    STEP,
    build_octave,
    find_extrema,
    octave_buffers,
    octave_in,
)

#: Largest ratio of the principal curvatures at a keypoint.
EDGE_RATIO = 10.0


def mirrored(
    features: Mapping[str, NDArray[Any]], view_permutation: NDArray[np.int32]
) -> dict[str, NDArray[Any]]:
    """Return the features of the mirror image of a form.

    The mirror image of a view has the same keypoints with descriptors flipped along their own axes,
    so no rendering is needed.

    Parameters
    ----------
    features
        From :func:`detect_views`.
    view_permutation
        Shape (number of views,): the view that shows the mirror image of view v.
    """
    cells = features["descriptors"].reshape(-1, 4, 4, 8)
    flipped = cells[:, ::-1, :, (-np.arange(8)) % 8].reshape(-1, DESCRIPTOR_SIZE)
    per_view = np.split(flipped, features["view_offsets"][1:-1])
    source = np.argsort(view_permutation)
    sizes = np.diff(features["view_offsets"])[source]
    return {
        "descriptors": np.concatenate([per_view[view] for view in source]),
        "view_offsets": np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32),
    }


def detect_views(
    images: NDArray[np.float32], *, peak_threshold: float, background: float
) -> dict[str, NDArray[Any]]:
    """Detect and describe the keypoints of every view of a form.

    Parameters
    ----------
    images
        Shape (number of views, height, width), float32.
    peak_threshold
        Minimum absolute difference of Gaussians at a keypoint, in units of the images, which lie in
        [0, 1].
    background
        Value of pixels that show no surface; the search skips regions far from all other pixels.

    Returns
    -------
    dict
        ``descriptors``, shape (k, 128), uint8, and ``view_offsets``, shape (number of views + 1,),
        int32: those of view v are the rows ``view_offsets[v]`` to ``view_offsets[v + 1]``.
    """
    _, descriptors, offsets = _detect_all(
        images, np.float32(background), peak_threshold, EDGE_RATIO
    )
    return {"descriptors": descriptors, "view_offsets": offsets}


@njit(cache=True, nogil=True)
def _detect_all(
    images: NDArray[np.float32], background: np.float32, peak_threshold: float, edge_ratio: float
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.int32]]:
    """Return the keypoints of all images, one image after the other.

    Returns
    -------
    frames : numpy.ndarray
        x, y, scale and angle of each keypoint, shape (k, 4).
    descriptors : numpy.ndarray
        Shape (k, 128).
    offsets : numpy.ndarray
        First keypoint of each image, and the number of all.
    """
    n_images, height, width = images.shape
    frames = np.empty((4096, 4))
    descriptors = np.empty((4096, DESCRIPTOR_SIZE), dtype=np.uint8)
    offsets = np.zeros(n_images + 1, dtype=np.int32)
    points = np.empty((1024, 4))
    peaks = np.empty(MAX_ORIENTATIONS)  # no more are written
    # The memory of all octaves of all views: new memory would cost as much time as its use.
    room, run = octave_buffers(height, width)
    gradient_room = np.empty((2, height * width), dtype=np.float32)
    backgrounds = _backgrounds(background, min(height, width))
    count = 0
    for index in range(n_images):
        base = images[index, ::1, ::1]
        base_row = 0
        base_column = 0
        top, bottom, left, right = _foreground(images[index], background)
        n_octaves = len(backgrounds) if top < bottom else 0
        for octave in range(n_octaves):
            pixel = 2**octave
            row0 = max(top // pixel - MARGIN, 0)
            row1 = min(bottom // pixel + MARGIN + 1, height // pixel)
            column0 = max(left // pixel - MARGIN, 0)
            column1 = min(right // pixel + MARGIN + 1, width // pixel)
            h = row1 - row0
            w = column1 - column0
            bordered, pixels = octave_in(room, h, w)
            differences = pixels[N_GAUSSIANS:]
            # The first octave begins with the image, the others with a Gaussian level.
            begin = 0 if octave else -1
            start = pixels[begin, :h, :w]
            _paste(base, base_row, base_column, start, row0, column0, backgrounds[octave])
            build_octave(bordered, run, octave == 0)
            n_points = find_extrema(differences, peak_threshold, edge_ratio, points)
            # Extrema beyond the capacity are counted, so a second search has room for all.
            if n_points > len(points):
                points = np.empty((2 * n_points, 4))
                n_points = find_extrema(differences, peak_threshold, edge_ratio, points)
            magnitudes = gradient_room[0, : h * w].reshape(h, w)
            angles = gradient_room[1, : h * w].reshape(h, w)
            done = np.zeros(h, dtype=np.bool_)
            level_done = 0
            for k in range(n_points):
                x = points[k, 0]
                y = points[k, 1]
                level = int(points[k, 2])
                sigma = BASE_SCALE * STEP ** (level + 1 + points[k, 3])
                if level != level_done:
                    done[:] = False
                    level_done = level
                gradients(pixels[level + 1], y, sigma, done, magnitudes, angles)
                for a in range(orientations(magnitudes, angles, x, y, sigma, peaks)):
                    if count == len(frames):
                        frames = np.concatenate((frames, np.empty_like(frames)))
                        descriptors = np.concatenate((descriptors, np.empty_like(descriptors)))
                    frames[count, 0] = pixel * (x + column0)
                    frames[count, 1] = pixel * (y + row0)
                    frames[count, 2] = pixel * sigma
                    frames[count, 3] = peaks[a]
                    write_descriptor(magnitudes, angles, x, y, sigma, peaks[a], descriptors[count])
                    count += 1
            # The level of twice the base scale, every second pixel, starts the next octave.
            base = pixels[LEVELS, row0 % 2 : h : 2, column0 % 2 : w : 2]
            base_row = (row0 + 1) // 2
            base_column = (column0 + 1) // 2
        offsets[index + 1] = count
    return frames[:count].copy(), descriptors[:count].copy(), offsets


@njit(cache=True, nogil=True)
def _foreground(image: NDArray[np.float32], background: np.float32) -> tuple[int, int, int, int]:
    """Return the bounding box of the pixels of an image that differ from the background.

    Parameters
    ----------
    image
        Shape (height, width).
    background
        Value of the background.

    Returns
    -------
    top, bottom, left, right : int
        The box contains the rows ``top`` to ``bottom - 1`` and the columns ``left`` to ``right -
        1``. All are 0 if there are no such pixels.
    """
    height, width = image.shape
    is_column_seen = np.zeros(width, dtype=np.uint8)
    top = height
    bottom = 0
    for row in range(height):
        pixels = image[row]
        n_seen = 0
        for column in range(width):
            is_seen = pixels[column] != background
            is_column_seen[column] |= is_seen
            n_seen += is_seen
        if n_seen:
            top = min(top, row)
            bottom = row + 1
    if bottom == 0:
        return 0, 0, 0, 0
    left = 0
    while not is_column_seen[left]:
        left += 1
    right = width
    while not is_column_seen[right - 1]:
        right -= 1
    return top, bottom, left, right


@njit(cache=True, nogil=True)
def _backgrounds(background: np.float32, side: int) -> NDArray[np.float32]:
    """Return the value of the background in each octave of the scale space of an image.

    Blurring changes the last bits of a constant background. They are computed here by blurring an
    image of one pixel with its border through all octaves. If the original value were used, an edge
    would be found between it and the blurred background.

    Parameters
    ----------
    background
        Value in the image.
    side
        Shorter side of the image in pixels, which determines the number of octaves.

    Returns
    -------
    numpy.ndarray
        Shape (octaves,), float32.
    """
    n_octaves = 1
    while side >> n_octaves >= SMALLEST_SIDE:
        n_octaves += 1
    values = np.full(n_octaves, background, dtype=np.float32)
    room, half_blurred = octave_buffers(1, 1)
    bordered, pixels = octave_in(room, 1, 1)
    # build_octave works in place: it reads the image that an octave begins with from ``pixels`` (in
    # the first octave from its last layer, in others from its first one), and writes the levels.
    place_of_image = len(pixels) - 1
    for octave in range(1, n_octaves):
        is_first = octave == 1
        begin = place_of_image if is_first else 0
        pixels[begin, 0, 0] = values[octave - 1]
        build_octave(bordered, half_blurred, is_first)
        values[octave] = pixels[LEVELS, 0, 0]
    return values


@njit(cache=True, nogil=True)
def _paste(
    source: NDArray[np.float32],
    source_row: int,
    source_column: int,
    target: NDArray[np.float32],
    target_row: int,
    target_column: int,
    beyond: np.float32,
) -> None:
    """Fill a window of an image from another window of the same image, where they overlap.

    Parameters
    ----------
    source
        Pixels of the window that is known, shape (height, width).
    source_row, source_column
        Position of its first pixel in the image.
    target
        Pixels of the window to fill, overwritten; another shape (height, width).
    target_row, target_column
        Position of its first pixel in the image.
    beyond
        Value of the pixels of the target that the source does not cover.
    """
    # The common part of both windows, in rows and columns of the image.
    row0 = max(source_row, target_row)
    row1 = min(source_row + source.shape[0], target_row + target.shape[0])
    column0 = max(source_column, target_column)
    column1 = min(source_column + source.shape[1], target_column + target.shape[1])
    overlap = source[
        row0 - source_row : row1 - source_row, column0 - source_column : column1 - source_column
    ]
    target[:, :] = beyond
    target[
        row0 - target_row : row1 - target_row, column0 - target_column : column1 - target_column
    ] = overlap
