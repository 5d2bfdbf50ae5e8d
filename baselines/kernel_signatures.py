"""Heat and wave kernel signatures: the spread of heat and waves from the points of a surface at each scale."""

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
class MeanHKS(CheckedParameters):
    r"""Mean of the heat kernel signature over the surface.

    With the Laplacian eigenpairs :math:`(\lambda_k, \phi_k)` of the surface scaled to area 1, the signature of vertex x
    at time t, the heat that remains at x from a unit source there, is

    .. math:: \mathrm{HKS}(x, t) = \sum_k e^{-\lambda_k t} \phi_k(x)^2.

    Its area-weighted mean is the heat trace :math:`\sum_k e^{-\lambda_k t}`. Shapes are compared by Euclidean distance.
    A control without a canonical form. Sun, Ovsjanikov and Guibas (2009), "A concise and provably informative
    multi-scale signature based on heat diffusion".

    Parameters
    ----------
    eigenpairs
        Number of non-constant eigenpairs.
    times
        Number of times, logarithmically spaced from 4 ln 10 over the last eigenvalue to 4 ln 10 over the first.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="hks-mean",
        title="Mean HKS",
        cite="sun2009hks",
        family="control",
        summary="mean of the heat kernel signature over the surface",
        departs="The source describes points by 300 eigenpairs; the mean over the surface and 100 eigenpairs are ours.",
        scale="invariant",
    )

    eigenpairs: Annotated[int, Interval(2)] = 100
    times: Annotated[int, Interval(2)] = 100

    def describe(self, shape: Shape) -> FloatArray:
        """Return the mean at each time, shape (times,).

        Raises
        ------
        UnsupportedShape
            If the shape has too few vertices for that many eigenpairs, no face, or several pieces.
        """
        values, _, _ = _eigenpairs(shape, self.eigenpairs)
        times = 4 * np.log(10) / np.geomspace(values[-1], values[1], self.times)
        return np.asarray(np.exp(-np.outer(times, values)).sum(axis=1))

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the Euclidean distances between the descriptors, shape (N, N)."""
        return _pairwise(descriptors)


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


@dataclass(frozen=True, kw_only=True)
class MeanWKS(CheckedParameters):
    r"""Quadratic mean of the wave kernel signature over the surface.

    With the Laplacian eigenpairs :math:`(\lambda_k, \phi_k)`, the signature of vertex x at log-energy e is

    .. math:: \mathrm{WKS}(x, e) = \frac{\sum_k \phi_k(x)^2 g_k(e)}{\sum_k g_k(e)}, \qquad
              g_k(e) = \exp\left( -\frac{(e - \log \lambda_k)^2}{2 \sigma^2} \right).

    Its arithmetic mean over the surface is uninformative: every eigenfunction has norm 1, so the mean is 1 / A for
    every shape and energy. The descriptor is therefore the area-weighted root mean square, times the area A; a value of
    1 means that waves of that energy cover the surface evenly. Shapes are compared by Euclidean distance. A control
    without a canonical form. Aubry, Schlickewei and Cremers (2011), "The wave kernel signature: a quantum mechanical
    approach to shape analysis".

    Parameters
    ----------
    eigenpairs
        Number of non-constant eigenpairs.
    energies
        Number of energies, evenly spaced from the logarithm of the first eigenvalue to that of the last divided by
        1.02.
    width
        Standard deviation of the bands, in energy steps.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="wks-mean",
        title="Mean WKS",
        cite="aubry2011wks",
        family="control",
        summary="quadratic mean of the wave kernel signature over the surface",
        departs="The source describes points; the quadratic mean over the surface and 100 eigenpairs are ours.",
        scale="invariant",
    )

    eigenpairs: Annotated[int, Interval(2)] = 100
    energies: Annotated[int, Interval(2)] = 100
    width: Annotated[float, Interval(0, closed="neither")] = 7.0

    def describe(self, shape: Shape) -> FloatArray:
        """Return the quadratic mean at each energy, times the area, shape (energies,).

        Raises
        ------
        UnsupportedShape
            If the shape has too few vertices for that many eigenpairs, no face, or several pieces.
        """
        values, functions, areas = _eigenpairs(shape, self.eigenpairs)
        logarithms = np.log(values[1:])
        energies = np.linspace(logarithms[0], logarithms[-1] / 1.02, self.energies)
        deviation = self.width * (energies[1] - energies[0])
        bands = np.exp(-((energies[:, None] - logarithms) ** 2) / (2 * deviation**2))
        signatures = functions[:, 1:] ** 2 @ (bands / bands.sum(axis=1, keepdims=True)).T
        return np.asarray(np.sqrt(areas @ signatures**2))

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the Euclidean distances between the descriptors, shape (N, N)."""
        return _pairwise(descriptors)
