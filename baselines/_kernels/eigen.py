"""The leading eigenpairs of a doubly centred matrix of squared distances, without forming it."""

from __future__ import annotations

import numba
import numpy as np

from benchmark.contracts import FloatArray

_BLOCK = 4
_TILE = 1024


def farthest_points(distances: FloatArray, count: int) -> list[int]:
    """Sample vertices so that each is as far as possible from those before it.

    The first is the vertex with the largest sum of distances. The choice follows any relabelling of the vertices as
    long as no two candidates tie.

    Parameters
    ----------
    distances
        Distances of all pairs, shape (n, n).
    count
        Number of samples.

    Returns
    -------
    list of int
        Vertex indices, at most n of them.
    """
    chosen = [int((distances @ np.ones(len(distances))).argmax())]
    nearest = distances[chosen[0]].copy()
    while len(chosen) < min(count, len(distances)):
        chosen.append(int(nearest.argmax()))
        np.minimum(nearest, distances[chosen[-1]], out=nearest)
    return chosen


def centred_eigenpairs(
    distances: FloatArray, k: int, *, accurate: int, tolerance: float = 1e-9, max_steps: int = 60
) -> tuple[FloatArray, FloatArray]:
    r"""Largest eigenvalues, with eigenvectors, of the doubly centred squared distances.

    The matrix is :math:`B = -\frac12 J (D \circ D) J` with :math:`J = I - 11^\top/n`. It acts on a block of vectors by
    one product with the squared distances between two subtractions of column means, so neither it nor the squares
    are ever stored. A block Krylov space grows from the columns of a few farthest points until the Rayleigh-Ritz
    residuals are small (Golub & Van Loan 2013, section 10.3). The start is fixed, so the result is reproducible.

    Parameters
    ----------
    distances
        Distances of all pairs, symmetric, shape (n, n).
    k
        Number of eigenpairs, at most four.
    accurate
        How many of them must meet the tolerance. A Ritz value is accurate long before its vector, so one pair more
        than needed costs nothing and tells the gap.
    tolerance
        Largest residual :math:`\|B q - \lambda q\|` of a unit vector q, relative to the largest eigenvalue.
    max_steps
        Largest number of block products.

    Returns
    -------
    values : numpy.ndarray
        Largest first, shape (k,); those of a metric that is not Euclidean may be negative.
    vectors : numpy.ndarray
        Orthonormal columns, shape (n, k), of arbitrary sign.
    """
    if len(distances) <= 16 * _BLOCK:
        return _dense_eigenpairs(distances, k)
    basis = _orthonormal(distances[farthest_points(distances, _BLOCK)].T ** 2)
    image = _apply(distances, basis)
    for _ in range(max_steps):
        projected = basis.T @ image
        values, coefficients = np.linalg.eigh((projected + projected.T) / 2)
        values, coefficients = values[: -k - 1 : -1], coefficients[:, : -k - 1 : -1]
        vectors = basis @ coefficients
        residuals = np.linalg.norm(image @ coefficients - vectors * values, axis=0)
        if residuals[:accurate].max() <= tolerance * values[0]:
            break
        fresh = image[:, -_BLOCK:]
        # Twice, because one pass of Gram-Schmidt leaves rounding errors that grow with every block.
        for _ in range(2):
            fresh = _orthonormal(fresh - basis @ (basis.T @ fresh))
        basis = np.hstack([basis, fresh])
        image = np.hstack([image, _apply(distances, fresh)])
    return values, vectors


def _orthonormal(block: FloatArray) -> FloatArray:
    return np.linalg.qr(block - block.mean(axis=0))[0]


def _apply(distances: FloatArray, block: FloatArray) -> FloatArray:
    product = np.zeros((_BLOCK, len(block)))
    _add_squared_product(distances, np.ascontiguousarray((block - block.mean(axis=0)).T), product)
    product -= product.mean(axis=1, keepdims=True)
    return -0.5 * product.T


# A matrix product with four columns is too thin for BLAS: this loop is twice as fast and needs no matrix of squares.
@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _add_squared_product(distances, rows, product):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    n = len(distances)
    for first in range(0, n, _TILE):  # four tiles of that many numbers fit into the innermost cache
        last = min(n, first + _TILE)
        a, b, c, d = rows[0, first:last], rows[1, first:last], rows[2, first:last], rows[3, first:last]
        for i in range(n):
            tile = distances[i, first:last]
            sum_a = sum_b = sum_c = sum_d = 0.0
            for j in range(last - first):
                squared = tile[j] * tile[j]
                sum_a += squared * a[j]
                sum_b += squared * b[j]
                sum_c += squared * c[j]
                sum_d += squared * d[j]
            product[0, i] += sum_a
            product[1, i] += sum_b
            product[2, i] += sum_c
            product[3, i] += sum_d


def _dense_eigenpairs(distances: FloatArray, k: int) -> tuple[FloatArray, FloatArray]:
    squared = distances * distances
    means = squared.mean(axis=0)
    values, vectors = np.linalg.eigh(-0.5 * (squared - means - means[:, None] + means.mean()))
    return values[: -k - 1 : -1], vectors[:, : -k - 1 : -1]
