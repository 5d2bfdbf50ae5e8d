"""Isomap of a surface by scikit-learn: classic MDS of shortest paths through near neighbours."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_connected, require_pairs, require_vertices
from baselines._kernels.orientation import Side, oriented, side_notes, vertex_areas
from benchmark.api.contracts import CanonicalForm, CheckedParameters, GeodesicSolver, Interval, MethodInfo, Shape

MARGIN = 1e-6
"""Relative margin by which the radius exceeds the distance that defines it."""


@dataclass(frozen=True, kw_only=True)
class ScikitLearnIsomap(CheckedParameters):
    """Isomap of the geodesic distances by ``sklearn.manifold.Isomap``.

    Vertices are joined up to the geodesic distance at which each has ``neighbours`` neighbours, and the form is the
    classic MDS of the shortest paths in this graph. If the graph has several components, the nearest vertices of two of
    them are joined as well. With all vertices as neighbours, the form is the classic MDS of the geodesic distances.
    Tenenbaum, de Silva and Langford (2000), "A global geometric framework for nonlinear dimensionality reduction";
    Pedregosa et al. (2011), "Scikit-learn: Machine learning in Python".

    Parameters
    ----------
    neighbours
        Minimum number of neighbours of each vertex, or all vertices if there are fewer. The default is twice the mean
        number of neighbours in a mesh.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    side
        ``"moment"`` chooses between the form and its mirror image by a moment of the form, an addition to the source;
        ``"off"`` leaves the choice to the signs of the axes, as in the source.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="scikit-learn-isomap",
        title="Isomap (scikit-learn)",
        cite="tenenbaum2000isomap",
        family="extended",
        summary="classic scaling of shortest paths between near neighbours by scikit-learn",
        departs=(
            "Vertices are joined up to one geodesic radius instead of by Euclidean distance to a number of neighbours; "
            "signs of axes and the side of the mirror follow a rule of ours."
        ),
    )

    neighbours: Annotated[int, Interval(3)] = 12
    solver: GeodesicSolver = "default"
    side: Side = "moment"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the shortest paths, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces, or too many vertices for all pairwise
            distances.
        """
        from sklearn.manifold import Isomap

        require_vertices(shape)
        require_connected(shape)
        require_pairs(shape)
        distances = shape.geodesics(self.solver)
        # One radius with a margin: rounding errors would otherwise choose among equally far neighbours.
        count = min(self.neighbours, len(distances) - 1)
        radius = (1 + MARGIN) * float(np.partition(distances, count, axis=1)[:, count].max())
        isomap = Isomap(
            n_neighbors=None, radius=radius, n_components=3, metric="precomputed", eigen_solver="dense", path_method="D"
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # scikit-learn joins separate components with a long warning
            points = isomap.fit_transform(distances)
        values = isomap.kernel_pca_.eigenvalues_
        points = oriented(shape.mesh, points, values[:3] / values[0], side=self.side)
        return shape.form(points, **side_notes(points, vertex_areas(shape.mesh)))
