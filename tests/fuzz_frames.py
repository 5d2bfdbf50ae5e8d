"""Depth frames of bodies of known geometry, damaged as cameras and programs do: each has its
figures or is refused.

``python -m tests.fuzz_frames SEED START STOP`` draws the frames of these numbers, and prints how
many are right, say that their object is in pieces, or are refused by name; and each other one."""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmark.depth.frame import observe
from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.reading import Depths, Mask, in_metres
from benchmark.errors import DepthError
from benchmark.geometry.cleaning import connected_components

WIDTH, HEIGHT, FOCAL = 160, 120, 130.0
CAMERA = Intrinsics(FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, (WIDTH, HEIGHT))

#: Longest time in seconds for a frame.
LONGEST = 30

FILTERS = ("NEAREST", "BOX", "BILINEAR", "BICUBIC", "LANCZOS")
MARKS = (0.0, np.nan, np.inf, -1.0, 65.535)
DAMAGES = ("none", "rows", "columns", "random", "diagonals", "dark", "sparse", "mask", "resized")

Random = np.random.Generator


@dataclass(frozen=True)
class Truth:
    """What is known of a frame before it is damaged.

    Parameters
    ----------
    depths
        Depths in metres, infinity where nothing is.
    mask
        Pixels of the object.
    pieces
        Pieces of its surface.
    gap
        Pixels between the pieces.
    """

    depths: Depths
    mask: Mask
    pieces: int
    gap: Mask

    @property
    def distance(self) -> float:
        return float(np.median(self.depths[self.mask]))

    @property
    def size(self) -> float:
        """Longest extent of the centres of the pixels, and one pixel more."""
        rows, columns = np.nonzero(self.mask)
        depth = self.depths[self.mask]
        scale = FOCAL * len(self.depths) / HEIGHT
        across = np.ptp(depth * (columns - (self.mask.shape[1] - 1) / 2) / scale)
        along = np.ptp(depth * (rows - (self.mask.shape[0] - 1) / 2) / scale)
        return float(max(across, along) + self.distance / scale)


def rays(factor: int) -> NDArray[np.float64]:
    """Return the ray of each pixel of an image of so many times the size, shape (h, w, 3)."""
    rows, columns = np.mgrid[: factor * HEIGHT, : factor * WIDTH]
    x = (columns - (factor * WIDTH - 1) / 2) / (factor * FOCAL)
    y = (rows - (factor * HEIGHT - 1) / 2) / (factor * FOCAL)
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def ellipsoid(directions: NDArray[np.float64], centre: list[float], axes: list[float]) -> Depths:
    """Return the depths of an ellipsoid; infinity beside it."""
    scaled, middle = directions / axes, np.divide(centre, axes)
    a = (scaled**2).sum(axis=-1)
    b = scaled @ middle
    c = middle @ middle - 1
    root = np.sqrt(np.maximum(b * b - a * c, 0))
    return np.where(b * b > a * c, (b - root) / a, np.inf)


def board(
    directions: NDArray[np.float64], distance: float, slope: float, half: tuple[float, float]
) -> Depths:
    """Return the depths of a board that leans to the right; infinity beside it."""
    depth = distance / (1 - slope * directions[..., 0])
    inside = (np.abs(directions[..., 0] * depth) < half[0]) & (
        np.abs(directions[..., 1] * depth) < half[1]
    )
    return np.where(inside, depth, np.inf)


def scene(random: Random, factor: int) -> Truth:
    """Draw a body, a board or two bodies with a gap between them."""
    directions, distance = rays(factor), random.uniform(1.0, 3.0)
    none = np.zeros(directions.shape[:2], dtype=bool)
    reach = 0.33 * distance
    kind = random.integers(3)
    if kind == 0:
        axes = [random.uniform(0.4, 1.0) * reach, random.uniform(0.5, 1.0) * reach, 0.2 * reach]
        depths = ellipsoid(directions, [0.0, 0.0, distance + axes[2]], axes)
        return Truth(depths, np.isfinite(depths), 1, none)
    if kind == 1:
        half = (random.uniform(0.4, 1.0) * reach, random.uniform(0.5, 1.0) * reach)
        depths = board(directions, distance, random.uniform(-0.3, 0.3), half)
        return Truth(depths, np.isfinite(depths), 1, none)
    gap = int(random.integers(1, 4)) * factor  # in pixels
    depths = board(directions, distance, 0.0, (0.7 * reach, 0.8 * reach))
    middle = depths.shape[1] // 2
    between = none.copy()
    between[:, middle : middle + gap] = np.isfinite(depths[:, middle : middle + gap])
    depths = np.where(between, np.inf, depths)
    return Truth(depths, np.isfinite(depths), 2, between)


def lost_pixels(damage: str, random: Random) -> Mask:
    """Draw the pixels that a damage leaves without a reading."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    step, width = int(random.integers(12, 40)), int(random.integers(1, 3))
    if damage == "rows":
        return np.asarray(rows % step < width)
    if damage == "columns":
        return np.asarray(columns % step < width)
    if damage == "diagonals":
        return np.asarray((rows + columns) % step < width)
    if damage == "random":
        return np.asarray(random.random(rows.shape) < random.uniform(0, 0.4))
    if damage == "sparse":
        every = int(random.integers(2, 6))
        return np.asarray((rows % every > 0) | (columns % every > 0))
    lost = np.zeros(rows.shape, dtype=bool)
    for _ in range(int(random.integers(1, 6))):
        row, column = random.integers(HEIGHT), random.integers(WIDTH)
        lost |= np.hypot(rows - row, columns - column) < random.uniform(0.5, 2.5)
    return lost


def damaged(
    truth: Truth, damage: str, random: Random, factor: int
) -> tuple[Depths, Mask | None, Mask]:
    """Return the depths, with a mark for missing ones, the mask that is passed, and the pixels of
    the object.
    """
    has_wall = truth.pieces > 1 or random.random() < 0.7
    mark = MARKS[random.integers(len(MARKS))]
    behind = truth.distance + random.uniform(0.6, 2.0) if has_wall else np.nan
    depths = np.where(truth.mask, truth.depths, behind)
    depths += 0.001 * depths**2 * random.standard_normal(depths.shape) * (random.random() < 0.5)
    given: Mask | None = truth.mask
    if factor > 1:
        lost = random.random(depths.shape) < random.choice([0.0, 0.02, 0.05, 0.1, 0.3])
        zeroed = np.where(lost | ~np.isfinite(depths), 0, depths).astype(np.float32)
        name = FILTERS[random.integers(len(FILTERS))]
        image = Image.fromarray(zeroed).resize((WIDTH, HEIGHT), Image.Resampling[name])
        depths, given = np.array(image, dtype=float), truth.mask[::factor, ::factor]
        return np.where(depths > 0, depths, mark), given, given
    if damage == "mask":
        given = truth.mask & ~lost_pixels(str(random.choice(["rows", "columns", "dark"])), random)
    elif damage != "none":
        lost = lost_pixels(damage, random)
        depths = np.where(lost, np.nan, depths)
        if random.random() < 0.3:
            given = truth.mask & ~lost
    if truth.pieces == 1 and random.random() < 0.3:
        given = None
    return np.where(np.isfinite(depths), depths, mark), given, truth.mask


def verdict(number: int, seed: int) -> str:
    """Return what became of a frame: ``right``, ``in pieces``, ``refused``, or what is wrong."""
    random = np.random.default_rng([seed, number])
    damage = DAMAGES[number % len(DAMAGES)]
    factor = 2 if damage == "resized" else 1
    truth = scene(random, factor)
    depths, given, mask = damaged(truth, damage, random, factor)
    kind = random.choice(["f4", "f8", "u2"])
    with np.errstate(invalid="ignore"):
        values = np.round(1000 * depths).clip(0, 65535) if kind == "u2" else depths
        values = np.where(np.isnan(values) & (kind == "u2"), 0, values).astype(kind)
    start = time.process_time()
    try:
        observed = observe(in_metres(values), CAMERA, given)
    except DepthError as error:
        return f"{damage} refused" if error.hint and "\n" not in str(error) else "without a hint"
    if time.process_time() - start > LONGEST:
        return f"{damage} hangs"
    pieces = len(np.unique(connected_components(observed.surface)))
    size, distance = truth.size, truth.distance
    if factor == 1 and not (truth.gap & np.isfinite(depths) & (depths > 0) & (depths < 65)).any():
        # Nothing was measured between two bodies, which may be one.
        truth, mask = replace(truth, pieces=1), mask | truth.gap
    found = f"{pieces} pieces, {observed.notes['size']} m at {observed.notes['distance']} m"
    wrong = f"{damage}, not {truth.pieces}, {size:.3f} at {distance:.3f}: {found}"
    if pieces < truth.pieces:
        return f"joined: {wrong}"
    if not abs(float(observed.notes["distance"]) - distance) < 0.01 + 0.01 * distance:
        return f"displaced: {wrong}"
    if np.count_nonzero(observed.mask & ~mask) > 0.01 * np.count_nonzero(mask):
        return f"beyond the object: {wrong}"
    if pieces > truth.pieces:  # which notes say
        return f"{damage} in pieces"
    covered = np.count_nonzero(observed.mask & mask) / np.count_nonzero(mask)
    if not (abs(float(observed.notes["size"]) - size) < 0.1 * size and covered > 0.8):
        return f"covers {covered:.2f}: {wrong}"
    return f"{damage} right"


def fuzz(seed: int, numbers: range) -> Counter[str]:
    """Judge frames, and count them by what became of them."""
    counts = Counter[str]()
    for number in numbers:
        result = verdict(number, seed)
        is_known = result.endswith((" right", " refused", " in pieces"))
        counts[result if is_known else "wrong"] += 1
        if not is_known:
            print(f"{number}: {result}", flush=True)
    return counts


if __name__ == "__main__":
    results = fuzz(int(sys.argv[1]), range(int(sys.argv[2]), int(sys.argv[3])))
    print(*(f"{count:6d} {what}" for what, count in sorted(results.items())), sep="\n")
    sys.exit(results["wrong"] > 0)
