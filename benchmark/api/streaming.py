"""Endless streams of fresh shapes for a learner: makers of batches, each known by its number."""

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
"""Points of a body whose places are told."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Fresh:
    """Some bodies that no other batch shows.

    Parameters
    ----------
    identifiers
        Names of the bodies, n of them.
    images
        Depth images of each body, shape (n, k, size, size), float32 in [0, 1], 0 as background: its poses, each from
        one side or more.
    fronts, backs
        Depth of the canonical pose as the camera sees it, and of the surface that lies behind everything else at the
        same pixel, counted from the same eye; shape (n, size, size). Both have one mask.
    drawn_again
        How often something was drawn again, by reason.
    pixels
        Row and column at which each image shows points of the body, NaN where something hides them, shape
        (n, k, v, 2); None where they are not told.
    places
        The same points in the canonical pose in coordinates of the camera, over the height of the body, shape
        (n, v, 3).
    points
        Places of some points less those of the average body, over the root mean square of that, shape
        (n, 3 * N_POINTS).
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
    """Makes the batch of a number, always the same one; can be sent to another process."""

    def __call__(self, number: int, bodies: int, size: int) -> Fresh:
        """Make one batch.

        Parameters
        ----------
        number
            Which one, from 0; batches share no body.
        bodies
            How many bodies.
        size
            Pixels per side.

        Raises
        ------
        DatasetError
            If a body cannot be made; the message names it.
        """
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Surfaces:
    """Some bodies that no other batch shows, as complete surfaces whose vertices correspond.

    Parameters
    ----------
    identifiers
        Names of the bodies, n of them.
    canonical
        Vertices of each body in the canonical pose, shape (n, v, 3), in metres, z up, facing -y.
    posed
        The same vertices of each body in its poses, shape (n, poses, v, 3).
    faces
        Triangles of all of them, shape (m, 3).
    drawn_again
        How often something was drawn again, by reason.
    """

    identifiers: tuple[str, ...]
    canonical: NDArray[np.float64]
    posed: NDArray[np.float64]
    faces: NDArray[np.int32]
    drawn_again: Mapping[str, int]


class MakesSurfaces(Protocol):
    """Makes the surfaces of a number, always the same ones; can be sent to another process."""

    def __call__(self, number: int, bodies: int) -> Surfaces:
        """Make one batch.

        Parameters
        ----------
        number
            Which one, from 0; batches share no body.
        bodies
            How many bodies.

        Raises
        ------
        DatasetError
            If a body cannot be made; the message names it.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class StreamedData(TrainingData):
    """Training data that never ends; the pairs are a sample of it, for learners that keep all pairs in memory.

    Parameters
    ----------
    fresh
        Makes batches to train on.
    validation
        Makes batches of other bodies, which no choice of a subject to be tested enters.
    surfaces, validation_surfaces
        The same bodies for learners of complete surfaces: those of a number are in the same poses as in its images.
    wide
        Other bodies in harder poses, with several images of each; None where there are none.
    """

    fresh: MakesFresh
    validation: MakesFresh
    surfaces: MakesSurfaces
    validation_surfaces: MakesSurfaces
    wide: StreamedData | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """One scan of a body in a pose.

    Parameters
    ----------
    mesh
        What the scanner delivers, n vertices.
    corners
        Vertices of the body around the place of each vertex, shape (n, 3).
    weights
        Barycentric coordinates of the place among them, shape (n, 3).
    """

    mesh: Mesh
    corners: NDArray[np.int64]
    weights: NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Scans:
    """Some bodies that no other batch shows, scanned.

    Parameters
    ----------
    identifiers
        Names of the bodies, n of them.
    canonical
        Vertices of each body in the canonical pose, shape (n, v, 3), in metres, z up, facing -y.
    faces
        Triangles of all bodies, shape (m, 3).
    scans
        Scans of each body, one for each of its poses.
    drawn_again
        How often something was drawn again, by reason.
    """

    identifiers: tuple[str, ...]
    canonical: NDArray[np.float64]
    faces: NDArray[np.int32]
    scans: tuple[tuple[Scan, ...], ...]
    drawn_again: Mapping[str, int]


MakesScans = Callable[[int, int], Scans]
"""Makes the scans of a number, from 0, and of so many bodies, always the same ones; batches share no body."""


@dataclass(frozen=True, kw_only=True)
class ScannedData(TrainingData):
    """Training data of scans that never ends.

    Parameters
    ----------
    scans
        Makes batches to train on.
    validation
        Makes batches of other bodies.
    """

    scans: MakesScans
    validation: MakesScans


@dataclass(frozen=True, kw_only=True)
class StreamedAndScannedData(StreamedData):
    """Streams of images and surfaces, with one of scans beside them.

    Parameters
    ----------
    scanned
        The scans.
    """

    scanned: ScannedData
