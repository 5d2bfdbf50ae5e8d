"""Classic MDS of distances on a surface: the bending-invariant form of Elad and Kimmel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.api.contracts import CanonicalForm, CheckedParameters, FloatArray, MethodInfo, Shape
from benchmark.geometry.embedding import oriented


@dataclass(frozen=True, kw_only=True)
class ClassicMDS(CheckedParameters):
    r"""Classic MDS (Torgerson scaling) of the geodesic distances.

    With the matrix D of geodesic distances and :math:`J = I - 11^\top / n`,

    .. math:: B = -\tfrac12 J (D \circ D) J = Q \Lambda Q^\top, \qquad X = Q_3 \Lambda_3^{1/2},

    with the three largest eigenvalues, of which negative ones count as zero. Signs of axes and the
    side of the mirror follow :func:`benchmark.api.oriented`. Elad and Kimmel (2003), "On bending
    invariant signatures for surfaces"; Torgerson (1952), "Multidimensional scaling: I. Theory and
    method".
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="classic-mds",
        title="Classic MDS",
        cite="elad2003bending",
        family="paper",
        summary=(
            "Places all points so that straight distances come near those along the surface, in "
            "one step."
        ),
        departs=(
            "Geodesic distances are shortest paths in a graph of edges and unfolded triangles; the "
            "source uses fast marching. Signs of the axes, and with them the mirror image, follow "
            "our rule."
        ),
        needs=("pairs",),
    )

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic MDS of the distances; notes are ratios of eigenvalues to the first."""
        points, values = classic_scaling(shape.geodesics())
        ratios = {f"eigenvalue_ratio_{k + 1}": float(values[k] / values[0]) for k in (1, 2, 3)}
        return shape.form(oriented(points, shape.mesh.vertex_areas), **ratios)


def classic_scaling(distances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Embed points in 3D by classic scaling, so that their distances approximate given ones.

    Parameters
    ----------
    distances
        Pairwise distances, symmetric, shape (n, n) with n at least 4.

    Returns
    -------
    points : numpy.ndarray
        Centred positions, shape (n, 3), along axes of decreasing variance and arbitrary sign; exact
        if the distances are those of points in 3D.
    values : numpy.ndarray
        The four largest eigenvalues of the doubly centred squares. If the third and fourth are
        nearly equal, they may swap under a small deformation.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    n = len(distances)
    squares = distances**2

    def multiply(vector: FloatArray) -> FloatArray:
        """Return the product of a vector and the Gram matrix, -1/2 times the centred squares."""
        product = squares @ (vector - vector.mean())
        return np.asarray(-0.5 * (product - product.mean()))

    if n < 64:  # the iteration needs more vectors than that
        values, vectors = np.linalg.eigh(np.apply_along_axis(multiply, 0, np.eye(n)))
    else:
        start = np.random.default_rng(0).standard_normal(n)
        operator = LinearOperator((n, n), matvec=multiply, dtype=np.float64)
        values, vectors = eigsh(operator, k=4, which="LA", v0=start, tol=1e-10)
    # Both solvers return ascending eigenvalues.
    four_largest = values[:-5:-1]
    three_vectors = vectors[:, :-4:-1]
    return three_vectors * np.sqrt(np.maximum(four_largest[:3], 0.0)), four_largest
