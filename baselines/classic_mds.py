"""Classic scaling of the geodesic distances: the bending-invariant form of Elad and Kimmel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baselines._kernels.checks import require_vertices
from baselines._kernels.orientation import canonical_signs, settled_axes, vertex_areas
from benchmark.contracts import CanonicalForm, CheckedParameters, FloatArray, GeodesicSolver, Mesh, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class ClassicMDS(CheckedParameters):
    r"""Classic (Torgerson) scaling of the geodesic distances.

    With the matrix D of geodesic distances and :math:`J = I - 11^\top / n`,

    .. math:: B = -\tfrac12 J (D \circ D) J = Q \Lambda Q^\top, \qquad X = Q_3 \Lambda_3^{1/2},

    where the three largest eigenvalues are kept and negative ones count as zero. Each axis points to the side of
    positive area-weighted third moment. Elad and Kimmel (2003), "On bending invariant signatures for surfaces";
    Torgerson (1952), "Multidimensional scaling: I. Theory and method".

    Parameters
    ----------
    solver
        Geodesic solver, see :meth:`benchmark.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="classic-mds",
        title="Classic MDS",
        cite="elad2003bending",
        family="paper",
        summary="top three eigenvectors of the doubly centred squared geodesic distances",
    )

    solver: GeodesicSolver = "default"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic scaling of the geodesic distances.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces.
        """
        from baselines._kernels.smacof import normalised_stress

        require_vertices(shape)
        distances = shape.geodesics(self.solver)
        points, ratios = oriented_classic_scaling(shape.mesh, distances)
        return shape.form(
            points,
            stress=normalised_stress(points, distances),
            eigenvalue_ratio_2=ratios[1],
            eigenvalue_ratio_3=ratios[2],
            eigenvalue_ratio_4=ratios[3],
        )


def oriented_classic_scaling(mesh: Mesh, distances: FloatArray) -> tuple[FloatArray, list[float]]:
    """Classic scaling of the vertices of a mesh, each axis towards positive area-weighted third moment.

    Parameters
    ----------
    mesh
        Gives the vertex areas.
    distances
        Geodesic distances, symmetric, shape (n, n) with n at least 4.

    Returns
    -------
    points : numpy.ndarray
        Positions, shape (n, 3).
    ratios : list of float
        As from :func:`classic_scaling`.
    """
    points, ratios = classic_scaling(distances)
    points = settled_axes(points, np.array(ratios[:3]), mesh.vertices)
    return points * canonical_signs(points, vertex_areas(mesh), mesh.vertices), ratios


def classic_scaling(distances: FloatArray) -> tuple[FloatArray, list[float]]:
    """Embed points in space so that their distances resemble the given ones.

    Parameters
    ----------
    distances
        Distances of all pairs, symmetric, shape (n, n) with n at least 4.

    Returns
    -------
    points : numpy.ndarray
        Centred positions, shape (n, 3), along axes of falling variance and arbitrary sign; exact if the distances are
        those of points in space.
    ratios : list of float
        The four largest eigenvalues over the first. A third and fourth of nearly the same size may change places
        under a small deformation.
    """
    from baselines._kernels.eigen import centred_eigenpairs

    values, vectors = centred_eigenpairs(distances, 4, accurate=3)
    return vectors[:, :3] * np.sqrt(np.maximum(values[:3], 0.0)), [float(value / values[0]) for value in values]
