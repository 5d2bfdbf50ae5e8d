"""Eigenfunctions of a surface up to a gap of its spectrum, and the distances that they define."""

from __future__ import annotations

from typing import Literal

import numpy as np

from baselines._kernels.checks import require_connected
from baselines._kernels.orientation import EQUAL
from benchmark.api.contracts import FloatArray, Shape, UnsupportedShape
from benchmark.geometry.laplacian import Laplacian, eigenpairs

Metric = Literal["geodesic", "diffusion", "commute-time", "biharmonic"]
"""Distances available to MDS: shortest paths along the surface, or those of :func:`spectral_embedding`."""

DETACHED = 1e-9
"""If the first eigenvalue times the area is below this, the surface is in pieces up to rounding errors; bodies have
about 3 to 25, and a neck of a thousandth of the width still has some hundredths."""


def clear_length(values: FloatArray, most: int) -> int:
    """Return how many of the first values to keep without splitting a group of equal ones.

    Equal eigenvalues determine only the space of their eigenvectors: a part of them would depend on rounding errors.

    Parameters
    ----------
    values
        In order of decreasing importance, shape (k,).
    most
        Maximum number to keep. Without a gap, exactly this many are kept, or all if there are fewer.
    """
    if most >= len(values):
        return len(values)
    sizes = np.maximum(np.abs(values[1 : most + 1]), np.abs(values[:most]))
    gaps = np.flatnonzero(np.abs(np.diff(values[: most + 1])) > EQUAL * sizes)
    return int(gaps[-1]) + 1 if len(gaps) else most


def clear_eigenpairs(laplacian: Laplacian, most: int) -> tuple[FloatArray, FloatArray]:
    """Compute the lowest eigenpairs after the constant function, up to a gap of the spectrum.

    Parameters
    ----------
    laplacian
        Laplacian of a connected surface.
    most
        Maximum number of pairs; there are at most n - 1.

    Returns
    -------
    values : numpy.ndarray
        Shape (k,), ascending, positive.
    functions : numpy.ndarray
        Shape (n, k), orthonormal under the mass.

    Raises
    ------
    UnsupportedShape
        If parts of the surface are joined only by triangles without area, which do not affect the eigenfunctions.
    """
    values, functions = eigenpairs(laplacian, min(most + 2, len(laplacian.mass)))
    if values[1] * laplacian.mass.sum() < DETACHED:
        raise UnsupportedShape(
            "parts of the surface hang together by triangles without area", "remesh the surface, or merge its vertices"
        )
    kept = slice(1, 1 + clear_length(values[1:], most))
    return values[kept], functions[:, kept]


def spectral_embedding(shape: Shape, metric: Metric, time: float, eigenfunctions: int) -> FloatArray:
    r"""Return points whose Euclidean distances are the diffusion, commute-time or biharmonic distances of a surface.

    With the eigenpairs :math:`L \phi_k = \lambda_k M \phi_k` of a surface of area A,

    .. math:: d(x, y)^2 = A^2 \sum_{k \ge 1} f(A \lambda_k)^2 \left( \phi_k(x) - \phi_k(y) \right)^2

    where :math:`f(\lambda)` is :math:`e^{-\lambda t}` for the diffusion distance (Coifman and Lafon 2006),
    :math:`\lambda^{-1/2}` for the commute-time distance (Qiu and Hancock 2007) and :math:`\lambda^{-1}` for the
    biharmonic distance (Lipman, Rustamov and Funkhouser 2010). The powers of A, which is 1 for a prepared shape, make
    each of them a length. The sum ends at a gap of the spectrum.

    Parameters
    ----------
    shape
        A connected shape.
    metric
        One of the three.
    time
        Diffusion time t, in units of the area.
    eigenfunctions
        Maximum number of terms.

    Returns
    -------
    numpy.ndarray
        Shape (n, k), each column orthogonal to the constant under the mass.

    Raises
    ------
    UnsupportedShape
        If the shape has several pieces, or parts joined only by triangles without area.
    """
    require_connected(shape)
    laplacian = shape.laplacian()
    area = float(laplacian.mass.sum())
    values, functions = clear_eigenpairs(laplacian, eigenfunctions)
    values = area * values
    factors = {"diffusion": np.exp(-time * values), "commute-time": values**-0.5, "biharmonic": 1 / values}[metric]
    return np.asarray(area * factors * functions)


def distances_under(shape: Shape, metric: Metric, time: float, eigenfunctions: int, solver: str) -> FloatArray:
    """Return the distances between all pairs of vertices under a metric.

    Parameters
    ----------
    shape, metric, time, eigenfunctions
        As in :func:`spectral_embedding`; ``"geodesic"`` uses neither time nor eigenfunctions.
    solver
        As in :meth:`benchmark.api.contracts.Shape.geodesics`.

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
