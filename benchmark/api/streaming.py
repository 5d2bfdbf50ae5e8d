"""Endless streams of new shapes for learners, as functions that generate a batch from its number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmark.api.learning import TrainingData
from benchmark.geometry.mesh import Mesh

__all__ = ["N_POINTS", "Fresh", "MakesFresh", "MakesSurfaces", "StreamedData", "Surfaces"]


N_POINTS = 250
"""Number of points of a body in ``Fresh.points``."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Fresh:
    """Batch of depth images of bodies that no other batch contains.

    Parameters
    ----------
    identifiers
        Names of the n bodies.
    images
        Depth images of each body, shape (n, k, size, size), float32 in [0, 1], 0 as background; k counts the poses
        times the views of each.
    fronts, backs
        Depths of the nearest and of the farthest surface of the canonical pose at each pixel, from the same viewpoint;
        shape (n, size, size). Both have the same mask.
    drawn_again
        Number of redraws by reason.
    pixels
        Row and column of v points of each body in each image, NaN for hidden points, shape (n, k, v, 2); None if
        unknown.
    places
        The same points in the canonical pose, in camera coordinates divided by the height of the body, shape (n, v, 3).
    points
        Standardised places of ``N_POINTS`` of these points: their offsets from the average body, divided by the root
        mean square of such offsets, shape (n, 3 * N_POINTS).
    """

    identifiers: tuple[str, ...]
    images: NDArray[np.float32]
    fronts: NDArray[np.float32]
    backs: NDArray[np.float32]
    drawn_again: Mapping[str, int]
    pixels: NDArray[np.float32] | None = None
    places: NDArray[np.float32] | None = None
    points: NDArray[np.float32] | None = None


class MakesFresh(Protocol):
    """Deterministic generator of batches by number; can be pickled."""

    def __call__(self, number: int, bodies: int, size: int) -> Fresh:
        """Generate one batch.

        Parameters
        ----------
        number
            Number of the batch, from 0; batches share no body.
        bodies
            Number of bodies.
        size
            Pixels per side.

        Raises
        ------
        DatasetError
            If a body cannot be generated; the message names it.
        """
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Surfaces:
    """Batch of bodies that no other batch contains, as complete surfaces with corresponding vertices.

    Parameters
    ----------
    identifiers
        Names of the n bodies.
    canonical
        Vertices of each body in the canonical pose, shape (n, v, 3), in metres, z up, facing -y.
    posed
        The same vertices in the poses of each body, shape (n, poses, v, 3).
    faces
        Triangles of all bodies, shape (m, 3).
    drawn_again
        Number of redraws by reason.
    """

    identifiers: tuple[str, ...]
    canonical: NDArray[np.float64]
    posed: NDArray[np.float64]
    faces: NDArray[np.int32]
    drawn_again: Mapping[str, int]


class MakesSurfaces(Protocol):
    """Deterministic generator of surfaces by number of the batch; can be pickled."""

    def __call__(self, number: int, bodies: int) -> Surfaces:
        """Generate one batch.

        Parameters
        ----------
        number
            Number of the batch, from 0; batches share no body.
        bodies
            Number of bodies.

        Raises
        ------
        DatasetError
            If a body cannot be generated; the message names it.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class StreamedData(TrainingData):
    """Endless training data; the pairs are a sample of it, for learners that keep all pairs in memory.

    Parameters
    ----------
    fresh
        Generates batches for training.
    validation
        Generates batches of other bodies, independently of the choice of test subjects.
    surfaces, validation_surfaces
        The same bodies as complete surfaces: those of a batch have the same poses as its images.
    wide
        Images of other bodies in harder poses, several of each pose; its surfaces are not of these bodies. None if
        there are none.
    """

    fresh: MakesFresh
    validation: MakesFresh
    surfaces: MakesSurfaces
    validation_surfaces: MakesSurfaces
    wide: StreamedData | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """Scan of a body in a pose.

    Parameters
    ----------
    mesh
        Scanned surface with n vertices.
    corners
        Vertices of the triangle of the body to which each vertex of the scan belongs, shape (n, 3).
    weights
        Barycentric coordinates in this triangle, shape (n, 3).
    """

    mesh: Mesh
    corners: NDArray[np.int64]
    weights: NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Scans:
    """Batch of scanned bodies that no other batch contains.

    Parameters
    ----------
    identifiers
        Names of the n bodies.
    canonical
        Vertices of each body in the canonical pose, shape (n, v, 3), in metres, z up, facing -y.
    faces
        Triangles of all bodies, shape (m, 3).
    scans
        Scans of each body, one per pose.
    drawn_again
        Number of redraws by reason.
    """

    identifiers: tuple[str, ...]
    canonical: NDArray[np.float64]
    faces: NDArray[np.int32]
    scans: tuple[tuple[Scan, ...], ...]
    drawn_again: Mapping[str, int]


MakesScans = Callable[[int, int], Scans]
"""Deterministic function from the number of a batch, from 0, and of its bodies to scans; batches share no body."""


@dataclass(frozen=True, kw_only=True)
class ScannedData(TrainingData):
    """Endless training data of scans.

    Parameters
    ----------
    scans
        Generates batches for training.
    validation
        Generates batches of other bodies.
    """

    scans: MakesScans
    validation: MakesScans


@dataclass(frozen=True, kw_only=True)
class StreamedAndScannedData(StreamedData):
    """Streams of images, surfaces and scans.

    Parameters
    ----------
    scanned
        Stream of scans.
    """

    scanned: ScannedData
