"""The cotangent Laplacian of a triangle mesh, its lumped mass and its lowest eigenpairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import FloatArray, Mesh, read_only

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Beyond this, an angle is below 0.06 degrees: one sliver would outweigh ten thousand good
#: triangles and, with an obtuse neighbour, make the matrix indefinite by rounding.
_LARGEST_COTANGENT = 1e3
#: An isolated or flattened vertex would have zero mass and an infinite eigenvalue.
_SMALLEST_SHARE_OF_MEAN_MASS = 1e-6

#: Below so many vertices, a dense solver finds the eigenpairs.
_DENSE = 64

#: Distance of the shift below the least eigenvalue, which is 0.
_SHIFT_IN_INVERSE_AREAS = 1e-2


@dataclass(frozen=True, eq=False)
class Laplacian:
    """The Laplace-Beltrami operator by linear finite elements; its arrays are read-only.

    Parameters
    ----------
    stiffness
        Symmetric positive semidefinite matrix, shape (n, n), rows sum to zero: ``x @ stiffness @
        x`` is the Dirichlet energy of the piecewise linear function with values ``x``.
        Dimensionless.
    mass
        One third of the area of the triangles around each vertex (barycentric lumping), shape (n,),
        all positive, in squared units of the mesh.
    """

    stiffness: csr_array
    mass: FloatArray

    def __post_init__(self) -> None:
        matrix = self.stiffness
        arrays = [read_only(array) for array in (matrix.data, matrix.indices, matrix.indptr)]
        stiffness = type(matrix)(tuple(arrays), shape=matrix.shape, copy=False)
        object.__setattr__(self, "stiffness", stiffness)
        object.__setattr__(self, "mass", read_only(self.mass))

    def shared(self) -> Laplacian:
        """Return the same arrays in a matrix of its own, whose entries cannot be set for others."""
        return Laplacian(self.stiffness, self.mass)


def cotangent_laplacian(mesh: Mesh) -> Laplacian:
    """Assemble the cotangent Laplacian [Pinkall and Polthier 1993, equation 10; Meyer et al. 2003].

    It is the finite element matrix of linear functions, and positive semidefinite: obtuse angles
    keep their negative cotangents. Only extreme triangles are modified. If a cotangent exceeds
    1000, all three of the triangle are scaled down together, which keeps the matrix semidefinite;
    triangles without area count as 0. A vertex with almost no area gets a millionth of the mean
    mass.

    Parameters
    ----------
    mesh
        Any triangle mesh, including open and non-manifold meshes.

    Returns
    -------
    Laplacian
        Stiffness and mass.

    Raises
    ------
    UnsupportedShape
        If the mesh has no area.
    """
    from scipy.sparse import csr_array, diags_array  # lazy: the import takes a third of a second

    if not mesh.area > 0:
        problem = "the mesh has no area"
        raise UnsupportedShape(problem, "pass a surface with at least one proper triangle")
    # The cotangent at a corner is the weight of the opposite edge, from start to end.
    weights = 0.5 * _cotangents(mesh).ravel()
    start = np.roll(mesh.faces, -1, axis=1).ravel()
    end = np.roll(mesh.faces, 1, axis=1).ravel()
    both_weights = np.concatenate((weights, weights))
    rows = np.concatenate((start, end))
    columns = np.concatenate((end, start))
    adjacency = csr_array((both_weights, (rows, columns)), shape=(mesh.n_vertices, mesh.n_vertices))
    adjacency.sum_duplicates()
    stiffness = csr_array(diags_array(adjacency.sum(axis=1)) - adjacency)
    mass = mesh.vertex_areas
    return Laplacian(stiffness, np.maximum(mass, _SMALLEST_SHARE_OF_MEAN_MASS * mass.mean()))


def _cotangents(mesh: Mesh) -> FloatArray:
    """Return the cotangent of the angle at each corner of each triangle, shape (m, 3).

    Triangles without area get 0. If a cotangent exceeds :data:`_LARGEST_COTANGENT`, all three of
    its triangle are scaled down together.

    Parameters
    ----------
    mesh
        Any triangle mesh with m triangles.
    """
    corners = mesh.vertices[mesh.faces]
    towards_next = np.roll(corners, -1, axis=1) - corners
    towards_previous = np.roll(corners, 1, axis=1) - corners
    double_areas = 2.0 * mesh.face_areas
    longest_squared = (towards_next**2).sum(axis=2).max(axis=1)
    is_flat = double_areas <= np.finfo(np.float64).eps * longest_squared
    # With the angle t between two sides a and b, their dot product is |a| |b| cos t, and twice the
    # area is |a| |b| sin t: the cotangent is the first over the second.
    divisors = np.where(is_flat, np.inf, double_areas)[:, None]
    cotangents = (towards_next * towards_previous).sum(axis=2) / divisors
    largest = np.maximum(np.abs(cotangents).max(axis=1, keepdims=True), 1.0)
    cotangents *= np.minimum(1.0, _LARGEST_COTANGENT / largest)
    return np.asarray(cotangents)


def eigenpairs(laplacian: Laplacian, k: int) -> tuple[FloatArray, FloatArray]:
    """Return the smallest eigenvalues of the Laplacian, and their eigenfunctions.

    They solve ``stiffness @ f = value * mass * f``. The sign of each function is arbitrary, and so
    is the basis of a repeated eigenvalue.

    Parameters
    ----------
    laplacian
        From :func:`cotangent_laplacian`.
    k
        Number of eigenpairs, including the constant function; at most n.

    Returns
    -------
    values : numpy.ndarray
        Shape (k,), ascending, at least 0, in inverse squared units of the mesh.
    functions : numpy.ndarray
        Shape (n, k), mass-orthonormal: ``functions.T @ (mass[:, None] * functions)`` is the
        identity.

    Raises
    ------
    UnsupportedShape
        If the mesh has fewer than ``k`` vertices.
    """
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import eigsh

    count = len(laplacian.mass)
    if not 1 <= k <= count:
        problem = f"{k} eigenpairs of a mesh with {count} vertices"
        raise UnsupportedShape(problem, f"ask for 1 to {count}")
    # The symmetric matrix M^-1/2 S M^-1/2 has the same eigenvalues, and eigenvectors M^1/2 f.
    inverse_root = 1.0 / np.sqrt(laplacian.mass)
    scaling = diags_array(inverse_root)
    symmetric = (scaling @ laplacian.stiffness @ scaling).tocsc()
    if k > count // 2 or count < _DENSE:
        values, vectors = np.linalg.eigh(symmetric.toarray())
    else:
        # Shift-and-invert Lanczos (ARPACK), from a fixed vector for reproducible results. A shift
        # slightly below 0, the least eigenvalue, makes the factorised matrix definite. Eigenvalues
        # have the unit of 1 / area, and so has the shift.
        shift = -_SHIFT_IN_INVERSE_AREAS / laplacian.mass.sum()
        start = np.random.default_rng(0).standard_normal(count)
        values, vectors = eigsh(symmetric, k=k, sigma=shift, which="LM", v0=start, tol=0.0)
    order = np.argsort(values, kind="stable")[:k]
    return np.maximum(values[order], 0.0), inverse_root[:, None] * vectors[:, order]
