"""Eigenfunctions of a surface up to a gap of its spectrum, and the distances that they measure."""

from __future__ import annotations

from typing import Literal

import numpy as np

from baselines._kernels.checks import require_connected
from baselines._kernels.orientation import EQUAL
from benchmark.api.contracts import FloatArray, Shape, UnsupportedShape
from benchmark.geometry.laplacian import Laplacian, eigenpairs

Metric = Literal["geodesic", "diffusion", "commute-time", "biharmonic"]
"""Distances that a scaling may ask for: shortest ways along the surface, or one of :func:`spectral_embedding`."""

DETACHED = 1e-9
"""Below this product of the first eigenvalue and the area a surface is in pieces but for rounding errors; bodies have
some 3 to 25, and a neck of a thousandth of the width still has some hundredths."""


def clear_length(values: FloatArray, most: int) -> int:
    """Return how many of the first values to keep so that none of several equal ones is cut off from the others.

    Eigenvectors of equal eigenvalues are known as a space alone: what used some of them would hang on rounding errors.

    Parameters
    ----------
    values
        In order of falling importance, shape (k,).
    most
        Largest number to keep. With all of them, or where no gap is found, it is taken as it is.
    """
    if most >= len(values):
        return len(values)
    sizes = np.maximum(np.abs(values[1 : most + 1]), np.abs(values[:most]))
    gaps = np.flatnonzero(np.abs(np.diff(values[: most + 1])) > EQUAL * sizes)
    return int(gaps[-1]) + 1 if len(gaps) else most


def clear_eigenpairs(laplacian: Laplacian, most: int) -> tuple[FloatArray, FloatArray]:
    """Lowest eigenpairs after the constant function, at most so many, up to a gap of the spectrum.

    Parameters
    ----------
    laplacian
        Of a surface in one piece.
    most
        Largest number of pairs; at most n - 1 are there.

    Returns
    -------
    values : numpy.ndarray
        Shape (k,), ascending, positive.
    functions : numpy.ndarray
        Shape (n, k), orthonormal under the mass.

    Raises
    ------
    UnsupportedShape
        If parts of the surface hang together by triangles without area, which no function feels.
    """
    values, functions = eigenpairs(laplacian, min(most + 2, len(laplacian.mass)))
    if values[1] * laplacian.mass.sum() < DETACHED:
        raise UnsupportedShape(
            "parts of the surface hang together by triangles without area", "remesh the surface, or merge its vertices"
        )
    kept = slice(1, 1 + clear_length(values[1:], most))
    return values[kept], functions[:, kept]


def spectral_embedding(shape: Shape, metric: Metric, time: float, eigenfunctions: int) -> FloatArray:
    r"""Points whose Euclidean distances are the diffusion, commute-time or biharmonic distances of a surface.

    With the eigenpairs :math:`L \phi_k = \lambda_k M \phi_k` of a surface of area A,

    .. math:: d(x, y)^2 = A^2 \sum_{k \ge 1} f(A \lambda_k)^2 \left( \phi_k(x) - \phi_k(y) \right)^2

    where :math:`f(\lambda)` is :math:`e^{-\lambda t}` for the diffusion distance (Coifman and Lafon 2006),
    :math:`\lambda^{-1/2}` for the commute-time distance (Qiu and Hancock 2007) and :math:`\lambda^{-1}` for the
    biharmonic distance (Lipman, Rustamov and Funkhouser 2010). The powers of A, which is 1 for a prepared shape, make
    each of them a length. The sum ends at a gap of the spectrum.

    Parameters
    ----------
    shape
        A shape in one piece.
    metric
        One of the three.
    time
        Time t of the diffusion, in units of the area.
    eigenfunctions
        Largest number of terms.

    Returns
    -------
    numpy.ndarray
        Shape (n, k), each column orthogonal to the constant under the mass.

    Raises
    ------
    UnsupportedShape
        If the shape has several pieces, or hangs together by triangles without area.
    """
    require_connected(shape)
    laplacian = shape.laplacian()
    area = float(laplacian.mass.sum())
    values, functions = clear_eigenpairs(laplacian, eigenfunctions)
    values = area * values
    factors = {"diffusion": np.exp(-time * values), "commute-time": values**-0.5, "biharmonic": 1 / values}[metric]
    return np.asarray(area * factors * functions)


def distances_under(shape: Shape, metric: Metric, time: float, eigenfunctions: int, solver: str) -> FloatArray:
    """Distances of all pairs of vertices under a metric.

    Parameters
    ----------
    shape, metric, time, eigenfunctions
        As for :func:`spectral_embedding`; ``"geodesic"`` uses neither time nor eigenfunctions.
    solver
        As for :meth:`benchmark.api.contracts.Shape.geodesics`.

    Returns
    -------
    numpy.ndarray
        Symmetric, shape (n, n), in units of the mesh.

    Raises
    ------
    UnsupportedShape
        If the shape has several pieces.
    """
    if metric == "geodesic":
        return shape.geodesics(solver)
    from scipy.spatial.distance import pdist, squareform

    return np.asarray(squareform(pdist(spectral_embedding(shape, metric, time, eigenfunctions)), checks=False))
