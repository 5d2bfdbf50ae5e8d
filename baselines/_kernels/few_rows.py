"""Classic MDS of few rows of distances: samples, smooth extension, and low-rank scaling."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from baselines._kernels.arap import factorise_definite
from baselines._kernels.spectrum import spectrum
from benchmark.api.contracts import FloatArray, Shape
from benchmark.geometry.embedding import oriented
from benchmark.geometry.laplacian import Laplacian


def farthest_points(shape: Shape, count: int) -> list[int]:
    """Sample at most ``count`` vertices, each as far along edges from the previous as possible.

    The first is the vertex farthest from the geodesic centre, which is the vertex with the smallest
    maximum distance to four mutually far vertices.
    """
    graph = shape.mesh.edge_graph()
    vertices = shape.mesh.vertices
    outermost = int(((vertices - vertices.mean(axis=0)) ** 2).sum(axis=1).argmax())
    centre = int(dijkstra(graph, indices=_spread(graph, outermost, 4)).max(axis=0).argmin())
    return _spread(graph, int(dijkstra(graph, indices=centre).argmax()), count)


def _spread(graph: csr_array, first: int, count: int) -> list[int]:
    """Return at most ``count`` vertices, each as far from the previous as possible."""
    chosen = [first]
    nearest = dijkstra(graph, indices=first)
    while len(chosen) < min(count, len(nearest)):
        chosen.append(int(nearest.argmax()))
        # No vertex is farther than this from its nearest sample, so the search can stop there.
        np.minimum(nearest, dijkstra(graph, indices=chosen[-1], limit=nearest.max()), out=nearest)
    return chosen


def smooth_interpolation(
    shape: Shape, samples: list[int], *, weights: FloatArray | None = None, fidelity: float = np.inf
) -> FloatArray:
    r"""Return the matrix that extends values at sampled vertices smoothly to all vertices.

    With the Laplacian L, a diagonal W and the samples s, column j is the x that minimises

    .. math:: x^\top L W^{-1} L x + \mu \| x_s - e_j \|^2 .

    Every minimiser is a combination of a constant and the Green's functions
    :math:`G = L^+ W L^+ E_s` of the samples, where :math:`E_s` holds their columns of the identity.
    So the matrix is :math:`G A + 1 c^\top`, where A and c solve a dense system as large as the
    number of samples:

    .. math:: \begin{bmatrix} G_s + \mu^{-1} I & 1 \\ 1^\top & 0 \end{bmatrix}
              \begin{bmatrix} A \\ c^\top \end{bmatrix} = \begin{bmatrix} I \\ 0 \end{bmatrix} .

    Parameters
    ----------
    shape
        A connected surface.
    samples
        Distinct vertex indices, p of them.
    weights
        Diagonal of W, shape (n,); by default the vertex areas, which makes the interpolation
        biharmonic.
    fidelity
        Weight :math:`\mu` of the fit; if infinite, the fit at the samples is exact.

    Returns
    -------
    numpy.ndarray
        Shape (n, p); every row sums to 1, and the rows of samples form the identity if the fit is
        exact.

    Raises
    ------
    UnsupportedShape
        If the second eigenvalue of the Laplacian is zero.
    """
    spectrum(shape, 1)  # refuses a surface in several pieces, on which L has no such inverse
    laplacian = shape.laplacian()
    weights = laplacian.mass if weights is None else weights
    p = len(samples)
    green = _green_functions(laplacian, weights, samples)
    # Scale to numbers of about 1, so that the system is well conditioned in any unit of the
    # surface; the fidelity is scaled alike.
    scale = np.abs(green[samples]).max()
    green /= scale
    # The fit at the samples; the last row and column are the constant and its side condition.
    inner = green[samples] + np.eye(p) / (fidelity * scale)
    border = np.ones((p, 1))
    system = np.block([[inner, border], [border.T, np.zeros((1, 1))]])
    coefficients = np.linalg.solve(system, np.vstack([np.eye(p), np.zeros((1, p))]))
    of_green = coefficients[:-1]
    constants = coefficients[-1]
    return np.asarray(green @ of_green + constants)


def _green_functions(laplacian: Laplacian, weights: FloatArray, samples: list[int]) -> FloatArray:
    r"""Return the Green's functions :math:`L^+ W L^+ e_s` of sampled vertices, shape (n, p).

    Parameters
    ----------
    laplacian
        Laplacian L of a connected surface.
    weights
        Diagonal of W, shape (n,).
    samples
        Vertex indices, p of them.
    """
    n = len(weights)
    p = len(samples)
    shares = weights / weights.sum()
    # The Laplacian of constants is 0, so that it has no inverse. Without its first row and column,
    # which fixes the value of the first vertex at 0, it can be factorised.
    solve_grounded = factorise_definite(laplacian.stiffness[1:, 1:])

    def solve(loads: FloatArray) -> FloatArray:
        """Solve L x = b for each column b of the balanced loads; x has the weighted mean 0."""
        balanced = loads - np.outer(shares, loads.sum(axis=0))
        solution = np.vstack([np.zeros((1, p)), solve_grounded(balanced[1:])])
        return np.asarray(solution - shares @ solution)

    units = np.zeros((n, p))
    units[samples, np.arange(p)] = 1.0
    return solve(weights[:, None] * solve(units))


def low_rank_scaling(shape: Shape, columns: FloatArray, coupling: FloatArray) -> FloatArray:
    r"""Compute the classic MDS of squared distances :math:`Z M Z^\top` without that matrix.

    The thin factorisation :math:`J Z = Q R` leaves the eigenproblem of :math:`-\frac12 R M R^\top`,
    whose size is the number of columns of Z.

    Parameters
    ----------
    shape
        The surface, which decides on signs and the mirror image.
    columns
        The matrix Z, shape (n, k) with k at least 3.
    coupling
        The symmetric matrix M, shape (k, k).

    Returns
    -------
    numpy.ndarray
        Centred positions, shape (n, 3), along axes of decreasing variance; negative eigenvalues
        count as zero.
    """
    orthonormal, triangular = np.linalg.qr(columns - columns.mean(axis=0))
    values, vectors = np.linalg.eigh(-0.5 * triangular @ coupling @ triangular.T)
    leading = np.maximum(values[:-4:-1], 0.0)
    return oriented(orthonormal @ (vectors[:, :-4:-1] * np.sqrt(leading)), shape.mesh.vertex_areas)


def stress_of_rows(points: FloatArray, sources: list[int], rows: FloatArray) -> float:
    """Return the normalised stress over the pairs in ``rows``, from ``sources`` to all vertices."""
    distances = np.linalg.norm(points[sources][:, None] - points, axis=2)
    return float(((distances - rows) ** 2).sum() / (rows**2).sum())
