"""FastMap: an embedding from the distances to a few pivots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_vertices
from baselines._kernels.orientation import oriented, side_notes, vertex_areas
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
)


@dataclass(frozen=True, kw_only=True)
class FastMDS(CheckedParameters):
    r"""FastMap of the geodesic distances.

    Each of the three axes passes through two pivots a and b that are far apart. By the law of cosines, vertex i
    projects to

    .. math:: x_i = \frac{d_{ai}^2 + d_{ab}^2 - d_{bi}^2}{2 d_{ab}},

    and the next axis uses the residual distances :math:`d'^2_{ij} = d_{ij}^2 - (x_i - x_j)^2`, where negative squares
    count as zero. Pivots are found by a walk that moves to the farthest vertex a few times; only the rows of the
    visited vertices are computed, never all pairs. The walk starts at the vertex farthest from the geodesic centre, the
    vertex with the smallest maximum distance to four mutually far vertices; distances along edges suffice for that.
    Finally the first two axes are flipped to the side of positive area-weighted third moment, and the third chooses
    between the form and its mirror image, see :mod:`baselines._kernels.orientation`. Faloutsos and Lin (1995),
    "FastMap: a fast algorithm for indexing, data-mining and visualization of traditional and multimedia datasets".

    Parameters
    ----------
    sweeps
        Maximum number of steps from a pivot to the vertex farthest from it, per axis.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="fast-mds",
        title="Fast MDS",
        cite="faloutsos1995fastmap",
        family="paper",
        summary="FastMap: three axes through pairs of far vertices, from a few rows of geodesic distances",
        departs=(
            "Pivots are sought from the vertex farthest from the geodesic centre, not from an arbitrary object; "
            "negative squares count as zero; signs of axes and the side of the mirror follow a rule of ours."
        ),
    )

    sweeps: Annotated[int, Interval(1)] = 5

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the FastMap embedding, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces.
        """
        from baselines._kernels.sampling import farthest_from_centre, stress_of_rows

        require_vertices(shape)
        rows = _Rows(shape)
        start = farthest_from_centre(shape)
        points = np.zeros((shape.mesh.n_vertices, 3))
        for axis in range(3):
            first, second = self._pivots(rows, points, start)
            to_first = rows.residual(first, points)
            to_second = rows.residual(second, points)
            squared = to_first[second]
            if squared > 0.0:
                points[:, axis] = (to_first + squared - to_second) / (2 * np.sqrt(squared))
        points -= points.mean(axis=0)
        points = oriented(shape.mesh, points)
        known = list(rows.known)
        stress = stress_of_rows(points, known, np.stack([rows.known[vertex] for vertex in known]))
        return shape.form(
            points, rows=len(known), stress_of_rows=stress, **side_notes(points, vertex_areas(shape.mesh))
        )

    def _pivots(self, rows: _Rows, points: FloatArray, start: int) -> tuple[int, int]:
        near, far = start, start
        for _ in range(self.sweeps):
            near, far = far, rows.farthest(far, points)
            if rows.farthest(far, points) == near:
                break
        return near, far


class _Rows:
    """Geodesic distances from single vertices, each computed once."""

    def __init__(self, shape: Shape) -> None:
        self._shape = shape
        self.known: dict[int, FloatArray] = {}

    def distances(self, vertex: int) -> FloatArray:
        """Return the geodesic distances from a vertex to all vertices, shape (n,)."""
        if vertex not in self.known:
            self.known[vertex] = self._shape.geodesics_from([vertex])[0]
        return self.known[vertex]

    def farthest(self, vertex: int, points: FloatArray) -> int:
        """Return the vertex with the largest residual distance from a vertex."""
        from baselines._kernels.orientation import largest

        return largest(self.residual(vertex, points), self._shape.mesh.vertices)

    def residual(self, vertex: int, points: FloatArray) -> FloatArray:
        """Return the squared distances from a vertex that the axes so far do not explain, shape (n,)."""
        explained = ((points - points[vertex]) ** 2).sum(axis=1)
        return np.asarray(np.maximum(self.distances(vertex) ** 2 - explained, 0.0))
