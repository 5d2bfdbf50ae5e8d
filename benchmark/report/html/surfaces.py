"""Surfaces made small enough to travel: some thousand vertices, the same ones of a shape and of all its forms."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.geometry.mesh import Mesh, Points
from benchmark.report.pictures.painting import outwardness

#: Vertices of a surface in the report.
VERTICES = 1000

#: Coordinates lie between plus and minus this, where a picture shows those between plus and minus one.
REACH = 1.6


@dataclass(frozen=True, eq=False)
class Thinned:
    """A choice among the vertices of a mesh, with triangles between them.

    Parameters
    ----------
    chosen
        Which vertices, shape (n,).
    faces
        Triangles of the chosen ones, shape (m, 3).
    all_values
        How far out each vertex of the mesh lies; see :func:`~benchmark.report.pictures.painting.outwardness`.
    """

    chosen: NDArray[np.intp]
    faces: NDArray[np.int32]
    all_values: NDArray[np.float64]

    @property
    def values(self) -> NDArray[np.float64]:
        """Return how far out each chosen vertex lies."""
        return self.all_values[self.chosen]

    def topology(self) -> dict[str, Any]:
        """Triangles and values, as the page reads them."""
        return {
            "faces": packed(self.faces.astype(np.uint16)),
            "values": packed(np.rint(255 * self.values).astype("u1")),
        }

    def positions(self, points: Points) -> str:
        """Positions of the chosen vertices of points that fill a picture between -1 and 1, as the page reads them."""
        return packed(quantised(points[self.chosen], REACH))


def thinned(mesh: Mesh, n_vertices: int = VERTICES) -> Thinned:
    """Choose vertices by quadric edge collapse onto vertices that are there [Garland and Heckbert 1997]."""
    values = outwardness(mesh)
    if mesh.n_vertices <= n_vertices:
        return Thinned(np.arange(mesh.n_vertices), mesh.faces, values)
    import pymeshlab

    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    # pymeshlab remembers parameters from call to call, so every one is named.
    work.meshing_decimation_quadric_edge_collapse(
        targetfacenum=max(4, round(mesh.n_faces * n_vertices / mesh.n_vertices)),
        targetperc=0.0,
        qualitythr=0.3,
        preserveboundary=True,
        boundaryweight=1.0,
        preservenormal=True,
        preservetopology=True,
        optimalplacement=False,
        planarquadric=True,
        planarweight=0.001,
        qualityweight=False,
        autoclean=True,
        selected=False,
    )
    small = work.current_mesh()
    chosen = np.asarray(cKDTree(mesh.vertices).query(small.vertex_matrix())[1], dtype=np.intp)
    faces = np.asarray(small.face_matrix(), dtype=np.int32)
    return Thinned(chosen, faces, values)


def packed(array: NDArray[Any]) -> str:
    """An array of unsigned whole numbers as base64, little-endian, in the order of its memory."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()).decode("ascii")


def quantised(points: NDArray[np.float64], reach: float) -> NDArray[np.uint16]:
    """Coordinates between ``-reach`` and ``reach``, shape (n, 3), in 65536 steps; what lies beyond is moved in."""
    steps = np.rint((np.clip(points / reach, -1, 1) + 1) / 2 * 65535)
    return np.asarray(steps, dtype=np.uint16)
