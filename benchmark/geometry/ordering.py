"""What follows from the positions of a mesh alone: an order of its vertices and triangles, and a few measurements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh, Points

#: Side of the cells along which vertices are sorted, far below the length of an edge of a prepared mesh.
CELL = 1 / 256
#: Where their grid begins, in cells: coordinates of mirrored and regular shapes lie on no border of two cells.
_OFFSET = (0.137, 0.389, 0.713)
_BITS = 21
_DECIMALS = 6


def in_spatial_order(mesh: Mesh) -> Mesh:
    """Sort the vertices of a prepared mesh along a Z-order curve in its axes, and its triangles by their vertices.

    Vertices of one cell are sorted by their coordinates, and those at one position by the triangles around them, so
    that nothing is left of the numbering of a file. Each triangle begins with its smallest vertex and keeps its
    orientation.

    References
    ----------
    Morton, "A computer oriented geodetic data base and a new technique in file sequencing", 1966.
    """
    ties = np.round(np.hstack([mesh.vertices, _means_around(mesh)]), _DECIMALS)
    order = np.lexsort((*ties.T[::-1], _places_on_curve(mesh.vertices)))
    place = np.empty(len(order), dtype=np.int32)
    place[order] = np.arange(len(order))
    faces = place[mesh.faces]
    turned = (faces.argmin(axis=1)[:, np.newaxis] + np.arange(3)) % 3
    faces = np.take_along_axis(faces, turned, axis=1)
    return Mesh(mesh.vertices[order], faces[np.lexsort(faces.T[::-1])])


def measurements(mesh: Mesh) -> str:
    """Numbers of vertices and triangles, and moments of the distances from the centre over their root mean square.

    Moments are rounded to six decimals; no rigid motion, mirroring, scaling or renumbering changes them.
    """
    distances = np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1)
    relative = distances / (np.sqrt(np.mean(distances**2)) or 1.0)
    moments = [f"{np.mean(relative**power):.6f}" for power in (1, 3, 4, 5)]
    return " ".join([str(mesh.n_vertices), str(mesh.n_faces), *moments])


def _places_on_curve(vertices: Points) -> NDArray[np.uint64]:
    """Return the place of the cell of each vertex on the curve, shape (n,): the bits of its coordinates interleaved."""
    cells = np.floor(vertices / CELL + _OFFSET)
    cells = np.clip(cells - cells.min(axis=0), 0, 2**_BITS - 1).astype(np.uint64)
    places = np.zeros(len(cells), dtype=np.uint64)
    for bit in range(_BITS):
        for axis in range(3):
            places |= (cells[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return places


def _means_around(mesh: Mesh) -> Points:
    """Mean of the corners of the triangles at each vertex, shape (n, 3)."""
    corners = mesh.faces.ravel()
    sums = np.zeros((mesh.n_vertices, 3))
    np.add.at(sums, corners, np.repeat(mesh.vertices[mesh.faces].sum(axis=1), 3, axis=0))
    return np.asarray(sums / np.maximum(3 * np.bincount(corners, minlength=mesh.n_vertices), 1)[:, np.newaxis])
