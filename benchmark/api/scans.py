"""Endless stream of scanned bodies for a learner: surfaces of any triangles that tell where they lie on the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmark.api.learning import TrainingData
from benchmark.api.streaming import StreamedData
from benchmark.geometry.mesh import Mesh

__all__ = ["MakesScans", "Scan", "ScannedData", "Scans", "StreamedAndScannedData"]


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


class MakesScans(Protocol):
    """Makes the scans of a number, always the same ones; can be sent to another process."""

    def __call__(self, number: int, bodies: int) -> Scans:
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
