"""Smooth interpolation on a surface from values at a few vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import splu

from benchmark.api.contracts import FloatArray
from benchmark.geometry.laplacian import Laplacian


def biharmonic_interpolation(laplacian: Laplacian, samples: ArrayLike) -> FloatArray:
    r"""Matrix that continues values at sampled vertices smoothly to all vertices.

    Column j minimises the Laplacian energy :math:`x^\top L M^{-1} L x` among the functions that are 1 at sample j and 0
    at the others. Every such function is a combination of Green's functions :math:`L^+ M L^+ e_s` of the samples and
    a constant, so one sparse factorisation of L and a dense system as large as the number of samples give them all.

    Parameters
    ----------
    laplacian
        Of a surface in one piece.
    samples
        Distinct vertex indices, shape (p,).

    Returns
    -------
    numpy.ndarray
        Shape (n, p); the rows of the samples form the identity, every row sums to 1.
    """
    samples = np.asarray(samples)
    n, p = len(laplacian.mass), len(samples)
    shares = laplacian.mass / laplacian.mass.sum()
    # The Laplacian is singular only for the constant: without its first row and column it has a factor.
    grounded = laplacian.stiffness.tocsc()[1:, 1:]
    factor = splu(grounded, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solve(loads: FloatArray) -> FloatArray:
        balanced = loads - np.outer(shares, loads.sum(axis=0))
        solution = np.vstack([np.zeros((1, p)), factor.solve(balanced[1:])])
        return np.asarray(solution - shares @ solution)

    units = np.zeros((n, p))
    units[samples, np.arange(p)] = 1.0
    green = solve(laplacian.mass[:, None] * solve(units))
    green /= np.abs(green[samples]).max()
    border = np.ones((p, 1))
    system = np.block([[green[samples], border], [border.T, np.zeros((1, 1))]])
    coefficients = np.linalg.solve(system, np.vstack([np.eye(p), np.zeros((1, p))]))
    return np.asarray(green @ coefficients[:-1] + coefficients[-1])
