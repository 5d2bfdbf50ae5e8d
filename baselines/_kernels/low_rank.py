"""Classic scaling of squared distances that are known as a product of thin matrices."""

from __future__ import annotations

import numpy as np

from baselines._kernels.handedness import Side, oriented
from benchmark.api.contracts import FloatArray, Mesh


def low_rank_scaling(mesh: Mesh, columns: FloatArray, coupling: FloatArray, side: Side) -> FloatArray:
    r"""Classic scaling of the squared distances :math:`Z M Z^\top`, without making that matrix.

    The thin factorisation :math:`J Z = Q R` leaves the eigenproblem of :math:`-\frac12 R M R^\top`, as large as Z has
    columns.

    Parameters
    ----------
    mesh
        The surface, which settles axes of equal eigenvalues, signs, and the side of the mirror.
    columns
        The matrix Z, shape (n, k) with k at least 3.
    coupling
        The symmetric matrix M, shape (k, k).
    side
        As of :func:`baselines._kernels.handedness.oriented`.

    Returns
    -------
    numpy.ndarray
        Centred positions, shape (n, 3), along axes of falling variance; negative eigenvalues count as zero.
    """
    orthonormal, triangular = np.linalg.qr(columns - columns.mean(axis=0))
    values, vectors = np.linalg.eigh(-0.5 * triangular @ coupling @ triangular.T)
    leading = np.maximum(values[:-4:-1], 0.0)
    return oriented(mesh, orthonormal @ (vectors[:, :-4:-1] * np.sqrt(leading)), leading, side=side)
