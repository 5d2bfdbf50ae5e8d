"""Smooth interpolation on a surface from values at a few vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import splu

from benchmark.api.contracts import FloatArray
from benchmark.geometry.laplacian import Laplacian


def smooth_interpolation(
    laplacian: Laplacian, samples: ArrayLike, *, weights: FloatArray | None = None, fidelity: float = np.inf
) -> FloatArray:
    r"""Return the matrix that extends values at sampled vertices smoothly to all vertices.

    Column j minimises :math:`x^\top L W^{-1} L x + \mu \| x_s - e_j \|^2` with diagonal W. Every minimiser is a
    combination of a constant and the Green's functions :math:`L^+ W L^+ e_s` of the samples, so one sparse
    factorisation of L and one dense system, as large as the number of samples, give all columns.

    Parameters
    ----------
    laplacian
        Laplacian of a connected surface.
    samples
        Distinct vertex indices, shape (p,).
    weights
        Diagonal of W, shape (n,); by default the vertex areas, which makes the interpolation biharmonic.
    fidelity
        Weight :math:`\mu` of the fit; if infinite, the fit at the samples is exact.

    Returns
    -------
    numpy.ndarray
        Shape (n, p); every row sums to 1, and the rows of samples form the identity if the fit is exact.
    """
    samples = np.asarray(samples)
    weights = laplacian.mass if weights is None else weights
    n, p = len(laplacian.mass), len(samples)
    shares = weights / weights.sum()
    # Only constants are in the null space of the Laplacian: without its first row and column it can be factorised.
    grounded = laplacian.stiffness.tocsc()[1:, 1:]
    factor = splu(grounded, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solve(loads: FloatArray) -> FloatArray:
        balanced = loads - np.outer(shares, loads.sum(axis=0))
        solution = np.vstack([np.zeros((1, p)), factor.solve(balanced[1:])])
        return np.asarray(solution - shares @ solution)

    units = np.zeros((n, p))
    units[samples, np.arange(p)] = 1.0
    green = solve(weights[:, None] * solve(units))
    scale = np.abs(green[samples]).max()
    green /= scale
    border = np.ones((p, 1))
    inner = green[samples] + np.eye(p) / (fidelity * scale)
    system = np.block([[inner, border], [border.T, np.zeros((1, 1))]])
    coefficients = np.linalg.solve(system, np.vstack([np.eye(p), np.zeros((1, p))]))
    return np.asarray(green @ coefficients[:-1] + coefficients[-1])
