"""Least-squares scaling of distances on the surface by stress majorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from baselines._kernels.checks import require_vertices
from baselines._kernels.orientation import vertex_areas
from baselines._kernels.spectral import Metric, distances_under
from benchmark.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    GeodesicSolver,
    Interval,
    MethodInfo,
    Shape,
)


@dataclass(frozen=True, kw_only=True)
class LeastSquaresMDS(CheckedParameters):
    r"""Least-squares scaling of the geodesic distances (SMACOF).

    Lowers the stress :math:`\sum_{i<j} w_{ij} (\|x_i - x_j\| - \delta_{ij})^2` between the form and the geodesic
    distances :math:`\delta` by Guttman transforms :math:`X \leftarrow V^+ B(X) X`, none of which raises it. Elad and
    Kimmel (2003), "On bending invariant signatures for surfaces"; de Leeuw (1977), "Applications of convex analysis
    to multidimensional scaling"; Borg and Groenen (2005), chapter 8.

    Parameters
    ----------
    start
        ``"mesh"`` starts from the surface itself, so that limbs unfold from where they are and the form keeps some of
        the pose and the position in space of the input; ``"classic"`` starts from classic scaling, which knows
        nothing of the pose.
    weights
        ``"uniform"`` counts every pair of vertices once; ``"area"`` weighs a pair by the product of the two vertex
        areas, so that the stress is an integral over the surface and does not depend on the sampling.
    max_iterations
        Largest number of Guttman transforms.
    rtol
        Stop when a transform lowers the stress by less than this fraction.
    metric, time, eigenfunctions
        Which distances :math:`\delta` are, see :class:`baselines.classic_mds.ClassicMDS`.
    solver
        Geodesic solver, see :meth:`benchmark.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="least-squares-mds",
        title="Least Square MDS",
        cite="elad2003bending",
        family="paper",
        summary="stress majorisation of the geodesic distances, from the mesh or from classic MDS",
    )

    start: Literal["mesh", "classic"] = "mesh"
    weights: Literal["uniform", "area"] = "uniform"
    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3
    metric: Metric = "geodesic"
    time: Annotated[float, Interval(0, closed="neither")] = 0.05
    eigenfunctions: Annotated[int, Interval(10)] = 100
    solver: GeodesicSolver = "default"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the least-squares scaling of the distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces.
        """
        from baselines._kernels.smacof import smacof

        require_vertices(shape)
        distances = distances_under(shape, self.metric, self.time, self.eigenfunctions, self.solver)
        scaling = smacof(
            distances,
            start_positions(shape, distances, self.start),
            weights=_pair_weights(shape, self.weights),
            max_iterations=self.max_iterations,
            rtol=self.rtol,
        )
        return shape.form(
            scaling.points,
            stress=scaling.stress[-1],
            stress_of_start=scaling.stress[0],
            iterations=scaling.iterations,
        )


def start_positions(shape: Shape, distances: FloatArray, start: Literal["mesh", "classic"]) -> FloatArray:
    """Positions from which an iterative scaling sets out, shape (n, 3)."""
    from baselines.classic_mds import oriented_classic_scaling

    return shape.mesh.vertices if start == "mesh" else oriented_classic_scaling(shape.mesh, distances)[0]


def _pair_weights(shape: Shape, kind: Literal["uniform", "area"]) -> FloatArray | None:
    if kind == "uniform":
        return None
    areas = vertex_areas(shape.mesh)
    return np.outer(areas, areas)
