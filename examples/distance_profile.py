"""Distance Profile: how far the points of a surface are from all others, along the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from scipy.spatial.distance import cdist

from benchmark.api import FloatArray, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class DistanceProfile:
    """Quantiles over the surface of the mean geodesic distance of a point to all others.

    Parameters
    ----------
    count
        Numbers in a descriptor, at least 1.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="distance-profile",
        title="Distance Profile",
        summary="quantiles of the mean geodesic distance",
    )

    count: Annotated[int, Interval(1)] = 50

    def describe(self, shape: Shape) -> FloatArray:
        """Return the quantiles, shape (count,); each vertex counts by its area."""
        area = shape.laplacian().mass
        means = shape.geodesics() @ area / area.sum()
        order = np.argsort(means)
        below = np.cumsum(area[order]) - area[order] / 2
        levels = (np.arange(self.count) + 0.5) / self.count
        return np.interp(levels * area.sum(), below, means[order])

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the sums of the differences of quantiles, for all pairs, shape (N, N)."""
        return cdist(descriptors, descriptors, "cityblock")
