"""Views of a body from a depth camera: tilted, with holes, noise and quantisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Faces, Points
from benchmark.geometry.rasterise import NOT_BEHIND, DepthImage, draw_triangles

LARGEST_ELEVATION, LARGEST_ROLL = 25.0, 6.0
"""Maximum elevation and roll of a camera, in degrees."""

_LEAST_DEPTH = 1e-3
"""Minimum foreground depth."""


@dataclass(frozen=True)
class Perturbations:
    """Faults of an image.

    Parameters
    ----------
    elevation, roll
        Elevation and roll of the camera, in degrees.
    missing
        Whether the left and the right hand are missing.
    noise
        Standard deviation of a pixel's depth, as a fraction of the frame.
    step
        Quantisation step of the depth, as a fraction of the frame; 0 for none.
    dropped
        Fraction of missing pixels.
    holes
        Number of circular holes.
    """

    elevation: float = 0.0
    roll: float = 0.0
    missing: tuple[bool, bool] = (False, False)
    noise: float = 0.0
    step: float = 0.0
    dropped: float = 0.0
    holes: int = 0


def drawn_perturbations(random: np.random.Generator) -> Perturbations:
    """Draw perturbations; about one image in six has none, so that clean views remain in the distribution.

    Parameters
    ----------
    random
        Random generator.
    """
    elevated, seen_badly, torn = random.random(3) < (0.5, 0.5, 0.3)
    return Perturbations(
        elevation=float(np.clip(random.normal(0, 10), -LARGEST_ELEVATION, LARGEST_ELEVATION)) if elevated else 0.0,
        roll=float(np.clip(random.normal(0, 2), -LARGEST_ROLL, LARGEST_ROLL)) if elevated else 0.0,
        missing=(bool(random.random() < 0.06), bool(random.random() < 0.06)),
        noise=float(random.uniform(0, 0.005)) if seen_badly else 0.0,
        step=float(random.choice([0.0, 0.002, 0.005, 0.01])) if seen_badly else 0.0,
        dropped=float(random.uniform(0, 0.05)) if torn else 0.0,
        holes=int(random.integers(0, 5)) if torn else 0,
    )


def turned(vertices: Points, perturbations: Perturbations) -> Points:
    """Return vertices in camera coordinates: right, up, towards the camera, centred on the bounding box.

    Parameters
    ----------
    vertices
        Shape (n, 3), z up, facing -y.
    perturbations
        Elevation and roll of the camera.
    """
    up, askew = np.radians([perturbations.elevation, perturbations.roll])
    seen = np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)
    look = np.array([[1, 0, 0], [0, np.cos(up), -np.sin(up)], [0, np.sin(up), np.cos(up)]])
    hold = np.array([[np.cos(askew), -np.sin(askew), 0], [np.sin(askew), np.cos(askew), 0], [0, 0, 1]])
    points = seen @ (hold @ look).T
    low, high = extents(points)
    return np.asarray(points - (low + high) / 2)


def rendered(points: Points, faces: Faces, half_width: float, size: int) -> DepthImage:
    """Render points in camera coordinates with the depths of :func:`benchmark.geometry.depth.render_depth`."""
    return _drawn(points, faces, half_width, size, NOT_BEHIND)


def both_sides(points: Points, faces: Faces, half_width: float, size: int) -> tuple[DepthImage, DepthImage]:
    """Return the depths of the nearest and farthest surface at each pixel, from the same camera and with the same mask.

    Parameters
    ----------
    points, faces
        A closed surface in camera coordinates.
    half_width
        Half the side of the frame.
    size
        Pixels per side.
    """
    behind = np.full((size, size), np.inf, dtype=np.float32)
    front = _drawn(points, faces, half_width, size, behind)
    # The opposite camera has mirrored columns and measures from its own position: its distance is our depth.
    back = behind[:, ::-1]
    return front, np.where(front > 0, back, 0).astype(np.float32)


def _drawn(points: Points, faces: Faces, half_width: float, size: int, behind: DepthImage) -> DepthImage:
    shares = points / half_width
    pixels = np.empty_like(shares)
    pixels[:, 0] = (1 + shares[:, 0]) * (size / 2)
    pixels[:, 1] = (1 - shares[:, 1]) * (size / 2)
    pixels[:, 2] = (1 - shares[:, 2]) / 2
    distance = np.full((size, size), np.inf, dtype=np.float32)
    draw_triangles(pixels, faces, distance, behind)
    return np.where(np.isfinite(distance), 1 - distance, 0).astype(np.float32)


def perturbed(image: DepthImage, perturbations: Perturbations, random: np.random.Generator) -> DepthImage:
    """Return the image with noise, quantisation, holes and missing pixels; at least half of the surface remains.

    Parameters
    ----------
    image
        Depth image, shape (size, size).
    perturbations
        Faults to apply.
    random
        Random generator for noise and missing pixels.
    """
    seen = image > 0
    result = image.astype(np.float64)
    if perturbations.noise:
        result = result + perturbations.noise * random.standard_normal(image.shape)
    if perturbations.step:
        result = np.round(result / perturbations.step) * perturbations.step
    kept = seen & ~_lost(seen, perturbations, random)
    if np.count_nonzero(kept) < np.count_nonzero(seen) / 2:
        kept = seen
    return np.where(kept, np.clip(result, _LEAST_DEPTH, 1), 0).astype(np.float32)


def _lost(seen: NDArray[np.bool_], perturbations: Perturbations, random: np.random.Generator) -> NDArray[np.bool_]:
    lost = np.zeros(seen.shape, dtype=bool)
    if perturbations.dropped:
        lost |= random.random(seen.shape) < perturbations.dropped
    rows, columns = np.nonzero(seen)
    if perturbations.holes and len(rows):
        grid = np.arange(len(seen))
        for _ in range(perturbations.holes):
            place = random.integers(len(rows))
            radius = random.uniform(0.01, 0.04) * len(seen)
            lost |= (grid[:, None] - rows[place]) ** 2 + (grid - columns[place]) ** 2 < radius**2
    return lost


def extents(points: Points) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the minimum and maximum coordinates, shape (3,) each.

    Equivalent to the extrema along the first axis, but fifty times faster, because numpy does not vectorise reductions
    over rows of three.

    Parameters
    ----------
    points
        Shape (n, 3), n at least 1.
    """
    coordinates = np.ascontiguousarray(points.T)
    return coordinates.min(axis=1), coordinates.max(axis=1)
