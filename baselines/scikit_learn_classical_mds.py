"""Classic MDS of distances on a surface by scikit-learn, for comparison with our own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from baselines._kernels.checks import require_connected, require_pairs, require_vertices
from baselines._kernels.orientation import Side, oriented, side_notes, vertex_areas
from benchmark.api.contracts import CanonicalForm, CheckedParameters, GeodesicSolver, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class ScikitLearnClassicalMDS(CheckedParameters):
    """Classic MDS (Torgerson scaling) of the geodesic distances by ``sklearn.manifold.ClassicalMDS``.

    A cross-check of :class:`baselines.classic_mds.ClassicMDS`: the distances and the choice of axes and side are the
    same, the eigensolver is that of scikit-learn. Pedregosa et al. (2011), "Scikit-learn: Machine learning in Python".

    Parameters
    ----------
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    side
        ``"moment"`` chooses between the form and its mirror image by a moment of the form, an addition to the source;
        ``"off"`` leaves the choice to the signs of the axes, as in the source.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="scikit-learn-classical-mds",
        title="Classical MDS (scikit-learn)",
        cite="pedregosa2011scikit",
        family="extended",
        summary="classic scaling of the geodesic distances by scikit-learn, a witness of classic-mds",
    )

    solver: GeodesicSolver = "default"
    side: Side = "moment"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces, or too many vertices for all pairwise
            distances.
        """
        from sklearn.manifold import ClassicalMDS

        require_vertices(shape)
        require_connected(shape)
        require_pairs(shape)
        scaling = ClassicalMDS(n_components=3, metric="precomputed")
        points = scaling.fit_transform(shape.geodesics(self.solver))
        ratios = scaling.eigenvalues_ / scaling.eigenvalues_[0]
        points = oriented(shape.mesh, points, ratios[:3], side=self.side)
        return shape.form(points, eigenvalue_ratio_3=float(ratios[2]), **side_notes(points, vertex_areas(shape.mesh)))
