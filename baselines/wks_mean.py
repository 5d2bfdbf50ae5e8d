"""Mean wave kernel signature: how strongly each band of frequencies is localised on the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from benchmark.api.contracts import CheckedParameters, FloatArray, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class MeanWKS(CheckedParameters):
    r"""Quadratic mean of the wave kernel signature over the surface.

    With the Laplacian eigenpairs :math:`(\lambda_k, \phi_k)`, the signature of vertex x at log-energy e is

    .. math:: \mathrm{WKS}(x, e) = \frac{\sum_k \phi_k(x)^2 g_k(e)}{\sum_k g_k(e)}, \qquad
              g_k(e) = \exp\left( -\frac{(e - \log \lambda_k)^2}{2 \sigma^2} \right).

    Its arithmetic mean over the surface says nothing: every eigenfunction has norm 1, so the mean is 1 / A for every
    shape and every energy. The descriptor therefore takes the root of the area-weighted mean of the square, times the
    area A; a value of 1 means that waves of that energy visit the whole surface evenly. Two shapes differ by the
    Euclidean distance. A control: no canonical form. Aubry, Schlickewei and Cremers (2011), "The wave kernel
    signature: a quantum mechanical approach to shape analysis".

    Parameters
    ----------
    eigenpairs
        Number of non-constant eigenpairs.
    energies
        Number of energies, evenly spaced from the logarithm of the first eigenvalue to that of the last over 1.02.
    width
        Standard deviation of the bands, in energy steps.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="wks-mean",
        title="Mean WKS",
        cite="aubry2011wks",
        family="control",
        summary="quadratic mean of the wave kernel signature over the surface",
        departs="The source describes points; the quadratic mean over the surface is ours.",
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
        from benchmark.geometry.laplacian import eigenpairs

        require_vertices(shape, self.eigenpairs + 1)
        require_connected(shape)
        laplacian = shape.laplacian()
        values, functions = eigenpairs(laplacian, self.eigenpairs + 1)
        area = laplacian.mass.sum()
        logarithms = np.log(values[1:] * area)
        energies = np.linspace(logarithms[0], logarithms[-1] / 1.02, self.energies)
        deviation = self.width * (energies[1] - energies[0])
        bands = np.exp(-((energies[:, None] - logarithms) ** 2) / (2 * deviation**2))
        signatures = functions[:, 1:] ** 2 @ (bands / bands.sum(axis=1, keepdims=True)).T
        return np.asarray(np.sqrt(area * (laplacian.mass @ signatures**2)))

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the Euclidean distances of the descriptors, shape (N, N)."""
        from scipy.spatial.distance import pdist, squareform

        return np.asarray(squareform(pdist(np.stack(descriptors))))
