"""Leading eigenpairs of a doubly centred matrix of squared distances, without forming it."""

from __future__ import annotations

import numba
import numpy as np

from benchmark.api.contracts import FloatArray

_BLOCK = 4


def centred_eigenpairs(
    distances: FloatArray, k: int, *, accurate: int, tolerance: float = 1e-9, max_steps: int = 40
) -> tuple[FloatArray, FloatArray]:
    r"""Compute the largest eigenvalues and their eigenvectors of the doubly centred squared distances.

    The matrix is :math:`B = -\frac12 J (D \circ D) J` with :math:`J = I - 11^\top/n`. It acts on a block of vectors by
    one product with the squared distances between two subtractions of column means, so neither B nor the squares are
    ever stored. Block Lanczos with full orthogonalisation (Golub & Van Loan 2013, section 10.3) starts from the columns
    of four mutually far points, so the result is deterministic.

    Parameters
    ----------
    distances
        Pairwise distances, symmetric, shape (n, n).
    k
        Number of eigenpairs, at most four.
    accurate
        Number of eigenpairs that must meet the tolerance. A Ritz value converges long before its vector, so one pair
        more than needed costs nothing and gives the gap.
    tolerance
        Maximum residual :math:`\|B q - \lambda q\|` of a unit vector q, relative to the largest eigenvalue.
    max_steps
        Maximum number of block products; a spectrum that needs more goes to LAPACK, as do small matrices.

    Returns
    -------
    values : numpy.ndarray
        Largest first, shape (k,); may be negative for a non-Euclidean metric.
    vectors : numpy.ndarray
        Orthonormal columns, shape (n, k), of arbitrary sign.
    """
    fresh, _ = np.linalg.qr(_centred(distances[_far_apart(distances)].T ** 2))
    basis = np.empty((len(distances), 0))
    projected = np.empty((0, 0))
    for _ in range(min(max_steps, len(distances) // (2 * _BLOCK))):
        basis = np.hstack([basis, fresh])
        image = _apply(distances, fresh)
        coupling = basis.T @ image
        # Twice: one pass of Gram-Schmidt turns columns that add little into rounding errors.
        fresh, outer = np.linalg.qr(image - basis @ coupling)
        fresh, inner = np.linalg.qr(fresh - basis @ (basis.T @ fresh))
        projected = np.block([[projected, coupling[:-_BLOCK]], [coupling.T]])
        values, coefficients = np.linalg.eigh(projected)
        values, coefficients = values[: -k - 1 : -1], coefficients[:, : -k - 1 : -1]
        residuals = np.linalg.norm(inner @ outer @ coefficients[-_BLOCK:], axis=0)
        if residuals[:accurate].max() <= tolerance * values[0]:
            return values, basis @ coefficients
    return _dense_eigenpairs(distances, k)


def _far_apart(distances: FloatArray) -> list[int]:
    chosen = [int(distances[0].argmax())]
    while len(chosen) < _BLOCK:
        chosen.append(int(distances[chosen].min(axis=0).argmax()))
    return chosen


def _centred(block: FloatArray) -> FloatArray:
    return np.asarray(block - block.mean(axis=0))


def _apply(distances: FloatArray, block: FloatArray) -> FloatArray:
    product = np.empty((_BLOCK, len(block)))
    _multiply_squared(distances, np.ascontiguousarray(_centred(block).T), product)
    return -0.5 * _centred(product.T)


# Four columns are too few for BLAS: this loop is more than twice as fast and needs no matrix of squares.
@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _multiply_squared(distances, rows, product):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    n = len(distances)
    a, b, c, d = rows[0], rows[1], rows[2], rows[3]
    for i in range(0, n, 2):
        # Two rows share each loaded number; the last row of an odd count is computed twice.
        k = min(i + 1, n - 1)
        upper, lower = distances[i], distances[k]
        upper_a = upper_b = upper_c = upper_d = lower_a = lower_b = lower_c = lower_d = 0.0
        for j in range(n):
            square = upper[j] * upper[j]
            upper_a += square * a[j]
            upper_b += square * b[j]
            upper_c += square * c[j]
            upper_d += square * d[j]
            square = lower[j] * lower[j]
            lower_a += square * a[j]
            lower_b += square * b[j]
            lower_c += square * c[j]
            lower_d += square * d[j]
        product[0, i], product[1, i], product[2, i], product[3, i] = upper_a, upper_b, upper_c, upper_d
        product[0, k], product[1, k], product[2, k], product[3, k] = lower_a, lower_b, lower_c, lower_d


def _dense_eigenpairs(distances: FloatArray, k: int) -> tuple[FloatArray, FloatArray]:
    squared = distances * distances
    means = squared.mean(axis=0)
    values, vectors = np.linalg.eigh(-0.5 * (squared - means - means[:, None] + means.mean()))
    return values[: -k - 1 : -1], vectors[:, : -k - 1 : -1]
