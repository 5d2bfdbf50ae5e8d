"""SI-HKS: a bag of features of the scale-invariant heat kernel signature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.spectrum import spectrum
from benchmark.api.contracts import CheckedParameters, FloatArray, Interval, MethodInfo, Shape

TIMES = 2.0 ** np.arange(-19, 5 + 1 / 16, 1 / 16)
"""Diffusion times on a surface of unit area: 24 octaves in steps of 1/16, as in the source.

By Weyl's law the eigenvalues at area 1 are about 4 pi k; the range is centred at the geometric mean
of 1 / (4 pi) and 1 / (400 pi), about 2^-7.
"""


@dataclass(frozen=True, kw_only=True)
class ScaleInvariantHKS(CheckedParameters):
    r"""Bag of features of the scale-invariant heat kernel signature.

    With the Laplacian eigenpairs :math:`(\lambda_k, \phi_k)` of the surface scaled to area 1, the
    signature of vertex x at time t, the heat that remains at x from a unit source there, is

    .. math:: \mathrm{HKS}(x, t) = \sum_k e^{-\lambda_k t} \phi_k(x)^2.

    At times :math:`t = 2^\tau`, scaling a surface shifts its signature in :math:`\tau` and
    multiplies it by a factor. The derivative of its logarithm with respect to :math:`\tau` removes
    the factor, and the moduli of its Fourier transform remove the shift; the lowest frequencies
    describe a vertex. The words are the k-means centres of all vertices of the gallery. With
    :math:`\sigma` twice the median distance of a vertex to its nearest word, vertex p has the
    weight :math:`e^{-\|p - w\|^2 / 2 \sigma^2}` for word w, normalised over the words. The bag of
    features is the area-weighted mean over its vertices. Shapes are compared by the sum of absolute
    differences. A control without a canonical form. Bronstein and Kokkinos (2010), "Scale-invariant
    heat kernel signatures for non-rigid shape recognition"; for the words Bronstein, Bronstein,
    Guibas and Ovsjanikov (2011), "Shape Google".

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
        summary=(
            "Compares how heat spreads from each point at any scale, as counts of typical patterns."
        ),
        departs=(
            "The words come from the gallery itself. Diffusion times cover the spectrum of a "
            "surface of unit area; in the source they depend on the unit of the file. Sigma is "
            "that of code released for the same experiments: twice the median distance of a vertex "
            "to its nearest word. That code also scales each signature to unit length, which is "
            "omitted here."
        ),
        scale="invariant",
        needs=("connected",),
    )

    eigenpairs: Annotated[int, Interval(2)] = 100
    frequencies: Annotated[int, Interval(1, 64)] = 6
    words: Annotated[int, Interval(2)] = 48

    def describe(self, shape: Shape) -> FloatArray:
        """Return the scale-invariant heat kernel signatures of all vertices, with their areas.

        Returns
        -------
        numpy.ndarray
            Shape (n * (1 + frequencies),): for each vertex its share of the area and the moduli of
            the lowest frequencies, vertices in the order of the lowest frequency.

        Raises
        ------
        UnsupportedShape
            If the second eigenvalue of the Laplacian is zero, or the shape has too few vertices.
        """
        values, functions = spectrum(shape, self.eigenpairs)
        mass = shape.laplacian().mass
        area = mass.sum()
        decays = np.exp(-np.outer(values * area, TIMES))
        # The heat kernel signature of each vertex at each time; the constant function keeps 1.
        heat = 1 + area * functions**2 @ decays
        # Minus its derivative by time, and from it the derivative of its logarithm by the binary
        # logarithm of time.
        cooling = area * functions**2 @ ((values * area)[:, None] * decays)
        slope = -np.log(2) * TIMES * cooling / heat
        # A change of scale shifts the slopes along time; the moduli of their Fourier transform stay
        # the same. Digits that depend on the processor are rounded off.
        moduli = np.abs(np.fft.rfft(slope, axis=1))[:, : self.frequencies].round(6)
        vertices = np.column_stack([mass / area, moduli])
        return vertices[np.argsort(moduli[:, 0])].ravel()

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the sums of absolute differences of the bags of features, shape (N, N)."""
        return self.compare_to(descriptors, descriptors)

    def compare_to(
        self, queries: Sequence[FloatArray], gallery: Sequence[FloatArray], draw: int = 0
    ) -> FloatArray:
        """Return the dissimilarities of M queries to N shapes of a gallery, as bags of features.

        The signatures of all vertices of the gallery are clustered; the centres are the words. The
        bag of a shape holds the share of each word in its area, where a vertex is divided among the
        words by their closeness. Two shapes differ by the sum of absolute differences of their
        bags.

        Parameters
        ----------
        queries, gallery
            Results of :meth:`describe`, M and N of them.
        draw
            Not used: the words are the same in each draw.

        Returns
        -------
        numpy.ndarray
            Shape (M, N).
        """
        from scipy.spatial import cKDTree
        from scipy.spatial.distance import cdist
        from sklearn.cluster import KMeans

        frequencies = [self._vertices(descriptor)[:, 1:] for descriptor in gallery]
        # Sorted and each one once, so that the words do not depend on the order of the gallery.
        vertices = np.unique(np.concatenate(frequencies), axis=0)
        count = min(self.words, len(vertices))
        words = KMeans(count, n_init=1, random_state=0).fit(vertices).cluster_centers_
        distances_to_words, _ = cKDTree(words).query(vertices)
        width = 2 * np.median(distances_to_words)
        sigma = max(width, 1e-9 * np.ptp(vertices)) or 1.0  # not 0, even if all vertices are alike

        columns = [self._bag(descriptor, words, sigma) for descriptor in gallery]
        rows = columns
        if queries is not gallery:
            rows = [self._bag(descriptor, words, sigma) for descriptor in queries]
        return np.asarray(cdist(rows, columns, "cityblock"))

    def _bag(self, descriptor: FloatArray, words: FloatArray, sigma: float) -> FloatArray:
        """Return the share of each word in the area of a shape, shape (words,).

        Parameters
        ----------
        descriptor
            Result of :meth:`describe`.
        words
            Frequencies of each word, shape (words, frequencies).
        sigma
            Distance over which the closeness of a vertex to a word falls off.
        """
        from scipy.spatial.distance import cdist

        vertices = self._vertices(descriptor)
        areas = vertices[:, 0]
        squares = cdist(vertices[:, 1:], words, "sqeuclidean")
        nearest = squares.min(axis=1, keepdims=True)  # without it, all may underflow
        closeness = np.exp((nearest - squares) / (2 * sigma**2))
        shares = closeness / closeness.sum(axis=1, keepdims=True)
        return np.asarray(areas @ shares).round(9)

    def _vertices(self, descriptor: FloatArray) -> FloatArray:
        """Return the area and frequencies of each vertex, shape (n, 1 + frequencies)."""
        return descriptor.reshape(-1, 1 + self.frequencies)
