"""Heat kernel signatures: the spread of heat from the points of a surface at each scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from benchmark.api.contracts import CheckedParameters, FloatArray, Interval, MethodInfo, Shape


def _eigenpairs(shape: Shape, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the eigenvalues, eigenfunctions and vertex areas of a shape scaled to area 1, the constant function first.

    Raises
    ------
    UnsupportedShape
        If the shape has too few vertices for that many non-constant eigenpairs, no face, or several pieces.
    """
    from benchmark.geometry.laplacian import eigenpairs

    require_vertices(shape, count + 1)
    require_connected(shape)
    laplacian = shape.laplacian()
    values, functions = eigenpairs(laplacian, count + 1)
    area = laplacian.mass.sum()
    return values * area, functions * np.sqrt(area), laplacian.mass / area


def _pairwise(descriptors: Sequence[FloatArray], metric: str = "euclidean") -> FloatArray:
    from scipy.spatial.distance import pdist, squareform

    return np.asarray(squareform(pdist(np.stack(descriptors), metric)))


@dataclass(frozen=True, kw_only=True)
class ScaleInvariantHKS(CheckedParameters):
    r"""Bag of features of the scale-invariant heat kernel signature.

    At times :math:`t = 2^\tau`, scaling a surface shifts its heat kernel signature in :math:`\tau` and multiplies it by
    a factor. The derivative of its logarithm with respect to :math:`\tau` removes the factor, and the moduli of its
    Fourier transform remove the shift; the lowest frequencies describe a vertex. The words are the k-means centres of
    all vertices of the gallery. With :math:`\sigma^2` twice the median distance between two words, vertex p has the
    weight :math:`e^{-\|p - w\|^2 / 2 \sigma^2}` for word w, normalised over the words. The bag of features of a shape
    is the area-weighted mean over its vertices. Shapes are compared by the sum of absolute differences. A control
    without a canonical form. Bronstein and Kokkinos (2010), "Scale-invariant heat kernel signatures for non-rigid shape
    recognition"; for the words Bronstein, Bronstein, Guibas and Ovsjanikov (2011), "Shape Google".

    Parameters
    ----------
    eigenpairs
        Number of non-constant eigenpairs.
    frequencies
        Number of frequencies that describe a vertex.
    words
        Number of words; fewer if the gallery has fewer distinct vertices.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="si-hks",
        title="SI-HKS, bag of features",
        cite="bronstein2010sihks",
        family="control",
        summary="bag of features of the scale-invariant heat kernel signature",
        departs="The words come from the gallery itself, and the times cover the spectrum of a surface of area 1, "
        "where the source has the unit of the file.",
        scale="invariant",
    )

    eigenpairs: Annotated[int, Interval(2)] = 100
    frequencies: Annotated[int, Interval(1, 64)] = 6
    words: Annotated[int, Interval(2)] = 48

    def describe(self, shape: Shape) -> FloatArray:
        """Return the area and frequencies of each vertex, sorted by the lowest one, shape (n * (1 + frequencies),).

        Raises
        ------
        UnsupportedShape
            If the shape has too few vertices for that many eigenpairs, no face, or several pieces.
        """
        values, functions, areas = _eigenpairs(shape, self.eigenpairs)
        # 24 octaves in steps of 1/16, as in the source. By Weyl's law the eigenvalues at area 1 are about 4 pi k; the
        # range is centred at the geometric mean of 1 / (4 pi) and 1 / (400 pi), about 2^-7.
        times = 2.0 ** np.arange(-19, 5 + 1 / 16, 1 / 16)
        heat = np.exp(-np.outer(values, times))
        slope = -np.log(2) * times * (functions**2 @ (values[:, None] * heat)) / (functions**2 @ heat)
        moduli = np.abs(np.fft.rfft(slope, axis=1))[:, : self.frequencies]
        return np.column_stack([areas, moduli])[np.argsort(moduli[:, 0])].ravel()

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the sums of absolute differences of the bags of features, shape (N, N)."""
        from scipy.spatial.distance import cdist, pdist
        from sklearn.cluster import KMeans

        shapes = [descriptor.reshape(-1, 1 + self.frequencies) for descriptor in descriptors]
        # Sorted, so that the words do not depend on the order of the gallery.
        vertices = np.unique(np.concatenate([shape[:, 1:] for shape in shapes]), axis=0)
        count = min(self.words, len(vertices))
        words = KMeans(count, n_init=1, random_state=0).fit(vertices).cluster_centers_
        variance = 2 * np.median(pdist(words)) if count > 1 else 1.0
        bags = []
        for shape in shapes:
            closeness = np.exp(-cdist(shape[:, 1:], words, "sqeuclidean") / (2 * variance))
            bags.append(shape[:, 0] @ (closeness / closeness.sum(axis=1, keepdims=True)))
        return _pairwise(bags, "cityblock")
