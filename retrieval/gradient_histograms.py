"""Orientation and descriptor of a SIFT keypoint: histograms of gradients (compiled kernels)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.geometry.mesh import FloatArray
from retrieval.scale_space import SingleArray

#: Bins of the histogram of directions around a keypoint.
ORIENTATION_BINS = 36

#: Number of times that the histogram of directions is smoothed.
SMOOTHINGS = 6

#: A second peak of the orientation histogram gives a second keypoint if it exceeds this share of
#: the highest one.
SECONDARY_PEAK = 0.8

#: Most directions of a keypoint.
MAX_ORIENTATIONS = 4

#: Spatial bins of a descriptor along each side.
SPATIAL_BINS = 4

#: Directions of each spatial bin.
ANGULAR_BINS = 8

#: Spatial bins along a side with one at each end, which takes the spill of interpolation.
PADDED = SPATIAL_BINS + 2

#: Numbers of a descriptor.
DESCRIPTOR_SIZE = SPATIAL_BINS * SPATIAL_BINS * ANGULAR_BINS

#: Width of a spatial bin in units of the keypoint's scale.
MAGNIFICATION = 3.0

#: Standard deviation of the descriptor's window, in spatial bins.
WINDOW = 2.0

#: Largest entry of a unit vector before it is normalised again.
CLIP = 0.2

#: Offsets, in bins, of four neighbouring cells from the first.
CORNERS = np.array([0, 1, PADDED, PADDED + 1], dtype=np.uint64) * np.uint64(ANGULAR_BINS)

#: A full turn in radians.
TURN = np.float32(2.0 * np.pi)


@njit(cache=True, nogil=True, error_model="numpy")
def gradients(
    gaussian: SingleArray,
    y: float,
    sigma: float,
    done: NDArray[np.bool_],
    magnitudes: SingleArray,
    angles: SingleArray,
) -> None:
    """Compute lengths and angles of the gradients of a Gaussian level around a keypoint.

    Whole rows are computed, except those that an earlier keypoint has needed already.

    Parameters
    ----------
    gaussian
        Level of the scale space, shape (height, width) or larger, float32.
    y, sigma
        Row and scale of the keypoint in pixels of the octave.
    done
        Whether each row has been computed, shape (height or more,); updated.
    magnitudes
        Overwritten, except at the border: lengths of the central differences, shape (height,
        width), float32.
    angles
        Overwritten, except at the border: angles of the central differences in [0, 2 pi], from the
        x axis towards the y axis (downwards), of the same shape. Errors are below 3e-4.
    """
    height, width = magnitudes.shape
    half = np.float32(0.5)
    quarter_turn = np.float32(0.5 * np.pi)
    half_turn = np.float32(np.pi)
    # Half the diagonal of the square that a descriptor covers, however it is turned.
    reach = int(np.sqrt(0.5) * (SPATIAL_BINS + 1) * MAGNIFICATION * sigma) + 2
    for row in range(max(int(y) - reach, 1), min(int(y) + reach + 1, height - 1)):
        if done[row]:
            continue
        done[row] = True
        left = gaussian[row, : width - 2]
        right = gaussian[row, 2:]
        above = gaussian[row - 1, 1 : width - 1]
        below = gaussian[row + 1, 1 : width - 1]
        magnitude = magnitudes[row, 1 : width - 1]
        angle = angles[row, 1 : width - 1]
        for x in range(width - 2):
            gx = half * (right[x] - left[x])
            gy = half * (below[x] - above[x])
            magnitude[x] = np.sqrt(gx * gx + gy * gy)
            # The angle: a polynomial approximates the arc tangent up to an eighth of a turn, and
            # symmetries extend it to the whole turn.
            ax = abs(gx)
            ay = abs(gy)
            larger, smaller = (ax, ay) if ax > ay else (ay, ax)
            ratio = smaller / (larger + np.float32(1e-30))  # 0 without a gradient
            square = ratio * ratio
            turn = np.float32(-0.0464964749) * square + np.float32(0.15931422)
            turn = (turn * square - np.float32(0.327622764)) * square * ratio + ratio
            # Extend the angle to the first quarter, the first half, and the whole turn.
            turn = quarter_turn - turn if ay > ax else turn
            turn = half_turn - turn if gx < 0 else turn
            angle[x] = TURN - turn if gy < 0 else turn


@njit(cache=True, nogil=True, error_model="numpy")
def orientations(
    magnitudes: SingleArray,
    angles: SingleArray,
    x: float,
    y: float,
    sigma: float,
    peaks: FloatArray,
) -> int:
    """Find the dominant gradient directions around a keypoint [Lowe 2004, section 5].

    Parameters
    ----------
    magnitudes, angles
        Gradients of the Gaussian level nearest to the keypoint's scale, from :func:`gradients`.
    x, y, sigma
        Position and scale in pixels of the octave.
    peaks
        Shape (4,), overwritten with radians in [0, 2 pi).

    Returns
    -------
    int
        Number of directions, 1 to 4; 0 if the window has no gradient.
    """
    height, width = magnitudes.shape
    spread = 1.5 * sigma
    radius = max(int(np.floor(3.0 * spread)), 1)
    column = int(x + 0.5)
    row = int(y + 0.5)
    # Angles lie in [0, 2 pi], so places lie in [0.5, 36.5]: the lower bin is at most 36, its
    # neighbour 37.
    histogram = np.zeros(ORIENTATION_BINS + 2, dtype=np.float32)
    per_radian = np.float32(ORIENTATION_BINS / (2.0 * np.pi))
    half = np.float32(0.5)
    one = np.float32(1.0)
    window_x = np.exp(
        -0.5 * ((np.arange(column - radius, column + radius + 1) - x) / spread) ** 2
    ).astype(np.float32)
    # Buffers of one row, at most as wide as the window, for the vectorised work before samples are
    # added to the bins.
    lowers = np.empty(len(window_x), np.int32)
    shares = np.empty_like(window_x)
    weights = np.empty_like(window_x)
    for r in range(max(row - radius, 1), min(row + radius, height - 2) + 1):
        window_y = np.float32(np.exp(-0.5 * ((r - y) / spread) ** 2))
        reach = np.sqrt(max(radius * radius + 0.6 - (r - y) ** 2, 0.0))
        first = max(int(np.ceil(x - reach)), column - radius, 1)
        last = min(int(x + reach), column + radius, width - 2)
        count = max(last + 1 - first, 0)
        magnitude = magnitudes[r, first : first + count]
        angle = angles[r, first : first + count]
        window = window_x[first - column + radius : first - column + radius + count]
        for s in range(count):
            # Shifted by one bin, so that both neighbours of the first and the last bin exist.
            position = per_radian * angle[s] + half
            lowers[s] = np.int32(position)
            shares[s] = position - np.float32(np.int32(position))
            weights[s] = magnitude[s] * window_y * window[s]
        for s in range(count):
            histogram[lowers[s]] += (one - shares[s]) * weights[s]
            histogram[lowers[s] + 1] += shares[s] * weights[s]
    histogram[1] += histogram[ORIENTATION_BINS + 1]
    histogram[ORIENTATION_BINS] += histogram[0]
    n_peaks: int = _peaks(histogram[1 : ORIENTATION_BINS + 1].astype(np.float64), peaks)
    return n_peaks


@njit(cache=True, nogil=True, error_model="numpy")
def _peaks(histogram: FloatArray, peaks: FloatArray) -> int:
    """Find the high peaks of a histogram of directions, more precisely than its bins.

    Parameters
    ----------
    histogram
        Weight of each direction, shape (ORIENTATION_BINS,): the last bin is next to the first. It
        is smoothed in place.
    peaks
        Overwritten with the directions of the peaks in [0, 2 pi), shape (MAX_ORIENTATIONS,) or
        larger.

    Returns
    -------
    int
        Number of peaks.
    """
    for _ in range(SMOOTHINGS):
        _smooth(histogram)
    highest = histogram.max()
    count = 0
    for i in range(ORIENTATION_BINS):
        here = histogram[i]
        before = histogram[i - 1]
        after = histogram[(i + 1) % ORIENTATION_BINS]
        is_high = here > SECONDARY_PEAK * highest
        # Of two equal neighbours, the first is the peak.
        is_peak = here > before and here >= after
        if is_high and is_peak and count < MAX_ORIENTATIONS:
            # The top of the parabola through the three bins, in bins from the middle one.
            offset = -0.5 * (after - before) / (after + before - 2.0 * here)
            peaks[count] = (2.0 * np.pi * (i + offset + 0.5) / ORIENTATION_BINS) % (2.0 * np.pi)
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _smooth(histogram: FloatArray) -> None:
    """Replace each bin of a circular histogram by the mean of it and both neighbours, in place."""
    previous = histogram[ORIENTATION_BINS - 1]
    first = histogram[0]
    for i in range(ORIENTATION_BINS):
        following = histogram[i + 1] if i + 1 < ORIENTATION_BINS else first
        smoothed = (previous + histogram[i] + following) / 3.0
        previous = histogram[i]
        histogram[i] = smoothed


@njit(cache=True, nogil=True, error_model="numpy")
def write_descriptor(
    magnitudes: SingleArray,
    angles: SingleArray,
    x: float,
    y: float,
    sigma: float,
    angle: float,
    descriptor: NDArray[np.uint8],
) -> None:
    """Compute histograms over 4 x 4 spatial and 8 angular bins, rotated [Lowe 2004, section 6].

    Parameters
    ----------
    magnitudes, angles, x, y, sigma
        As in :func:`orientations`.
    angle
        Direction of the keypoint in radians.
    descriptor
        Shape (128,), uint8, overwritten: spatial row, spatial column, angle (fastest); 512 times
        the unit vector, clipped at 255, as in vl_sift.
    """
    height, width = magnitudes.shape
    bin_width = MAGNIFICATION * sigma
    reach = 0.5 * (SPATIAL_BINS + 1)
    cosine = np.cos(angle) / bin_width
    sine = np.sin(angle) / bin_width
    radius = int(np.ceil(reach * bin_width * (abs(np.cos(angle)) + abs(np.sin(angle)))))
    column = int(x + 0.5)
    row = int(y + 0.5)
    decay = -0.5 / (WINDOW * bin_width) ** 2
    window_x = np.exp(decay * (np.arange(column - radius, column + radius + 1) - x) ** 2).astype(
        np.float32
    )
    # One bin of padding on each spatial side takes the spill of trilinear interpolation without a
    # test.
    histogram = np.zeros(PADDED * PADDED * ANGULAR_BINS, dtype=np.float32)
    per_radian = np.float32(ANGULAR_BINS / (2.0 * np.pi))
    turned = np.float32(angle - 2.0 * np.pi)
    one = np.float32(1.0)
    step_u = np.float32(cosine)
    step_v = np.float32(-sine)
    # Buffers of one row, at most as wide as the window, for the vectorised work before samples are
    # added to the bins.
    room = len(window_x)
    cells = np.empty(room, np.int32)
    bins = np.empty(room, np.int32)
    shares = np.empty(room, np.float32)
    weights = np.empty((4, room), np.float32)
    for r in range(max(row - radius, 1), min(row + radius, height - 2) + 1):
        dy = r - y
        window_y = np.float32(np.exp(decay * dy * dy))
        first, last = _span(
            sine * dy,
            cosine,
            reach,
            max(column - radius, 1) - x,
            min(column + radius, width - 2) - x,
        )
        first, last = _span(cosine * dy, -sine, reach, first, last)
        start_u = np.float32(sine * dy + reach - cosine * x)
        start_v = np.float32(cosine * dy + reach + sine * x)
        begin = int(np.ceil(first + x))
        count = max(int(np.floor(last + x)) + 1 - begin, 0)
        magnitude = magnitudes[r, begin : begin + count]
        direction = angles[r, begin : begin + count]
        window = window_x[begin - column + radius : begin - column + radius + count]
        for s in range(count):
            w = (direction[s] - turned) * per_radian
            bins[s] = np.int32(w)
            shares[s] = w - np.float32(np.int32(w))
            u = start_u + step_u * np.float32(np.int32(begin + s))
            v = start_v + step_v * np.float32(np.int32(begin + s))
            # Rounding may move a sample slightly outside the square.
            i = min(max(np.int32(u), np.int32(0)), np.int32(SPATIAL_BINS))
            j = min(max(np.int32(v), np.int32(0)), np.int32(SPATIAL_BINS))
            u = u - np.float32(i)
            v = v - np.float32(j)
            cells[s] = (j * np.int32(PADDED) + i) * np.int32(ANGULAR_BINS)
            weight = magnitude[s] * window_y * window[s]
            upper = weight * v
            lower = weight - upper
            weights[0, s] = lower * (one - u)
            weights[1, s] = lower * u
            weights[2, s] = upper * (one - u)
            weights[3, s] = upper * u
        for s in range(count):
            # Unsigned indices need no instruction for negative ones.
            near = np.uint64(bins[s] & (ANGULAR_BINS - 1))
            far = np.uint64((bins[s] + 1) & (ANGULAR_BINS - 1))
            share = shares[s]
            rest = one - shares[s]
            cell = np.uint64(cells[s])
            for corner in range(4):
                weight = weights[corner, s]
                first_bin = cell + CORNERS[corner]
                histogram[first_bin + near] += weight * rest
                histogram[first_bin + far] += weight * share
    _normalise(
        histogram.reshape(PADDED, PADDED, ANGULAR_BINS)[1:-1, 1:-1].copy().ravel(), descriptor
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _normalise(values: SingleArray, descriptor: NDArray[np.uint8]) -> None:
    """Write a histogram as a unit vector that is clipped and normalised again."""
    for limit in (CLIP, 1.0):
        norm = max(np.sqrt((values * values).sum()), np.float32(1e-30))
        for place in range(DESCRIPTOR_SIZE):
            values[place] = min(values[place] / norm, np.float32(limit))
    for place in range(DESCRIPTOR_SIZE):
        descriptor[place] = np.uint8(min(np.float32(512.0) * values[place], np.float32(255.0)))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _span(
    constant: float, slope: float, reach: float, first: float, last: float
) -> tuple[float, float]:
    """Narrow the interval [first, last] to the t with abs(constant + slope * t) <= reach."""
    if abs(slope) < 1e-12:
        return (first, last) if abs(constant) <= reach else (1.0, 0.0)
    end = (-reach - constant) / slope
    other_end = (reach - constant) / slope
    return max(first, min(end, other_end)), min(last, max(end, other_end))
