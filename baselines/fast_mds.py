"""FastMap: an embedding from the distances to a few pivots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
)
from benchmark.geometry.embedding import oriented


@dataclass(frozen=True, kw_only=True)
class FastMDS(CheckedParameters):
    r"""FastMap of the geodesic distances.

    Each of the three axes passes through two pivots a and b that are far apart. By the law of
    cosines, vertex i projects to

    .. math:: x_i = \frac{d_{ai}^2 + d_{ab}^2 - d_{bi}^2}{2 d_{ab}},

    and the next axis uses the residual distances :math:`d'^2_{ij} = d_{ij}^2 - (x_i - x_j)^2`,
    where negative squares count as zero. Pivots are found by a walk that moves to the farthest
    vertex a few times; only the rows of the visited vertices are computed, never all pairs. Signs
    of axes and the side of the mirror follow :func:`benchmark.api.oriented`. Faloutsos and Lin
    (1995), "FastMap: a fast algorithm for indexing, data-mining and visualization of traditional
    and multimedia datasets".

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
        summary=(
            "Takes pairs of far points as axes, and reads the place of each point from its "
            "distances to them."
        ),
        departs=(
            "The search for pivots starts at the vertex farthest from the geodesic centre, not at "
            "an arbitrary one. Negative squared distances count as zero. Signs of the axes, and "
            "with them the mirror image, follow our rule."
        ),
        needs=("connected",),
    )

    sweeps: Annotated[int, Interval(1)] = 5

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the FastMap embedding, centred at the origin.

        For each of three axes, two vertices that are far apart become the pivots. Coordinates along
        the line between the pivots follow from the distances to them. The next axis uses what the
        axes so far leave of the squared distances.

        Returns
        -------
        CanonicalForm
            Its notes are the number of vertices from which distances were computed, and the stress
            of these distances.
        """
        from baselines._kernels.few_rows import farthest_points, stress_of_rows

        rows = dict[int, FloatArray]()  # geodesic distances from some vertices to all
        points = np.zeros((shape.mesh.n_vertices, 3))

        def residual(vertex: int) -> FloatArray:
            """Return what the axes leave of the squared distances from a vertex, shape (n,)."""
            if vertex not in rows:
                rows[vertex] = shape.geodesics_from([vertex])[0]
            explained = ((points - points[vertex]) ** 2).sum(axis=1)
            return np.asarray(np.maximum(rows[vertex] ** 2 - explained, 0.0))

        (start,) = farthest_points(shape, 1)
        for axis in range(3):
            first, second = self._pivots(residual, start)
            to_first = residual(first)
            to_second = residual(second)
            between = to_first[second]
            if between > 0.0:
                # By the law of cosines, the position along the line from the first to the second.
                points[:, axis] = (to_first + between - to_second) / (2 * np.sqrt(between))
        points = oriented(points - points.mean(axis=0), shape.mesh.vertex_areas)
        stress = stress_of_rows(points, list(rows), np.stack([*rows.values()]))
        return shape.form(points, rows=len(rows), stress_of_rows=stress)

    def _pivots(self, residual: Callable[[int], FloatArray], start: int) -> tuple[int, int]:
        """Return two vertices far apart, by a walk to the farthest vertex.

        Parameters
        ----------
        residual
            Returns the squared distances from a vertex that the axes so far leave.
        start
            Where the walk begins.
        """
        near = start
        far = start
        for _ in range(self.sweeps):
            near = far
            far = int(residual(far).argmax())
            if int(residual(far).argmax()) == near:
                break
        return near, far
