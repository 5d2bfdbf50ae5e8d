"""Axes of embeddings: ties, signs, the choice of mirror image, and classic MDS of low-rank products."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import FloatArray, Mesh

TIE = 1e-6
"""Values within this fraction of the extreme one tie with it. Distances are stored in single precision, whose last bit
is a seventeenth of this; symmetric surfaces have many such ties."""

STEP = 2.0**-24
"""Coordinates are compared in multiples of this share of the largest one, far coarser than rounding errors."""


def largest(values: FloatArray, vertices: FloatArray) -> int:
    """Return the vertex with the largest value; of several, the first by its coordinates.

    Parameters
    ----------
    values
        One number per vertex, shape (n,).
    vertices
        Positions, shape (n, 3).
    """
    highest = values.max()
    # Unreachable vertices are infinitely far and tie with each other.
    bound = highest - TIE * np.abs(highest) if np.isfinite(highest) else highest
    tied = np.flatnonzero(values >= bound)
    if len(tied) == 1:
        return int(tied[0])
    return int(tied[order_by_coordinates(vertices[tied], float(np.abs(vertices).max()))[0]])


def order_by_coordinates(vertices: FloatArray, extent: float) -> NDArray[np.int64]:
    """Return the order of points by their x, y and z coordinates in multiples of ``STEP * extent``, shape (n,)."""
    cells = np.round(vertices / (STEP * max(extent, np.finfo(float).tiny)))
    return np.asarray(np.lexsort(cells.T[::-1]), dtype=np.int64)


EQUAL = 1e-6
"""Eigenvalues that differ by less than this share of the larger count as equal: their axes are free to rotate."""


NEGLIGIBLE = 1e-6
"""A third moment below this share of its largest possible value means an axis of symmetry, and a smaller handedness a
form that is its own mirror image. Geodesic distances in single precision give some 1e-8 instead of 0."""


def vertex_areas(mesh: Mesh) -> FloatArray:
    """Return the barycentric area of each vertex, a third of its triangles, shape (n,), in squared mesh units."""
    shares = np.repeat(mesh.face_areas / 3, 3)
    return np.asarray(np.bincount(mesh.faces.ravel(), shares, mesh.n_vertices), dtype=np.float64)


def settled_axes(coordinates: FloatArray, eigenvalues: FloatArray, positions: FloatArray) -> FloatArray:
    """Rotate the axes of equal eigenvalues, which a solver leaves arbitrary, towards the farthest vertices.

    The first of these axes points to the vertex farthest out in their space, the next to the one farthest out in the
    remaining space. Only surfaces with symmetries have such axes.

    Parameters
    ----------
    coordinates
        One column per axis, shape (n, k).
    eigenvalues
        One per axis, in order, shape (k,).
    positions
        Vertices of the surface, shape (n, 3); break ties between equally far vertices.

    Returns
    -------
    numpy.ndarray
        Coordinates along the rotated axes, shape (n, k).
    """
    distinct = np.abs(np.diff(eigenvalues)) > EQUAL * np.maximum(np.abs(eigenvalues[1:]), np.abs(eigenvalues[:-1]))
    settled = coordinates.copy()
    for columns in np.split(np.arange(len(eigenvalues)), np.flatnonzero(distinct) + 1):
        if len(columns) == 1:
            continue
        rest, axes = coordinates[:, columns], []
        for _ in columns:
            farthest = rest[largest((rest**2).sum(axis=1), positions)]
            axes.append(farthest / max(np.linalg.norm(farthest), np.finfo(float).tiny))
            rest = rest - np.outer(rest @ axes[-1], axes[-1])
        settled[:, columns] = coordinates[:, columns] @ np.array(axes).T
    return settled


def canonical_signs(coordinates: FloatArray, weights: FloatArray, positions: FloatArray) -> FloatArray:
    """Choose the sign of each axis so that its weighted third central moment is positive.

    The moment is a sum over the surface, so the choice follows any relabelling of the vertices and hardly depends on
    the sampling. On an axis of symmetry the third moment is zero, and the vertex farthest from the centre decides; of
    several equally far ones, the first by its position on the surface. On a nearly symmetric axis, jitter may decide.
    Therefore :func:`handedness` chooses between a form and its mirror image; two signs that change together are half a
    turn, which the scorer tries.

    Parameters
    ----------
    coordinates
        One column per axis, shape (n, k).
    weights
        Weight of each vertex, usually its area, shape (n,).
    positions
        Vertices of the surface, shape (n, 3).

    Returns
    -------
    numpy.ndarray
        1.0 or -1.0 per axis, shape (k,).
    """
    centred = coordinates - np.average(coordinates, axis=0, weights=weights)
    moments = weights @ centred**3
    extremes = np.array([column[largest(np.abs(column), positions)] for column in centred.T])
    negligible = np.abs(moments) <= NEGLIGIBLE * (weights @ np.abs(centred) ** 3)
    return np.where(np.where(negligible, extremes, moments) < 0, -1.0, 1.0)


DOUBTFUL = 0.02
"""Below this handedness, a note reports doubt, without any other effect: jitter of 1e-6 or another triangulation may
flip the side."""


def handedness(points: FloatArray, weights: FloatArray) -> float:
    r"""Return how clearly a form differs from its mirror image, with a sign that distinguishes the two.

    In coordinates (x, y, z) along the principal axes, the longest first and z making the frame right-handed, it is

    .. math:: \sum_i w_i x_i y_i z_i \Big/ \sum_i w_i |x_i y_i z_i| .

    Reversing two axes does not change the product, so the value depends on neither position, rotation nor size, and
    changes its sign under reflection. It is 0 for a form that is symmetric about a principal plane. It is in doubt if
    it is near 0, or if two principal variances nearly tie.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    weights
        Weight of each vertex, usually its area, shape (n,).

    Returns
    -------
    float
        From -1 to 1.
    """
    shares = weights / weights.sum()
    centred = points - shares @ points
    _, axes = np.linalg.eigh((centred * shares[:, None]).T @ centred)
    along = centred @ axes[:, ::-1]
    products = along.prod(axis=1) * np.sign(np.linalg.det(axes[:, ::-1]))
    size = float(shares @ np.abs(products))
    return float(shares @ products) / size if size > 0 else 0.0


def right_handed(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the form or its mirror image, whichever has positive :func:`handedness`.

    Parameters
    ----------
    points, weights
        As in :func:`handedness`. A reflection flips the last axis.

    Returns
    -------
    numpy.ndarray
        Shape (n, 3).
    """
    return points * [1.0, 1.0, -1.0] if handedness(points, weights) < -NEGLIGIBLE else points


def oriented(
    mesh: Mesh,
    points: FloatArray,
    eigenvalues: FloatArray | None = None,
    *,
    areas: FloatArray | None = None,
) -> FloatArray:
    """Resolve the ambiguities of an embedding: axes of equal eigenvalues, signs, and the choice of mirror image.

    Parameters
    ----------
    mesh
        The surface.
    points
        Positions along the axes, shape (n, 3).
    eigenvalues
        Eigenvalues of the axes, shape (3,), if equal ones leave axes arbitrary.
    areas
        Vertex areas, shape (n,); those of the mesh by default.
    """
    if eigenvalues is not None:
        points = settled_axes(points, eigenvalues, mesh.vertices)
    areas = vertex_areas(mesh) if areas is None else areas
    points = points * canonical_signs(points, areas, mesh.vertices)
    return right_handed(points, areas)


def side_notes(points: FloatArray, weights: FloatArray) -> dict[str, float]:
    """Return the notes on the side of a form: ``handedness``, and ``side_in_doubt``, 1 if that is near 0, else 0."""
    value = handedness(points, weights)
    return {"handedness": value, "side_in_doubt": float(abs(value) < DOUBTFUL)}


def low_rank_scaling(mesh: Mesh, columns: FloatArray, coupling: FloatArray) -> FloatArray:
    r"""Compute the classic MDS of the squared distances :math:`Z M Z^\top` without forming that matrix.

    The thin factorisation :math:`J Z = Q R` leaves the eigenproblem of :math:`-\frac12 R M R^\top`, whose size is the
    number of columns of Z.

    Parameters
    ----------
    mesh
        The surface, which resolves axes of equal eigenvalues, signs, and the choice of mirror image.
    columns
        The matrix Z, shape (n, k) with k at least 3.
    coupling
        The symmetric matrix M, shape (k, k).

    Returns
    -------
    numpy.ndarray
        Centred positions, shape (n, 3), along axes of decreasing variance; negative eigenvalues count as zero.
    """
    orthonormal, triangular = np.linalg.qr(columns - columns.mean(axis=0))
    values, vectors = np.linalg.eigh(-0.5 * triangular @ coupling @ triangular.T)
    leading = np.maximum(values[:-4:-1], 0.0)
    return oriented(mesh, orthonormal @ (vectors[:, :-4:-1] * np.sqrt(leading)), leading)
