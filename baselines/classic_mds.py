"""Classic MDS of distances on a surface: the bending-invariant form of Elad and Kimmel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_pairs, require_vertices
from baselines._kernels.orientation import Side, oriented, side_notes, vertex_areas
from baselines._kernels.spectral import Metric, spectral_embedding
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    GeodesicSolver,
    Interval,
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

    Another ``metric`` replaces the geodesic distances in D by diffusion, commute-time or biharmonic distances, see
    :func:`baselines._kernels.spectral.spectral_embedding`. These are Euclidean distances between points in a
    high-dimensional space, whose principal components are the classic MDS, so that D itself is never computed.

    Parameters
    ----------
    metric
        ``"geodesic"``, ``"diffusion"``, ``"commute-time"`` or ``"biharmonic"``.
    time
        Diffusion time, in units of the surface area.
    eigenfunctions
        Maximum number of eigenfunctions in the sums of the other three metrics.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    side
        ``"moment"`` chooses between the form and its mirror image by a moment of the form, an addition to the source;
        ``"off"`` leaves the choice to the signs of the axes, as in the source.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="classic-mds",
        title="Classic MDS",
        cite="elad2003bending",
        family="paper",
        summary="top three eigenvectors of the doubly centred squared geodesic distances",
        departs=(
            "Geodesic distances, the default, are shortest paths in a graph of edges and unfolded triangles, where the "
            "source marches over the surface; other metrics are sums over eigenfunctions. Signs of axes and the side "
            "of the mirror follow a rule of ours."
        ),
    )

    metric: Metric = "geodesic"
    time: Annotated[float, Interval(0, closed="neither")] = 0.05
    eigenfunctions: Annotated[int, Interval(10)] = 100
    solver: GeodesicSolver = "default"
    side: Side = "moment"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the distances.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices (five for the other metrics), no face, or several pieces, or too
            many vertices for all pairwise distances.
        """
        from baselines._kernels.smacof import normalised_stress

        if self.metric == "geodesic":
            require_vertices(shape)
            require_pairs(shape)
            distances = shape.geodesics(self.solver)
            points, ratios = oriented_classic_scaling(shape.mesh, distances, self.side)
            notes = {"stress": normalised_stress(points, distances)}
        else:
            require_vertices(shape, 5)
            embedding = spectral_embedding(shape, self.metric, self.time, self.eigenfunctions)
            points, ratios = principal_scaling(embedding)
            points = oriented(shape.mesh, points, np.array(ratios[:3]), side=self.side)
            notes = {"eigenfunctions": embedding.shape[1]}
        return shape.form(
            points,
            **notes,
            eigenvalue_ratio_2=ratios[1],
            eigenvalue_ratio_3=ratios[2],
            eigenvalue_ratio_4=ratios[3],
            **side_notes(points, vertex_areas(shape.mesh)),
        )


def oriented_classic_scaling(
    mesh: Mesh, distances: FloatArray, side: Side = "moment"
) -> tuple[FloatArray, list[float]]:
    """Compute the classic MDS of the vertices of a mesh, oriented by :func:`baselines._kernels.orientation.oriented`.

    Parameters
    ----------
    mesh
        The surface; gives vertex areas and breaks ties.
    distances
        Geodesic distances, symmetric, shape (n, n) with n at least 4.
    side
        As in :func:`baselines._kernels.orientation.oriented`.

    Returns
    -------
    points : numpy.ndarray
        Positions, shape (n, 3).
    ratios : list of float
        As in :func:`classic_scaling`.
    """
    points, ratios = classic_scaling(distances)
    return oriented(mesh, points, np.array(ratios[:3]), side=side), ratios


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


def principal_scaling(embedding: FloatArray) -> tuple[FloatArray, list[float]]:
    """Project high-dimensional points onto their principal axes, which is the classic MDS of their distances.

    Parameters
    ----------
    embedding
        Positions, shape (n, k) with k at least 4.

    Returns
    -------
    points : numpy.ndarray
    ratios : list of float
        As in :func:`classic_scaling`.
    """
    centred = embedding - embedding.mean(axis=0)
    values, axes = np.linalg.eigh(centred.T @ centred)
    return centred @ axes[:, :-4:-1], [float(value / values[-1]) for value in values[:-5:-1]]
