"""Classic MDS of distances on a surface: the bending-invariant form of Elad and Kimmel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baselines._kernels.checks import require_pairs, require_vertices
from baselines._kernels.orientation import oriented, side_notes, vertex_areas
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Mesh,
    MethodInfo,
    Shape,
)


@dataclass(frozen=True, kw_only=True)
class ClassicMDS(CheckedParameters):
    r"""Classic MDS (Torgerson scaling) of the geodesic distances.

    With the matrix D of geodesic distances and :math:`J = I - 11^\top / n`,

    .. math:: B = -\tfrac12 J (D \circ D) J = Q \Lambda Q^\top, \qquad X = Q_3 \Lambda_3^{1/2},

    with the three largest eigenvalues, of which negative ones count as zero. The first two axes point to the side of
    positive area-weighted third moment; the third chooses between the form and its mirror image, see
    :mod:`baselines._kernels.orientation`, and the note ``side_in_doubt`` is 1 if that choice is uncertain. Elad and
    Kimmel (2003), "On bending invariant signatures for surfaces"; Torgerson (1952), "Multidimensional scaling: I.
    Theory and method".
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="classic-mds",
        title="Classic MDS",
        cite="elad2003bending",
        family="paper",
        summary="top three eigenvectors of the doubly centred squared geodesic distances",
        departs=(
            "Geodesic distances are shortest paths in a graph of edges and unfolded triangles, where the source "
            "marches over the surface. Signs of axes and the side of the mirror follow a rule of ours."
        ),
    )

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the distances.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices, no face, or several pieces, or too many vertices for all pairwise
            distances.
        """
        from baselines._kernels.smacof import normalised_stress

        require_vertices(shape)
        require_pairs(shape)
        distances = shape.geodesics()
        points, ratios = oriented_classic_scaling(shape.mesh, distances)
        return shape.form(
            points,
            stress=normalised_stress(points, distances),
            eigenvalue_ratio_2=ratios[1],
            eigenvalue_ratio_3=ratios[2],
            eigenvalue_ratio_4=ratios[3],
            **side_notes(points, vertex_areas(shape.mesh)),
        )


def oriented_classic_scaling(mesh: Mesh, distances: FloatArray) -> tuple[FloatArray, list[float]]:
    """Compute the classic MDS of the vertices of a mesh, oriented by :func:`baselines._kernels.orientation.oriented`.

    Parameters
    ----------
    mesh
        The surface; gives vertex areas and breaks ties.
    distances
        Geodesic distances, symmetric, shape (n, n) with n at least 4.

    Returns
    -------
    points : numpy.ndarray
        Positions, shape (n, 3).
    ratios : list of float
        As in :func:`classic_scaling`.
    """
    points, ratios = classic_scaling(distances)
    return oriented(mesh, points, np.array(ratios[:3])), ratios


def classic_scaling(distances: FloatArray) -> tuple[FloatArray, list[float]]:
    """Embed points in 3D so that their distances approximate the given ones.

    Parameters
    ----------
    distances
        Pairwise distances, symmetric, shape (n, n) with n at least 4.

    Returns
    -------
    points : numpy.ndarray
        Centred positions, shape (n, 3), along axes of decreasing variance and arbitrary sign; exact if the distances
        are those of points in 3D.
    ratios : list of float
        The four largest eigenvalues over the first. If the third and fourth are nearly equal, they may swap under a
        small deformation.
    """
    from baselines._kernels.eigen import centred_eigenpairs

    values, vectors = centred_eigenpairs(distances, 4, accurate=3)
    return vectors[:, :3] * np.sqrt(np.maximum(values[:3], 0.0)), [float(value / values[0]) for value in values]
