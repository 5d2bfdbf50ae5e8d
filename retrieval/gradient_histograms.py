"""Orientation and descriptor of a SIFT keypoint: histograms of gradients in a Gaussian window (compiled kernels)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

ORIENTATION_BINS = 36
#: A second peak of the orientation histogram makes a second keypoint when it reaches this share of the highest one.
SECONDARY_PEAK = 0.8
MAX_ORIENTATIONS = 4
SPATIAL_BINS = 4
ANGULAR_BINS = 8
DESCRIPTOR_SIZE = SPATIAL_BINS * SPATIAL_BINS * ANGULAR_BINS
#: Width of a spatial bin in units of the keypoint's scale.
MAGNIFICATION = 3.0
#: Standard deviation of the descriptor's window, in spatial bins.
WINDOW = 2.0
CLIP = 0.2
TURN = np.float32(2.0 * np.pi)


@njit(cache=True, nogil=True, inline="always")
def _angle(gx: np.float32, gy: np.float32) -> np.float32:
    """Arc tangent of gy / gx in [0, 2 pi), float32, with an error below 3e-4: far below the width of a bin."""
    ax, ay = abs(gx), abs(gy)
    ratio = min(ax, ay) / max(max(ax, ay), np.float32(1e-30))
    square = ratio * ratio
    angle = (
        (np.float32(-0.0464964749) * square + np.float32(0.15931422)) * square - np.float32(0.327622764)
    ) * square * ratio + ratio
    angle = np.float32(0.5 * np.pi) - angle if ay > ax else angle
    angle = np.float32(np.pi) - angle if gx < 0 else angle
    return TURN - angle if gy < 0 else angle


@njit(cache=True, nogil=True)
def orientations(gaussian: SingleArray, x: float, y: float, sigma: float, angles: FloatArray) -> int:
    """Dominant gradient directions around a keypoint [Lowe 2004, section 5].

    Parameters
    ----------
    gaussian
        Gaussian level nearest to the keypoint's scale, shape (height, width), float32.
    x, y, sigma
        Position and scale in pixels of the octave.
    angles
        Shape (4,), overwritten with radians in [0, 2 pi), from the x axis towards the y axis (downwards).

    Returns
    -------
    int
        Number of directions, 1 to 4; 0 where the window has no gradient.
    """
    height, width = gaussian.shape
    spread = 1.5 * sigma
    radius = max(int(np.floor(3.0 * spread)), 1)
    column, row = int(x + 0.5), int(y + 0.5)
    histogram = np.zeros(ORIENTATION_BINS)
    per_radian = ORIENTATION_BINS / (2.0 * np.pi)
    window_x = np.exp(-0.5 * ((np.arange(column - radius, column + radius + 1) - x) / spread) ** 2)
    for r in range(max(row - radius, 1), min(row + radius, height - 2) + 1):
        above, here, below = gaussian[r - 1], gaussian[r], gaussian[r + 1]
        window_y = np.exp(-0.5 * ((r - y) / spread) ** 2)
        for c in range(max(column - radius, 1), min(column + radius, width - 2) + 1):
            if (r - y) ** 2 + (c - x) ** 2 >= radius * radius + 0.6:
                continue
            gx = np.float32(0.5) * (here[c + 1] - here[c - 1])
            gy = np.float32(0.5) * (below[c] - above[c])
            squared = gx * gx + gy * gy
            if squared == 0.0:
                continue
            position = per_radian * _angle(gx, gy)
            lower = int(np.floor(position - 0.5))
            share = position - lower - 0.5
            weight = np.sqrt(squared) * window_y * window_x[c - column + radius]
            histogram[lower % ORIENTATION_BINS] += (1.0 - share) * weight
            histogram[(lower + 1) % ORIENTATION_BINS] += share * weight
    for _ in range(6):
        previous, first = histogram[ORIENTATION_BINS - 1], histogram[0]
        for i in range(ORIENTATION_BINS):
            following = histogram[i + 1] if i + 1 < ORIENTATION_BINS else first
            smoothed = (previous + histogram[i] + following) / 3.0
            previous = histogram[i]
            histogram[i] = smoothed
    highest = histogram.max()
    count = 0
    for i in range(ORIENTATION_BINS):
        h, before, after = histogram[i], histogram[i - 1], histogram[(i + 1) % ORIENTATION_BINS]
        # Of two equal neighbours, as gradients along an axis make them, the first is the peak.
        if h > SECONDARY_PEAK * highest and h > before and h >= after and count < MAX_ORIENTATIONS:
            offset = -0.5 * (after - before) / (after + before - 2.0 * h)
            angles[count] = (2.0 * np.pi * (i + offset + 0.5) / ORIENTATION_BINS) % (2.0 * np.pi)
            count += 1
    return count


@njit(cache=True, nogil=True)
def describe(
    gaussian: SingleArray, x: float, y: float, sigma: float, angle: float, descriptor: NDArray[np.uint8]
) -> None:
    """Gradient histograms over 4 x 4 spatial and 8 angular bins, turned by ``angle`` [Lowe 2004, section 6].

    Parameters
    ----------
    gaussian, x, y, sigma
        As in :func:`orientations`.
    angle
        Direction of the keypoint in radians.
    descriptor
        Shape (128,), uint8, overwritten: spatial row, spatial column, angle (fastest); 512 times the unit vector,
        cut at 255, as vl_sift stores it.
    """
    height, width = gaussian.shape
    bin_width = MAGNIFICATION * sigma
    reach = 0.5 * (SPATIAL_BINS + 1)
    cosine, sine = np.cos(angle) / bin_width, np.sin(angle) / bin_width
    radius = int(np.ceil(reach * bin_width * (abs(np.cos(angle)) + abs(np.sin(angle)))))
    column, row = int(x + 0.5), int(y + 0.5)
    decay = -0.5 / (WINDOW * bin_width) ** 2
    window_x = np.exp(decay * (np.arange(column - radius, column + radius + 1) - x) ** 2).astype(np.float32)
    # One bin of padding on each spatial side takes the spill of trilinear interpolation, so that no test is needed.
    histogram = np.zeros((SPATIAL_BINS + 2, SPATIAL_BINS + 2, ANGULAR_BINS), dtype=np.float32)
    per_radian, turned, one = np.float32(ANGULAR_BINS / (2.0 * np.pi)), np.float32(angle), np.float32(1.0)
    for r in range(max(row - radius, 1), min(row + radius, height - 2) + 1):
        above, here, below = gaussian[r - 1], gaussian[r], gaussian[r + 1]
        dy = r - y
        window_y = np.float32(np.exp(decay * dy * dy))
        first, last = _span(sine * dy, cosine, reach, max(column - radius, 1) - x, min(column + radius, width - 2) - x)
        first, last = _span(cosine * dy, -sine, reach, first, last)
        for c in range(int(np.ceil(first + x)), int(np.floor(last + x)) + 1):
            gx = here[c + 1] - here[c - 1]
            gy = below[c] - above[c]
            squared = gx * gx + gy * gy
            if squared == 0.0:
                continue
            u = np.float32(cosine * (c - x) + sine * dy + reach)
            v = np.float32(cosine * dy - sine * (c - x) + reach)
            w = (_angle(gx, gy) - turned) * per_radian
            w = w + np.float32(ANGULAR_BINS) if w < 0 else w
            # Rounding may put a sample a hair outside the square.
            i = min(max(int(u), 0), SPATIAL_BINS)
            j = min(max(int(v), 0), SPATIAL_BINS)
            k = int(w)
            u, v, w = u - np.float32(i), v - np.float32(j), w - np.float32(k)
            k, k1 = k & (ANGULAR_BINS - 1), (k + 1) & (ANGULAR_BINS - 1)
            weight = np.sqrt(squared) * window_y * window_x[c - column + radius]
            upper, lower = weight * v, weight * (one - v)
            a, b, d, e = lower * (one - u), lower * u, upper * (one - u), upper * u
            rest = one - w
            histogram[j, i, k] += a * rest
            histogram[j, i, k1] += a * w
            histogram[j, i + 1, k] += b * rest
            histogram[j, i + 1, k1] += b * w
            histogram[j + 1, i, k] += d * rest
            histogram[j + 1, i, k1] += d * w
            histogram[j + 1, i + 1, k] += e * rest
            histogram[j + 1, i + 1, k1] += e * w
    inner = histogram[1:-1, 1:-1, :].copy().ravel()
    for limit in (CLIP, 1.0):
        norm = max(np.sqrt((inner * inner).sum()), np.float32(1e-30))
        for i in range(DESCRIPTOR_SIZE):
            inner[i] = min(inner[i] / norm, np.float32(limit))
    for i in range(DESCRIPTOR_SIZE):
        descriptor[i] = np.uint8(min(np.float32(512.0) * inner[i], np.float32(255.0)))


@njit(cache=True, nogil=True, inline="always")
def _span(constant: float, slope: float, reach: float, first: float, last: float) -> tuple[float, float]:
    """Narrow the interval [first, last] to where abs(constant + slope * t) <= reach."""
    if abs(slope) < 1e-12:
        return (first, last) if abs(constant) <= reach else (1.0, 0.0)
    one, other = (-reach - constant) / slope, (reach - constant) / slope
    return max(first, min(one, other)), min(last, max(one, other))
